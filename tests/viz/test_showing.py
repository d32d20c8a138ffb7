"""How light fields and estimates show themselves: text, notebook, Matplotlib axes."""

import re
from xml.etree import ElementTree

import matplotlib
import matplotlib.pyplot
import numpy as np
import pytest

from occjax.errors import InputError
from occjax.estimators import Estimate
from occjax.estimators.driver import with_report
from occjax.lightfield import Calibration, LightField
from tests.scenes import plane

matplotlib.use("agg")

RAMP = np.linspace(-1.0, 2.0, 48, dtype=np.float32).reshape(6, 8)


def light_field(**changes):
    usable = np.ones((3, 5), bool)
    usable[0, 0] = False
    fields = {
        "views": np.full((3, 5, 6, 8, 3), 255, np.uint8),
        "name": "<wall>",
        "calibration": Calibration(50.0, 36.0, 4.0, 2.5),
        "disparity_range": (-1.5, 2.0),
        "ground_truth": RAMP - np.float32(0.1),
        "usable": usable,
    }
    return LightField(**{**fields, **changes})


def estimate(**changes):
    fields = {
        "disparity": RAMP,
        "confidence": np.full_like(RAMP, 0.75),
        "standard_deviation": RAMP,
        "disparity_range": (-1.5, 2.5),
        "model": "photometric",
        "seconds": {"prepare": 1.0, "run": 0.5},
        "notes": ("a note",),
        "light_field": light_field(),
    }
    return Estimate(**{**fields, **changes})


def test_a_light_field_is_described_in_two_lines():
    assert repr(light_field()).splitlines() == [
        "LightField '<wall>': 3x5 views of 6x8 pixels (rows x columns), colour uint8",
        "  disparity range: -1.50 to 2.00 pixels per view step; calibration: focal length 50 mm, "
        "sensor 36 mm, baseline 4 mm, focus 2.5 m; ground truth: yes; usable views: 14 of 15",
    ]


@pytest.mark.parametrize("disparity", [0.5, None])
def test_the_measured_range_is_described(disparity):
    """Views without texture show none."""
    scene = plane(grid=(5, 5), size=(32, 40), disparity=disparity or 0.0)
    views = scene.views if disparity else np.full_like(scene.views, 0.5)
    measured = with_report(LightField(views))
    facts = repr(measured).splitlines()[1].split("; ")
    if disparity is None:
        assert facts[0] == "  disparity range: unknown"
        return
    low, high = re.fullmatch(
        r"  disparity range: (.*) to (.*) pixels per view step, measured", facts[0]
    ).groups()
    assert float(low) < disparity < float(high)
    assert float(high) - float(low) < 1.0


def test_an_estimate_is_described_in_two_lines():
    assert repr(estimate()).splitlines() == [
        "Estimate of '<wall>' by photometric: 6x8 pixels (rows x columns)",
        "  disparity: -1.00 to 2.00, searched -1.50 to 2.50 pixels per view step; "
        "confidence: median 0.75; time: 1.5 s; notes: 1",
    ]
    nothing = np.full_like(RAMP, np.nan)
    assert "no value" in repr(estimate(disparity=nothing, confidence=nothing, light_field=None))


@pytest.mark.parametrize("shown", [light_field(), estimate()])
def test_a_notebook_shows_a_picture_and_a_table(shown):
    html = shown._repr_html_()
    tree = ElementTree.fromstring(html)
    assert tree.find("img").get("src").startswith("data:image/png;base64,")
    assert "<wall>" in tree.find("table/caption").text
    facts = {row.find("th").text: row.find("td").text for row in tree.iter("tr")}
    title, line = repr(shown).splitlines()
    assert tree.find("table/caption").text == title
    assert "; ".join(f"{name}: {value}" for name, value in facts.items()) == line.strip()


def test_plots_draw_the_values_into_the_axes_and_return_them():
    figure, axes = matplotlib.pyplot.subplots(1, 4)
    assert light_field().plot(axes=axes[0]) is axes[0]
    for place, quantity in zip(axes[1:], ("disparity", "confidence", "error"), strict=True):
        assert estimate().plot(quantity, axes=place) is place
    np.testing.assert_array_equal(axes[0].images[0].get_array(), 255)
    np.testing.assert_array_equal(axes[1].images[0].get_array(), RAMP)
    assert axes[2].images[0].get_clim() == (0.0, 1.0)
    bars = [bar.get_ylabel() for bar in figure.axes[4:]]
    assert [label.split(" [")[0] for label in bars] == [
        *("disparity", "confidence (1: certain)", "estimate - ground truth")
    ]
    assert estimate().plot().figure is not figure  # a new one
    matplotlib.pyplot.close("all")


def test_what_cannot_be_plotted_is_refused(unchecked):
    with pytest.raises(InputError, match="no ground truth"):
        estimate(light_field=None).plot("error")
    with pytest.raises(InputError, match="quantity is 'depth'"):
        estimate().plot("depth")
