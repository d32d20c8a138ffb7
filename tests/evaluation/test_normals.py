"""Errors of normals, on planes whose normals are known."""

import numpy as np
import pytest

from occjax.errors import InputError
from occjax.evaluation import angular_errors
from occjax.lightfield import Calibration

CAMERA = Calibration(100.0, 35.0, baseline_mm=50.0, focus_distance_m=7.0)
SIZE = (40, 48)


def rays():
    """Direction in which each pixel looks, by the pinhole camera: right, down, forward."""
    pixel = 35.0 / 48.0  # millimetres of the sensor
    directions = np.empty((*SIZE, 3))
    for y in range(SIZE[0]):
        for x in range(SIZE[1]):
            directions[y, x] = ((x - 23.5) * pixel / 100.0, (y - 19.5) * pixel / 100.0, 1.0)
    return directions


def plane(normal, distance=7.0):
    """Disparity of the plane with this normal through a point straight ahead.

    Two cameras 50 mm apart with parallel axes see a point at depth z shifted by f b / z; what is at
    the focus of 7 m is not shifted.
    """
    depth = distance * normal[2] / (rays() @ normal)
    focal_length_pixels = 100.0 / 35.0 * 48.0
    return focal_length_pixels * 0.050 * (1.0 / depth - 1.0 / 7.0)


def tilted(about_x, about_y):
    """Normal of a wall that is turned by two angles, in degrees."""
    a, b = np.radians([about_x, about_y])
    return np.array([np.sin(b) * np.cos(a), np.sin(a), -np.cos(b) * np.cos(a)])


@pytest.mark.parametrize("turn", [3.0, 40.0, 0.001])
def test_a_plane_that_is_turned_too_far_is_off_by_that_angle(turn, tolerance):
    truth, estimate = plane(tilted(0.0, 20.0)), plane(tilted(0.0, 20.0 + turn))
    errors = angular_errors(estimate, truth, CAMERA)
    assert errors.shape == (10 * 18,)
    np.testing.assert_allclose(errors, turn, **tolerance("absolute"))


def test_a_wall_at_another_distance_faces_the_same_way(tolerance):
    errors = angular_errors(plane(tilted(10.0, 5.0), 6.0), plane(tilted(10.0, 5.0), 8.0), CAMERA)
    np.testing.assert_allclose(errors, 0.0, **tolerance("absolute"))


def test_only_the_region_counts(tolerance):
    truth = plane(tilted(0.0, 0.0))
    estimate = truth.copy()
    estimate[:, 24:] = plane(tilted(0.0, 30.0))[:, 24:]
    region = np.zeros(SIZE, bool)
    region[:, 26:] = True  # beyond the differences across the seam
    np.testing.assert_allclose(
        angular_errors(estimate, truth, CAMERA, mask=region), 30.0, **tolerance("absolute")
    )


def test_no_estimate_and_one_beyond_infinity_are_edge_on_and_no_truth_does_not_count(tolerance):
    truth = plane(tilted(0.0, 0.0))
    wrong = truth.copy()
    wrong[20, 20] = np.nan
    wrong[20, 30] = -1e3  # further than infinitely far
    errors = angular_errors(wrong, truth, CAMERA)
    # Those two alone: a neighbour of theirs has one on its other side.
    assert np.sum(errors == 90.0) == 2
    np.testing.assert_allclose(errors[errors != 90.0], 0.0, **tolerance("absolute"))
    assert angular_errors(truth, wrong, CAMERA).size == errors.size - 2


def test_the_end_of_a_surface_does_not_hide_a_step_of_the_estimate(tolerance):
    truth = plane(tilted(0.0, 0.0))
    estimate = truth.copy()
    estimate[:, 24:] = plane(tilted(0.0, 0.0), 6.0)[:, 24:]
    errors = angular_errors(estimate, truth, CAMERA).reshape(10, 18)
    # Column 15 is the first; differences reach one pixel to both sides of the step.
    np.testing.assert_array_equal((errors > 45.0).all(0), np.isin(np.arange(15, 33), (23, 24)))
    np.testing.assert_allclose(np.delete(errors, (8, 9), axis=1), 0.0, **tolerance("absolute"))


def test_maps_that_cannot_be_compared_are_refused():
    truth = plane(tilted(0.0, 0.0))
    with pytest.raises(InputError, match="same scene and resolution"):
        angular_errors(truth[1:], truth, CAMERA)
    with pytest.raises(InputError, match="at least 2 pixels in each direction"):
        angular_errors(np.zeros((1, 9)), np.zeros((1, 9)), CAMERA, border=0)
