"""Refocused images of the viewer."""

import numpy as np
import pytest

from occjax.lightfield import LightField
from occjax.viewer.config import ViewerConfig
from occjax.viewer.refocusing import LiveRefocuser
from tests.scenes import plane


@pytest.fixture(scope="module")
def refocuser():
    return LiveRefocuser(
        plane(grid=(3, 3), size=(24, 32), disparity=0.5), ViewerConfig(frame_seconds=10.0)
    )


def test_a_plane_is_sharp_at_its_disparity_and_blurred_elsewhere(refocuser):
    centre = plane(grid=(3, 3), size=(24, 32), disparity=0.5).centre
    error = [
        np.abs(refocuser.image(disparity, 4.0) / 255 - centre)[2:-2, 2:-2].mean()
        for disparity in (0.5, 3.0)
    ]
    assert error[0] < 0.02 < 0.1 < error[1]


def test_the_smallest_aperture_is_the_centre_view(refocuser, tolerance):
    centre = plane(grid=(3, 3), size=(24, 32), disparity=0.5).centre
    np.testing.assert_allclose(refocuser.image(2.0, 0.0) / 255, centre, **tolerance("8 bit"))
    assert refocuser.largest_aperture == pytest.approx(8**0.5)


def test_the_border_is_not_darkened_by_pixels_outside_the_views():
    flat = LightField(np.full((3, 3, 16, 20, 3), 200, np.uint8))
    image = LiveRefocuser(flat, ViewerConfig(frame_seconds=1.0)).image(1.5, 4.0)
    assert (image == 200).all()


def test_a_preview_averages_fewer_views_if_time_is_short(tolerance):
    views = np.zeros((3, 3, 8, 8, 1), np.float32)
    views[0, 0] = 0.9  # one of nine views
    usable = np.ones((3, 3), bool)
    refocuser = LiveRefocuser(LightField(views, usable=usable), ViewerConfig(frame_seconds=0.0))
    full, preview = (refocuser.image(0.0, 4.0, preview=flag).mean() / 255 for flag in (False, True))
    np.testing.assert_allclose(full, 0.1, **tolerance("8 bit"))
    np.testing.assert_allclose(preview, 0.9 / 4, **tolerance("8 bit"))
