"""Descriptions of light fields and estimates: ``repr`` and the table that a notebook shows."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np

from occjax.lightfield import Calibration, LightField

if TYPE_CHECKING:
    from occjax.estimators.protocol import Estimate

UNIT = "pixels per view step"


@dataclass(frozen=True)
class Description:
    """Title and properties of an object, in words.

    Attributes:
        title: Kind and name, number of views and pixels, type.
        facts: Further properties by their names, in words.
    """

    title: str
    facts: dict[str, str]

    def __str__(self) -> str:
        """Two lines: the title, and the facts."""
        facts = (f"{name}: {value}" for name, value in self.facts.items())
        return f"{self.title}\n  {'; '.join(facts)}"

    def html(self, picture: np.ndarray) -> str:
        """Return a fragment of HTML: a picture and a table next to it.

        Args:
            picture: ``[H, W, 3]`` uint8 RGB.
        """
        from PIL import Image

        png = io.BytesIO()
        Image.fromarray(picture).save(png, format="PNG")
        address = "data:image/png;base64," + base64.b64encode(png.getvalue()).decode("ascii")
        frame = ElementTree.Element("div", style="display:flex;gap:1em;align-items:flex-start")
        ElementTree.SubElement(frame, "img", src=address, alt=self.title, style="max-width:256px")
        table = ElementTree.SubElement(frame, "table")
        ElementTree.SubElement(table, "caption", style="text-align:left").text = self.title
        for name, value in self.facts.items():
            row = ElementTree.SubElement(table, "tr")
            ElementTree.SubElement(row, "th", style="text-align:left").text = name
            ElementTree.SubElement(row, "td", style="text-align:left").text = value
        return ElementTree.tostring(frame, encoding="unicode")


def describe_light_field(light_field: LightField) -> Description:
    """Describe a light field.

    Example:
        >>> print(describe_light_field(LightField(np.zeros((3, 3, 8, 9), np.uint8), name="wall")))
        LightField 'wall': 3x3 views of 8x9 pixels (rows x columns), grey uint8
          disparity range: unknown; calibration: none; ground truth: no
    """
    v, u = light_field.grid
    height, width = light_field.image_size
    colour = "grey" if light_field.views.shape[-1] == 1 else "colour"
    title = (
        f"LightField {light_field.name!r}: {v}x{u} views of {height}x{width} pixels "
        f"(rows x columns), {colour} {light_field.views.dtype}"
    )
    facts = {
        "disparity range": _disparity_range(light_field),
        "calibration": describe_calibration(light_field.calibration),
        "ground truth": "no" if light_field.ground_truth is None else "yes",
    }
    if light_field.usable is not None and not light_field.usable.all():
        facts["usable views"] = f"{light_field.usable.sum()} of {light_field.usable.size}"
    if light_field.view is not None:
        facts["centre view"] = "view ({}, {}) of a larger light field".format(*light_field.view)
    if light_field.positions is not None:
        facts["camera positions"] = "given"
    return Description(title, facts)


def _disparity_range(light_field: LightField) -> str:
    """Describe the declared disparity range, else the measured one."""
    if light_field.disparity_range is not None:
        return f"{_range(*light_field.disparity_range)} {UNIT}"
    report = light_field.view_order_report
    if report is None or not report.measured_fraction:
        return "unknown"
    return f"{_range(*report.declared_range)} {UNIT}, measured"


def describe_estimate(estimate: Estimate) -> Description:
    """Describe an estimate.

    Example:
        >>> from occjax.estimators import Estimate
        >>> flat = np.ones((8, 9), np.float32)
        >>> description = describe_estimate(Estimate(flat, flat, flat, (-1.0, 2.0), "mine"))
        >>> description.title
        'Estimate by mine: 8x9 pixels (rows x columns)'
        >>> description.facts["disparity"]
        '1.00 to 1.00, searched -1.00 to 2.00 pixels per view step'
    """
    height, width = estimate.disparity.shape
    of_scene = "" if estimate.light_field is None else f" of {estimate.light_field.name!r}"
    with_weights = f" with {estimate.weights}" if estimate.weights else ""
    title = (
        f"Estimate{of_scene} by {estimate.model}{with_weights}: {height}x{width} pixels "
        "(rows x columns)"
    )
    known = estimate.disparity[np.isfinite(estimate.disparity)]
    values = _range(float(known.min()), float(known.max())) if known.size else "no value"
    certain = estimate.confidence[np.isfinite(estimate.confidence)]
    facts = {
        "disparity": f"{values}, searched {_range(*estimate.disparity_range)} {UNIT}",
        "confidence": f"median {np.median(certain):.2f}" if certain.size else "no value",
    }
    if estimate.seconds:
        facts["time"] = f"{sum(estimate.seconds.values()):.1f} s"
    if estimate.occlusion is not None:
        facts["occlusion maps"] = "{}x{} views".format(*estimate.occlusion.shape[:2])
    if estimate.notes:
        facts["notes"] = str(len(estimate.notes))
    return Description(title, facts)


def describe_calibration(calibration: Calibration | None) -> str:
    """Describe a camera in words.

    Example:
        >>> describe_calibration(Calibration(50.0, 36.0, 4.0, float("inf")))
        'focal length 50 mm, sensor 36 mm, baseline 4 mm, focus inf m'
    """
    if calibration is None:
        return "none"
    return (
        f"focal length {calibration.focal_length_mm:g} mm, sensor {calibration.sensor_size_mm:g} "
        f"mm, baseline {calibration.baseline_mm:g} mm, focus {calibration.focus_distance_m:g} m"
    )


def _range(low: float, high: float) -> str:
    return f"{low:.2f} to {high:.2f}"
