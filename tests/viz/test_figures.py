"""Figures: colours of single pixels, layout, reproducible bytes."""

import io

import imageio.v3 as imageio
import matplotlib
import numpy as np
import pytest
from matplotlib import colormaps

from occjax.errors import InputError
from occjax.viz import (
    comparison_figure,
    confidence_figure,
    confidence_picture,
    depth_figure,
    disparity_figure,
    disparity_picture,
    error_figure,
    error_picture,
    occlusion_figure,
    save,
    save_picture,
    view_picture,
)
from occjax.viz.canvas import MARGIN, TITLE_HEIGHT, whole_zoom
from occjax.viz.colour import colourbar_extend, common_norm, disparity_norm, error_colours

LEFT, TOP = MARGIN, MARGIN + TITLE_HEIGHT
RAMP = np.linspace(-1.0, 2.0, 12 * 17, dtype=np.float32).reshape(12, 17)


def pixels(figure):
    """Return the figure as an image ``[H, W, 3]`` uint8."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return imageio.imread(buffer.getvalue())[..., :3]


def shown_map(figure, shape):
    """Return the colour in the middle of each value's square."""
    zoom = whole_zoom(shape)
    image = pixels(figure)
    rows = TOP + zoom // 2 + zoom * np.arange(shape[0])
    columns = LEFT + zoom // 2 + zoom * np.arange(shape[1])
    return image[rows[:, None], columns[None, :]]


def test_every_value_of_a_map_is_shown_unresampled_in_viridis(tolerance):
    expected = colormaps["viridis"]((RAMP + 1.0) / 3.0, bytes=True)[..., :3]
    np.testing.assert_allclose(
        shown_map(disparity_figure(RAMP), RAMP.shape).astype(int),
        expected.astype(int),
        **tolerance("colour"),
    )


def test_confidence_colours_do_not_depend_on_the_range_of_the_map(tolerance):
    image = shown_map(confidence_figure(np.full((8, 8), 0.25)), (8, 8))
    expected = np.array(colormaps["magma"](0.25, bytes=True)[:3], int)
    np.testing.assert_allclose(
        image.astype(int), np.broadcast_to(expected, image.shape), **tolerance("colour")
    )


def test_near_depth_is_yellow_and_infinite_depth_is_grey(tolerance):
    depth = 2.0 + RAMP.astype(np.float64)  # 1 to 4 metres
    depth[0, 0] = np.inf
    image = shown_map(depth_figure(depth), depth.shape).astype(int)
    low, high = depth[0, 1], 4.0
    expected = colormaps["viridis"]((high - depth) / (high - low), bytes=True)[..., :3].astype(int)
    np.testing.assert_allclose(
        image.reshape(-1, 3)[1:], expected.reshape(-1, 3)[1:], **tolerance("colour")
    )
    assert image[0, 0].tolist() == [0x8A, 0x8A, 0x8A]


def test_single_distant_points_do_not_change_a_depth_map():
    depth = np.tile(np.linspace(1.0, 2.0, 50), (50, 1))
    depth[7, 7] = 1e6
    image = shown_map(depth_figure(depth), depth.shape).astype(int)
    assert np.abs(image[40, 5] - image[40, 45]).max() > 100


def test_pixels_without_a_value_are_grey():
    values = RAMP.copy()
    values[3, 4] = np.nan
    values[5, 6] = np.inf
    image = shown_map(disparity_figure(values), values.shape)
    assert image[3, 4].tolist() == image[5, 6].tolist() == [0x8A, 0x8A, 0x8A]


def test_bad_pixels_have_full_colours_that_depend_on_the_sign():
    truth = np.zeros((4, 4))
    estimate = np.zeros((4, 4))
    estimate[0, :4] = [0.069, 0.071, -0.069, -0.071]
    estimate[1, 0] = np.nan
    truth[1, 1] = np.nan
    image = shown_map(error_figure(estimate, truth), (4, 4)).astype(int)
    good_near, bad_near, good_far, bad_far = image[0]
    assert np.abs(good_near - bad_near).max() > 30
    assert np.abs(good_far - bad_far).max() > 30
    assert bad_near[0] > bad_near[2]  # too near is red
    assert bad_far[0] < bad_far[2]  # too far is blue
    assert image[1, 0].tolist() == [0, 0, 0]
    assert image[1, 1].tolist() == [0x8A, 0x8A, 0x8A]
    assert image[3, 3].min() > 240


def test_error_colours_grow_darker_with_the_error():
    errors = np.array([0.0, 0.03, 0.06, 0.08, 0.15, 0.21])
    for sign in (-1.0, 1.0):
        colours = error_colours(0.07, 0.21)(0.5 + sign * errors / 0.42)[:, :3]
        assert (np.diff(colours.sum(axis=1)) < 0).all()


