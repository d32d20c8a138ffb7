"""Points, colours, camera and picking of the cloud."""

import numpy as np
import pytest

from occjax.errors import InputError
from occjax.lightfield import Calibration, LightField
from occjax.viewer import ViewedResult, ViewedScene
from occjax.viewer.cloud import (
    cloud_points,
    first_camera,
    legend,
    modes,
    pick_point,
    picture,
    pixel_size,
)

CAMERA = Calibration(50.0, 35.0, baseline_mm=80.0, focus_distance_m=2.0)
RAMP = np.linspace(-1.0, 1.0, 20 * 30, dtype=np.float32).reshape(20, 30)


def scene(*maps, **fields):
    results = tuple(ViewedResult(f"map {number}", one) for number, one in enumerate(maps))
    return ViewedScene(results, **fields)


@pytest.mark.parametrize("calibration", [None, CAMERA])
def test_the_first_camera_sees_each_point_where_its_pixel_is(calibration, tolerance):
    points = cloud_points(RAMP, calibration, disparity_range=(-1.0, 1.0))
    camera = first_camera(points, calibration)
    relative = (points - camera.position).reshape(-1, 3)
    right, up, ahead = relative[:, 0], relative[:, 1], -relative[:, 2]
    assert ahead.min() > 0.0
    assert np.arctan(np.abs([right, up]).max(0) / ahead).max() < camera.field_of_view / 2
    column, row = right / ahead, -up / ahead
    # To the right and downwards, as in the image.
    assert (np.diff(column.reshape(20, 30), axis=1) > 0).all()
    assert (np.diff(row.reshape(20, 30), axis=0) > 0).all()
    if calibration is not None:
        f = 50.0 / 35.0 * 30
        found = column.reshape(20, 30)[0] * f
        np.testing.assert_allclose(found, np.arange(30) - 14.5, **tolerance("relative"))
        np.testing.assert_allclose(pixel_size(points, calibration) * f, np.percentile(ahead, 75))


def test_nearer_points_of_a_relief_are_in_front_and_missing_ones_are_left_out():
    disparity = np.array([[-1.0, 1.0, np.nan]])
    points = cloud_points(disparity, None, disparity_range=(-1.0, 1.0), relief_depth=0.5)
    np.testing.assert_allclose(points[0, :2, 2], [-0.75, 0.75])
    assert np.isnan(points[0, 2]).all()


def test_colours_that_need_views_truth_or_a_second_result_are_not_offered():
    assert modes(scene(RAMP)) == ("disparity",)
    views = LightField(np.zeros((1, 3, 20, 30, 3), np.uint8), ground_truth=RAMP)
    both = scene(RAMP, RAMP, light_field=views)
    assert modes(both) == ("image", "disparity", "error", "difference")
    assert legend(both, 0, "image") is None
    assert legend(both, 0, "disparity").high == pytest.approx(1.0)


def test_the_difference_is_red_where_a_result_is_nearer_and_blue_where_it_is_farther():
    shown = picture(scene(RAMP + np.float32(0.3), RAMP), 0, "difference")
    assert (shown[..., 0] > shown[..., 2]).all()
    shown = picture(scene(RAMP, RAMP + np.float32(0.3)), 0, "difference")
    assert (shown[..., 0] < shown[..., 2]).all()
    # Neither of the two is the truth, so nothing is "too" near.
    label = legend(scene(RAMP, RAMP), 0, "difference").label
    assert label == "disparity minus map 1 (red is nearer than there)"


def test_results_share_the_range_of_the_disparity_colours():
    two = scene(RAMP, RAMP + np.float32(1.0))
    first, second = picture(two, 0, "disparity"), picture(two, 1, "disparity")
    np.testing.assert_array_equal(first[-1, -1], second[9, 29])  # both have disparity 1
    assert legend(two, 0, "disparity").low == pytest.approx(-1.0)
    assert legend(two, 0, "disparity").high == pytest.approx(2.0)


def test_the_cursor_picks_the_front_point_and_nothing_beside_the_cloud():
    points = cloud_points(RAMP, None, disparity_range=(-1.0, 1.0)).reshape(-1, 3)
    origin = np.array([0.0, 0.0, 60.0])
    for index in (0, 137, 599):
        assert pick_point(points, origin, points[index] - origin) == index
    behind = 2.0 * points - origin  # on the same lines of sight, twice as far away
    both = np.concatenate([behind, points])
    assert pick_point(both, origin, points[137] - origin) == 600 + 137
    assert pick_point(points, origin, np.array([0.0, 1.0, 0.0])) is None
    assert pick_point(points[:0], origin, np.array([0.0, 0.0, -1.0])) is None


def test_maps_and_views_of_different_size_are_refused():
    with pytest.raises(InputError, match="results of one scene"):
        scene(RAMP, RAMP[1:])
    with pytest.raises(InputError, match="pass the scene that was estimated"):
        scene(RAMP, light_field=LightField(np.zeros((1, 3, 20, 31, 3), np.uint8)))
