"""What the views see at one pixel, and the pictures of it."""

import numpy as np
import pytest

from occjax.lightfield import LightField
from occjax.viewer.drawing import CENTRE, MARK, OCCLUDED, epipolar_picture, patch_picture
from occjax.viewer.pixel import (
    EpipolarImage,
    angular_patch,
    cost_curve,
    epipolar_image,
    patch_occlusion,
    sample_views,
)
from tests.scenes import plane

DISPARITY = 0.5


@pytest.fixture(scope="module")
def light_field():
    return plane(grid=(5, 5), size=(32, 40), disparity=DISPARITY)


def test_views_are_sampled_where_the_convention_says(tolerance):
    y, x = np.mgrid[:20, :24].astype(np.float32)
    ramp = (y + 100.0 * x) / 4000.0  # exact under bilinear interpolation
    light_field = LightField(np.tile(ramp[None, None, ..., None], (3, 3, 1, 1, 1)))
    seen = sample_views(light_field, np.array([9.0]), np.array([11.0]), np.array([1.5]))
    for v, u in np.ndindex(3, 3):
        expected = (9.0 - 1.5 * (v - 1)) + 100.0 * (11.0 - 1.5 * (u - 1))
        np.testing.assert_allclose(seen[v, u, 0, 0] * 4000.0, expected, **tolerance("relative"))


def test_all_views_see_the_same_colour_at_the_true_disparity(light_field):
    patch = angular_patch(light_field, 15, 20, DISPARITY)
    np.testing.assert_allclose(patch, np.broadcast_to(patch[2, 2], patch.shape), atol=0.06)
    assert (
        patch_occlusion(patch).max()
        < patch_occlusion(angular_patch(light_field, 15, 20, DISPARITY + 1.0)).max()
    )


def test_the_cost_is_lowest_at_the_true_disparity(light_field):
    curve = cost_curve(light_field, 15, 20, np.linspace(-2.0, 2.0, 33))
    assert curve.candidates[curve.all_views.argmin()] == pytest.approx(DISPARITY)
    assert (curve.best_part <= curve.all_views + 1e-6).all()


def test_the_best_part_of_the_views_ignores_an_occluder(light_field):
    views = light_field.views.copy()
    views[:, 3:] = 0.0  # the right half of the aperture sees something else
    occluded = LightField(views)
    curve = cost_curve(occluded, 15, 20, np.array([DISPARITY]))
    assert curve.best_part[0] < 0.03 < 0.15 < curve.all_views[0]


@pytest.mark.parametrize(("line", "picked"), [("row", 38), ("column", 2)])
def test_the_epipolar_plane_image_has_one_line_of_pixels_of_each_view(light_field, line, picked):
    epi = epipolar_image(light_field, 2, 38, line, radius_px=4)
    assert epi.first == picked - 4
    length = {"row": 40, "column": 32}[line]
    for view in range(5):
        for index, place in enumerate(range(picked - 4, picked + 5)):
            if not 0 <= place < length:
                assert np.isnan(epi.pixels[view, index]).all()
            elif line == "row":
                np.testing.assert_array_equal(
                    epi.pixels[view, index], light_field.views[2, view, 2, place]
                )
            else:
                np.testing.assert_array_equal(
                    epi.pixels[view, index], light_field.views[view, 2, place, 38]
                )


def test_views_that_are_missing_are_left_out(light_field):
    corner = light_field.around((0, 4))  # rows 4 to 8 and columns 0 to 4 of a 9x9 grid
    epi = epipolar_image(corner, 15, 20, "row", radius_px=4)
    np.testing.assert_array_equal(epi.offsets, np.arange(-4.0, 1.0))
    np.testing.assert_array_equal(epi.pixels, light_field.views[0, :, 15, 16:25])
    patch = angular_patch(corner, 15, 20, DISPARITY)
    assert np.isfinite(patch).all(-1).sum() == 25
    drawn = patch_picture(patch, np.ones((9, 9), bool), width=150)
    assert drawn.shape == (150, 150, 3)
    framed = (drawn == CENTRE).all(-1)
    assert framed[:30, -30:].any()
    assert framed.sum() == framed[:30, -30:].sum()


def test_a_dark_epipolar_plane_image_is_brightened():
    pixels = np.full((3, 9, 3), 0.1, np.float32)
    drawn = epipolar_picture(EpipolarImage(pixels, np.arange(-1.0, 2.0), 0), 4, np.nan)
    assert (drawn == 179).all()


def test_a_dark_angular_patch_is_brightened():
    patch = np.full((3, 3, 1), 0.1, np.float32)
    patch[0, 0] = 0.05
    tiles = patch_picture(patch, np.zeros((3, 3), bool), width=90).reshape(3, 30, 3, 30, 3)
    middles = tiles[:, 15, :, 15]
    assert (middles[0, 0] == 89).all()  # half of 0.7, in 8 bits
    assert (middles[2, 2] == 179).all()


def test_the_slope_line_passes_through_the_point_in_each_view():
    epi = EpipolarImage(np.zeros((5, 81, 3), np.float32), np.arange(-2.0, 3.0), 60)
    drawn = epipolar_picture(epi, 100, -6.0, width=648)  # 8 pixels for each value
    height = drawn.shape[0] // 5
    pink = np.abs(drawn.astype(int) - MARK).sum(-1) < 40
    for view, offset in enumerate(epi.offsets):
        columns = np.flatnonzero(pink[round((view + 0.5) * height)])
        assert columns.mean() / 8.0 == pytest.approx(100 + 6.0 * offset - 60 + 0.5, abs=0.3)
    for row, end in ((0, -2.5), (-1, 2.5)):  # it is straight up to the edges of the picture
        columns = np.flatnonzero(pink[row])
        assert columns.mean() / 8.0 == pytest.approx(100 + 6.0 * end - 60 + 0.5, abs=0.5)
    assert not (np.abs(epipolar_picture(epi, 100, np.nan).astype(int) - MARK).sum(-1) < 40).any()


def test_occluded_views_are_crossed_out_and_the_centre_view_is_framed():
    occluded = np.zeros((3, 3), bool)
    occluded[0, 2] = True
    drawn = patch_picture(np.full((3, 3, 3), 0.5, np.float32), occluded, width=90)
    tiles = drawn.reshape(3, 30, 3, 30, 3).swapaxes(1, 2)
    red = (tiles == OCCLUDED).all(-1).any((2, 3))
    framed = (tiles == CENTRE).all(-1).any((2, 3))
    np.testing.assert_array_equal(red, occluded)
    np.testing.assert_array_equal(framed, np.eye(3)[1][:, None] * np.eye(3)[1] > 0)