def test_white_is_occluded_in_the_mosaic_and_views_are_in_grid_order():
    occlusion = np.zeros((3, 5, 10, 14))
    occlusion[0, 4] = 1.0
    image = pixels(occlusion_figure(occlusion))
    zoom = whole_zoom((30, 70), 650)
    white = np.zeros((3, 5), bool)
    for v, u in np.ndindex(3, 5):
        y = TOP + v * (10 * zoom + 3) + 5 * zoom
        x = LEFT + u * (14 * zoom + 3) + 7 * zoom
        white[v, u] = image[y, x].min() == 255
    assert np.argwhere(white).tolist() == [[0, 4]]


def test_large_mosaics_are_averaged():
    occlusion = np.zeros((9, 9, 290, 300))
    occlusion[:, :, ::3, ::3] = 0.9  # one of every 3 x 3 pixels
    image = pixels(occlusion_figure(occlusion))
    assert max(image.shape[:2]) < 1400
    assert len(np.unique(image[TOP + 40 : TOP + 80, LEFT + 40 : LEFT + 80])) == 1  # no pattern


@pytest.mark.parametrize("shape", [(383, 552), (30, 400), (400, 24), (2, 2)])
def test_layout_holds_for_any_aspect(shape):
    values = np.linspace(0.0, 1.0, shape[0] * shape[1]).reshape(shape)
    for figure in (disparity_figure(values), error_figure(values, values, title="E" * 50)):
        image = pixels(figure)
        assert (image[:, -4:] == 255).all()  # nothing crosses the right edge ...
        assert (image[-4:] == 255).all()  # ... or the lower one
        figure.draw_without_rendering()
        width, height = figure.canvas.get_width_height()
        for axes in figure.axes:
            box = axes.get_tightbbox()
            assert box.x0 >= 0
            assert box.y0 >= 0
            assert box.x1 <= width
            assert box.y1 <= height


@pytest.mark.parametrize("value", [1.25, -3e4, np.nan])
def test_constant_and_empty_maps_can_be_drawn(value, tmp_path):
    values = np.full((6, 7), value)
    save(comparison_figure(np.zeros((6, 7, 1)), values, values), tmp_path / "comparison.png")
    assert [path.name for path in tmp_path.iterdir()] == ["comparison.png"]


def test_limits_ignore_values_that_are_not_finite():
    norm = common_norm(np.array([np.nan, 1.0, np.inf]), np.array([-2.0]))
    assert (norm.vmin, norm.vmax) == (-2.0, 1.0)


def test_outliers_of_low_confidence_are_outside_the_range():
    disparity = np.tile(np.linspace(0.0, 2.0, 1000), (4, 1))
    confidence = np.full(disparity.shape, 0.6)
    disparity[0, :300], confidence[0, :300] = 9.0, 0.1
    norm = disparity_norm(disparity, confidence)
    np.testing.assert_allclose((norm.vmin, norm.vmax), (0.0, 2.0), atol=0.01)
    assert colourbar_extend(norm, disparity) == "max"
    assert colourbar_extend(disparity_norm(-disparity, confidence), -disparity) == "min"


def test_a_map_without_outliers_has_its_full_range():
    norm = disparity_norm(RAMP, np.full(RAMP.shape, 0.3))
    assert (norm.vmin, norm.vmax) == (-1.0, 2.0)
    assert colourbar_extend(norm, RAMP) == "neither"


@pytest.mark.parametrize("confidence", [None, np.full((12, 17), 0.5)])
def test_the_colours_cover_the_ground_truth(confidence):
    truth = np.full(RAMP.shape, np.nan)
    truth[0, :2] = (-7.0, 8.0)
    norm = disparity_norm(RAMP, confidence, truth)
    assert (norm.vmin, norm.vmax) == (-7.0, 8.0)


def test_a_map_without_values_has_a_range():
    nothing = np.full((4, 5), np.nan)
    for confidence in (None, nothing, np.ones((4, 5))):
        norm = disparity_norm(nothing, confidence)
        assert norm.vmin < norm.vmax


def test_the_bar_is_pointed_where_values_exceed_it():
    disparity = RAMP.copy()
    confidence = np.full(RAMP.shape, 0.5)
    disparity[:2], confidence[:2] = 50.0, 0.1
    whole = pixels(disparity_figure(RAMP, confidence=confidence))
    cut = pixels(disparity_figure(disparity, confidence=confidence))
    assert whole.shape == cut.shape
    # The upper left corner of the bar, and the lower one.
    left = LEFT + 17 * whole_zoom(RAMP.shape) + 12
    bottom = whole.shape[0] - MARGIN
    assert whole[TOP + 2, left + 2].min() < 128
    assert cut[TOP + 2, left + 2].tolist() == [255, 255, 255]
    assert cut[bottom - 3, left + 2].min() < 128


