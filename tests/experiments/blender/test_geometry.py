import numpy as np
import pytest

from experiments.blender.kit.geometry import SENSOR_SIZE_MM, Rig, fit_rig
from occjax.lightfield import Calibration

HEIGHT, WIDTH = 48, 64


def project(point, rig, row_step, column_step):
    """Return row and column of a point in a pinhole camera of the rig with a shifted sensor.

    The point is right, up and forward of the centre camera. Blender documents the sensor shift: the
    image centre is ``shift * sensor`` away from the optical axis.
    """
    right, up = rig.offset(row_step, column_step)
    shift_right, shift_up = rig.sensor_shift(right, up)
    on_sensor_right = rig.focal_length_mm * (point[0] - right) / point[2]
    on_sensor_up = rig.focal_length_mm * (point[1] - up) / point[2]
    pixels_per_mm = max(HEIGHT, WIDTH) / rig.sensor_size_mm
    column = (on_sensor_right - shift_right * rig.sensor_size_mm) * pixels_per_mm
    row = -(on_sensor_up - shift_up * rig.sensor_size_mm) * pixels_per_mm
    return np.array([row, column])


def test_points_move_by_their_disparity_in_the_sign_convention_of_the_library(tolerance):
    rig = Rig(50.0, SENSOR_SIZE_MM, baseline_mm=12.0, focus_distance_m=1.3)
    calibration = Calibration(**rig._asdict())
    rng = np.random.default_rng(0)
    for _ in range(20):
        point = rng.uniform([-0.3, -0.3, 0.7], [0.3, 0.3, 3.0])
        disparity = calibration.disparity(point[2], (HEIGHT, WIDTH))
        centre = project(point, rig, 0, 0)
        for steps in ((-4, 0), (0, 4), (3, -2)):
            expected = centre - disparity * np.array(steps)
            np.testing.assert_allclose(
                project(point, rig, *steps), expected, **tolerance("float64")
            )


@pytest.mark.parametrize("far", [2.5, np.inf])
def test_fitted_rig_spreads_the_depth_over_the_range(far, tolerance):
    depth = np.full((HEIGHT, WIDTH), 1.5)
    depth[0, 0], depth[-1, -1] = 0.8, far
    rig = fit_rig(depth, (-1.25, 1.75), 45.0)
    disparity = Calibration(**rig._asdict()).disparity(depth, depth.shape)
    np.testing.assert_allclose(disparity[0, 0], 1.75, **tolerance("absolute"))
    np.testing.assert_allclose(disparity[-1, -1], -1.25, **tolerance("absolute"))


def test_rig_of_a_single_plane_has_its_disparity_in_range():
    depth = np.full((HEIGHT, WIDTH), 1.5)
    rig = fit_rig(depth, (-1.0, 2.0), 45.0)
    disparity = Calibration(**rig._asdict()).disparity(depth, depth.shape)
    assert (np.abs(disparity) <= 2.0).all()
