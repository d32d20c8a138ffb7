"""Pictures of another focus, from light fields with missing, dark and displaced views."""

import dataclasses

import numpy as np
import pytest

from occjax.lightfield import LightField, view_offsets
from occjax.viz.pictures import view_picture
from occjax.viz.refocusing import Refocuser, sweep_path
from tests.scenes import plane

INSIDE = np.s_[4:-4, 4:-4]


@pytest.fixture(scope="module")
def wall():
    """A plane of disparity 2: shifts by whole pixels need no interpolation."""
    return plane(disparity=2.0)


def difference(picture, light_field):
    return np.abs(picture.astype(int) - view_picture(light_field.centre))[INSIDE].mean()


def test_missing_and_dark_views_are_left_out_and_brightness_is_equalised(wall):
    views = wall.views.copy()
    views[0, 0] = np.random.default_rng(0).random(views[0, 0].shape)  # garbage, but missing
    views[2, 2] = 0.0
    views[0, 1] *= 0.6
    usable = np.ones((3, 3), bool)
    usable[0, 0] = False
    refocuser = Refocuser(dataclasses.replace(wall, views=views, usable=usable))
    assert difference(refocuser.image(2.0), wall) < 1.5
    assert np.argwhere(~refocuser.light_field.usable).tolist() == [[0, 0], [2, 2]]
    np.testing.assert_array_equal(views[2, 2], 0.0)  # the user's views are unchanged


def test_the_aperture_and_the_positions_of_the_cameras_are_used(wall):
    # Views taken at half of the distance have twice the disparity per view step.
    half = dataclasses.replace(wall, positions=view_offsets(3, 3) / 2)
    refocuser = Refocuser(half)
    assert difference(refocuser.image(4.0), wall) < 1.0
    assert difference(refocuser.image(2.0), wall) > 10.0
    assert difference(refocuser.image(2.0, aperture=0.0), wall) == 0.0
    assert difference(refocuser.all_in_focus(np.full((40, 48), 4.0)), wall) < 1.0


def test_a_sweep_goes_around_the_centre_or_along_a_row_and_back():
    grid = LightField(np.zeros((3, 3, 8, 8), np.uint8))
    circle = [(1, 2), (2, 2), (2, 1), (2, 0), (1, 0), (0, 0), (0, 1), (0, 2)]
    assert sweep_path(grid, "circle") == circle
    assert sweep_path(grid, "row") == [(1, 2), (1, 1), (1, 0), (1, 1)]
    assert sweep_path(grid, "column") == [(2, 1), (1, 1), (0, 1), (1, 1)]
    usable = np.ones((3, 3), bool)
    usable[2] = False
    assert not any(
        v == 2 for v, _ in sweep_path(dataclasses.replace(grid, usable=usable), "circle")
    )
    assert sweep_path(LightField(np.zeros((1, 1, 8, 8), np.uint8)), "circle") == [(0, 0)]
