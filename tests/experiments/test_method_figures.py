"""Radar chart and pairwise comparison: shapes match the scores, colours the better method."""

import io
from itertools import combinations

import imageio.v3 as imageio
import numpy as np
import pytest
from matplotlib import colormaps

from experiments.method_figures import error_difference, pairwise_figure, radar_figure
from occjax.errors import InputError
from occjax.evaluation.benchmark import metric_names
from occjax.viz.canvas import MARGIN, TITLE_HEIGHT, whole_zoom

SCORES = {
    "one": {"mse": 1.0, "runtime": 3.0, "bad": 0.0, "perfect": 0.0},
    "two": {"bad": 8.0, "mse": 4.0, "runtime": 2.0, "perfect": 0.0, "alone": 9.0},
}


def words(figure):
    axes = figure.axes[0]
    return [text.get_text() for text in (*figure.texts, *axes.texts)]


def test_radius_is_relative_to_the_worst_score():
    axes = radar_figure(SCORES).axes[0]
    shapes = {line.get_label(): line.get_ydata() for line in axes.lines}
    # The first point is repeated at the end, which closes the shape.
    assert shapes["one"].tolist() == [0.25, 1.0, 0.0, 0.0, 0.25]
    assert shapes["two"].tolist() == pytest.approx([1.0, 2 / 3, 1.0, 0.0, 1.0])
    angles = axes.lines[0].get_xdata()
    np.testing.assert_allclose(angles, [0.0, np.pi / 2, np.pi, 3 * np.pi / 2, 0.0])


def test_spokes_of_common_measures_have_the_worst_score():
    shown = words(radar_figure(SCORES, title="Scene"))
    assert shown == ["Scene", "mse\n4", "runtime\n3", "bad\n8", "perfect\n0"]


@pytest.mark.parametrize("count", [3, 4, 5, 8, 12, 13, len(metric_names())])
def test_names_of_measures_do_not_overlap(count):
    """For any number of measures, at any place around the chart."""
    for first in (0, len(metric_names()) - count):
        names = metric_names()[first : first + count]
        figure = radar_figure({"one": dict.fromkeys(names, 12.34)})
        boxes = [text.get_window_extent() for text in figure.axes[0].texts]
        assert not any(a.overlaps(b) for a, b in combinations(boxes, 2))
        legend = figure.axes[0].get_legend().get_window_extent()
        assert not any(legend.overlaps(box) for box in boxes)
        width, height = figure.get_size_inches() * 100
        assert all(box.x0 >= 0 and box.x1 <= width and box.y1 <= height for box in boxes)


def test_measure_with_a_non_finite_score_is_omitted():
    scores = {**SCORES, "three": {"mse": np.nan, "runtime": 1.0, "bad": 1.0, "perfect": 1.0}}
    assert "mse\n4" not in words(radar_figure(scores))


def test_many_methods_have_different_lines():
    lines = radar_figure({f"{n}": SCORES["one"] for n in range(12)}).axes[0].lines
    assert len({(line.get_color(), line.get_linestyle()) for line in lines}) == 12


@pytest.mark.parametrize(
    ("scores", "message"),
    [({}, "one method or more"), ({"one": {"a": 1.0, "b": 1.0}}, "three measures that all")],
)
def test_radar_chart_needs_a_method_and_three_common_measures(scores, message):
    with pytest.raises(InputError, match=message):
        radar_figure(scores)


def example():
    """Columns: equal, first better, second better, only first, only second, none, no truth."""
    nan = np.nan
    truth = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, nan]])
    first = np.array([[0.1, 0.0, -0.3, 1.0, nan, nan, 0.0]])
    second = np.array([[-0.1, 0.2, 0.1, nan, 1.0, nan, 0.0]])
    return tuple(np.repeat(one, 6, axis=0) for one in (first, second, truth))


def test_error_difference_is_negative_where_the_first_is_better(tolerance):
    expected = [0.0, -0.2, 0.2, -np.inf, np.inf, np.nan, np.nan]
    difference = error_difference(*example())
    np.testing.assert_allclose(difference, np.tile(expected, (6, 1)), **tolerance("float64"))


def test_purple_marks_the_first_and_orange_the_second(tolerance):
    figure = pairwise_figure(*example(), names=("a", "b"))
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    image = imageio.imread(buffer.getvalue())[..., :3].astype(int)
    zoom = whole_zoom((6, 7))
    panel = max(7 * zoom, 300)
    middles = MARGIN + 2 * (panel + 14) + zoom // 2 + zoom * np.arange(7)
    shown = image[MARGIN + TITLE_HEIGHT + zoom // 2, middles]
    scale = colormaps["PuOr_r"]
    middle, purple, orange = (np.array(scale(v, bytes=True)[:3], int) for v in (0.5, 0.0, 1.0))
    grey = [0x8A] * 3
    # The colours end at 0.21: a difference of 0.2 is almost there.
    part = np.array(scale(0.5 + 0.5 * 0.2 / 0.21, bytes=True)[:3], int)
    assert purple[2] > purple[1]
    assert orange[0] > orange[2]
    for place, colour in ((0, middle), (2, part), (3, purple), (4, orange), (5, grey), (6, grey)):
        np.testing.assert_allclose(shown[place], colour, **tolerance("colour"))


def test_percentages_are_of_comparable_pixels_inside_the_border():
    first, second, truth = example()
    title = words(pairwise_figure(first, second, truth, names=("a", "b")))[2]
    assert title == "Better: a 40.0%, b 40.0%"
    title = words(pairwise_figure(first, second, truth, names=("a", "b"), border=2))[2]
    assert title == "Better: a 33.3%, b 66.7%"  # columns 2 to 4
    slightly = words(pairwise_figure(truth, truth + 0.009, np.zeros_like(truth)))[2]
    assert slightly == "Better: first 0.0%, second 0.0%"


def test_large_maps_are_subsampled_but_counted_completely():
    truth = np.zeros((30, 1300))
    first = truth.copy()
    first[:, 1] = 1.0  # a column that is not shown
    figure = pairwise_figure(first, truth, truth)
    assert words(figure)[2] == "Better: first 0.0%, second 0.1%"
    assert figure.get_size_inches()[0] * 100 < 3 * 600


def test_maps_of_different_sizes_are_rejected():
    with pytest.raises(InputError, match="compare maps of equal size"):
        pairwise_figure(np.zeros((3, 4)), np.zeros((3, 4)), np.zeros((3, 5)))