@pytest.mark.parametrize("top", [0.1, -3e4])
@pytest.mark.parametrize("with_truth", [True, False])
def test_labels_of_a_comparison_stay_inside_the_figure(top, with_truth):
    values = np.linspace(0.0, top, 600).reshape(20, 30)
    truth = values if with_truth else None
    image = pixels(comparison_figure(np.zeros((20, 30, 3)), values, truth))
    assert (image[:, -6:] == 255).all()


@pytest.mark.parametrize(("size", "with_truth"), [((40, 50), False), ((700, 650), True)])
def test_comparison_shows_the_centre_view_first(size, with_truth):
    centre = np.full((*size, 3), (200, 100, 50), np.uint8)
    values = np.random.default_rng(0).random(size)
    image = pixels(comparison_figure(centre, values, values + 0.1 if with_truth else None))
    assert image[TOP + 20, LEFT + 20].tolist() == [200, 100, 50]


def test_equal_maps_give_equal_bytes_and_no_trace_of_the_software(tmp_path):
    for name in ("one.png", "other.png"):
        save(disparity_figure(RAMP), tmp_path / name)
    one, other = ((tmp_path / name).read_bytes() for name in ("one.png", "other.png"))
    assert one == other
    assert b"tEXt" not in one
    assert b"atplotlib" not in one


def test_drawing_touches_no_global_state():
    before = dict(matplotlib.rcParams)
    pixels(comparison_figure(np.zeros((9, 9, 3)), np.eye(9), np.eye(9)))
    assert dict(matplotlib.rcParams) == before
    from matplotlib import _pylab_helpers

    assert _pylab_helpers.Gcf.get_all_fig_managers() == []


def test_small_occlusion_can_be_seen():
    occlusion = np.zeros((3, 3, 10, 14))
    occlusion[..., 5:] = 0.02
    figure = occlusion_figure(occlusion)
    zoom = whole_zoom((30, 42), 650)
    image = pixels(figure)
    assert image[TOP + 5, LEFT + 2 * zoom].max() == 0
    assert image[TOP + 5, LEFT + 10 * zoom].min() == 255
    assert figure.axes[1].get_ylim() == (0.0, 0.02)


COLOUR_IMAGE, VIEW = np.zeros((12, 17, 3)), np.zeros((12, 17, 1))
MISFITS = [
    (lambda: disparity_figure(COLOUR_IMAGE), r"disparity must be \[H, W\], not \[12, 17, 3\]"),
    (lambda: disparity_picture(COLOUR_IMAGE, limits=(0.0, 1.0)), r"disparity must be \[H, W\]"),
    (lambda: disparity_picture(RAMP, confidence=RAMP.T), r"confidence must be \[12, 17\] like the"),
    (lambda: depth_figure(COLOUR_IMAGE), r"depth must be \[H, W\]"),
    (lambda: confidence_figure(COLOUR_IMAGE), r"confidence must be \[H, W\]"),
    (lambda: confidence_picture(RAMP[0]), r"confidence must be \[H, W\], not \[17\]"),
    (lambda: error_figure(RAMP, RAMP[:1]), r"ground truth must be \[12, 17\] .*, not \[1, 17\]"),
    (lambda: error_picture(COLOUR_IMAGE, COLOUR_IMAGE), r"disparity must be \[H, W\]"),
    (lambda: occlusion_figure(RAMP), r"occlusion must be \[V, U, H, W\], not \[12, 17\]"),
    (lambda: comparison_figure(VIEW[1:], RAMP), r"centre view must be \[12, 17\] like the disp"),
    (lambda: comparison_figure(VIEW, RAMP, RAMP[:1]), "ground truth must be"),
    (lambda: comparison_figure(VIEW, RAMP, hidden=RAMP[:1] > 0), "hidden must be"),
    (lambda: view_picture(RAMP), r"view must be \[H, W, C\] with C of 1 or 3, not \[12, 17\]"),
    (lambda: save_picture(RAMP, "ramp.png"), r"must be \[H, W, 3\] uint8, not \[12, 17\] float"),
]


@pytest.mark.parametrize(("draw", "message"), MISFITS)
def test_arrays_of_another_shape_are_refused_not_broadcast(draw, message):
    with pytest.raises(InputError, match=message):
        draw()
