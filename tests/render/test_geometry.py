import numpy as np
import pytest

from occjax.lightfield import Calibration
from occjax.render.blender.geometry import SENSOR_SIZE_MM, Rig, fit_rig
from occjax.render.folder import disparity_from_depth

HEIGHT, WIDTH = 48, 64


def project(point, rig, row_step, column_step):
    """Row and column at which a camera of the rig sees a point: a pinhole and a shifted sensor.

    The point is given as right, up and forward of the centre camera. The sensor's shift is what
    Blender documents: the picture's middle looks ``shift * sensor`` beside the axis.
    """
    right, up = rig.offset(row_step, column_step)
    shift_right, shift_up = rig.sensor_shift(right, up)
    on_sensor_right = rig.focal_length_mm * (point[0] - right) / point[2]
    on_sensor_up = rig.focal_length_mm * (point[1] - up) / point[2]
    pixels_per_mm = max(HEIGHT, WIDTH) / rig.sensor_size_mm
    column = (on_sensor_right - shift_right * rig.sensor_size_mm) * pixels_per_mm
    row = -(on_sensor_up - shift_up * rig.sensor_size_mm) * pixels_per_mm
    return np.array([row, column])


def test_points_move_by_their_disparity_in_the_sign_of_the_library():
    rig = Rig(50.0, SENSOR_SIZE_MM, baseline_mm=12.0, focus_distance_m=1.3)
    calibration = Calibration(**rig._asdict())
    rng = np.random.default_rng(0)
    for _ in range(20):
        point = rng.uniform([-0.3, -0.3, 0.7], [0.3, 0.3, 3.0])
        depth = np.full((HEIGHT, WIDTH), point[2])
        disparity = float(disparity_from_depth(depth, calibration)[0, 0])
        centre = project(point, rig, 0, 0)
        for steps in ((-4, 0), (0, 4), (3, -2)):
            expected = centre - disparity * np.array(steps)
            np.testing.assert_allclose(project(point, rig, *steps), expected, atol=1e-4)


def test_disparity_is_the_inverse_of_the_depth_of_the_benchmark():
    calibration = Calibration(100.0, 35.0, baseline_mm=50.0, focus_distance_m=7.2)
    depth = np.random.default_rng(1).uniform(5.0, 20.0, (HEIGHT, WIDTH))
    disparity = disparity_from_depth(depth, calibration)
    np.testing.assert_allclose(calibration.depth(disparity, depth.shape), depth, rtol=1e-5)


@pytest.mark.parametrize("far", [2.5, np.inf])
def test_fitted_rig_spreads_the_depth_over_the_range(far):
    depth = np.full((HEIGHT, WIDTH), 1.5)
    depth[0, 0], depth[-1, -1] = 0.8, far
    disparity = disparity_from_depth(
        depth, Calibration(**fit_rig(depth, (-1.25, 1.75), 45.0)._asdict())
    )
    np.testing.assert_allclose(disparity[0, 0], 1.75, atol=1e-5)
    np.testing.assert_allclose(disparity[-1, -1], -1.25, atol=1e-5)


def test_picture_of_one_plane_gets_a_rig_with_its_disparity_in_range():
    depth = np.full((HEIGHT, WIDTH), 1.5)
    rig = fit_rig(depth, (-1.0, 2.0), 45.0)
    disparity = disparity_from_depth(depth, Calibration(**rig._asdict()))
    assert (np.abs(disparity) <= 2.0).all()
