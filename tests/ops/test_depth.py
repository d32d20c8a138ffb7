"""Depth and places in space, against the published formula and by projecting back."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax import ops
from occjax.lightfield import Calibration
from tests.ops.derivatives import assert_derivatives

CAMERA = Calibration(
    focal_length_mm=100.0, sensor_size_mm=35.0, baseline_mm=50.0, focus_distance_m=7.2
)
DISPARITY = np.random.default_rng(0).uniform(-0.08, 0.075, (4, 6)).astype(np.float32)
"""Of a scene of 3.6 m to 32 m, whose infinitely distant points have -0.119."""

depth_from_disparity = jax.jit(ops.depth_from_disparity, static_argnums=1)
disparity_from_depth = jax.jit(ops.disparity_from_depth, static_argnums=1)
back_project = jax.jit(ops.back_project, static_argnums=1)


def published_depth(disparity):
    """``beta * f_d / (d * f_d * sensor + beta)``, in the units of ``parameters.cfg``."""
    beta = 50.0 * 100.0 * 6
    focus_mm = 7200.0
    depth = [beta * focus_mm / (float(d) * focus_mm * 35.0 + beta) for d in disparity.ravel()]
    return np.reshape(depth, disparity.shape) / 1000.0


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_depth_is_that_of_the_published_formula(dtype, tolerance, x64):
    disparity = DISPARITY.astype(dtype)
    depth = depth_from_disparity(disparity, CAMERA)
    assert depth.dtype == dtype
    np.testing.assert_allclose(depth, published_depth(disparity), **tolerance(dtype))
    np.testing.assert_allclose(depth, CAMERA.depth(disparity, (4, 6)), **tolerance(dtype))


def test_a_portrait_has_the_depth_of_the_landscape(tolerance):
    """The focal length in pixels follows the longer side."""
    upright = depth_from_disparity(DISPARITY.T, CAMERA)
    lying = depth_from_disparity(DISPARITY, CAMERA)
    np.testing.assert_allclose(upright, np.asarray(lying).T, **tolerance("float32"))


def test_disparity_comes_back(tolerance):
    again = disparity_from_depth(depth_from_disparity(DISPARITY, CAMERA), CAMERA)
    assert DISPARITY.min() < -0.05 < 0.05 < DISPARITY.max()
    np.testing.assert_allclose(again, DISPARITY, **tolerance("float32"))


def test_beyond_the_disparity_of_infinity_depth_is_infinite():
    """Infinitely distant points have -f b / focus = -(100 / 35 * 3) * 0.05 / 7.2."""
    at_infinity = -(100.0 / 35.0 * 3) * 0.05 / 7.2
    disparity = np.float32([[at_infinity - 1e-6, -100.0, np.nan]])
    depth = np.asarray(depth_from_disparity(disparity, CAMERA))
    assert np.isposinf(depth[0, :2]).all()
    assert np.isnan(depth[0, 2])
    back = disparity_from_depth(np.float32([[np.inf, np.inf, np.inf]]), CAMERA)
    np.testing.assert_allclose(back, at_infinity, rtol=1e-6)


def test_impossible_depth_has_no_disparity_and_no_place():
    depth = np.float32([[0.0, -1.0, np.nan]])
    assert np.isnan(disparity_from_depth(depth, CAMERA)).all()
    assert np.isnan(back_project(depth, CAMERA)).all()
    assert np.isnan(back_project(np.float32([[np.inf]]), CAMERA)).all()


def test_points_project_onto_the_pixels_they_come_from(tolerance):
    depth = np.random.default_rng(1).uniform(0.5, 20.0, (4, 6)).astype(np.float32)
    points = np.asarray(back_project(depth, CAMERA), np.float64)
    focal_length = 100.0 / 35.0 * 6
    for y, x in np.ndindex(4, 6):
        right, up, towards_viewer = points[y, x]
        assert -towards_viewer == pytest.approx(depth[y, x])
        assert 2.5 + focal_length * right / -towards_viewer == pytest.approx(x, abs=1e-5)
        assert 1.5 - focal_length * up / -towards_viewer == pytest.approx(y, abs=1e-5)


@pytest.mark.parametrize("function", ["depth_from_disparity", "disparity_from_depth"])
def test_maps_are_vmapped_like_one_by_one(function, tolerance):
    maps = np.stack([DISPARITY, 0.5 * DISPARITY]) + np.float32(0.1)  # positive: depths too
    one = jax.jit(getattr(ops, function), static_argnums=1)
    batch = jax.vmap(lambda each: one(each, CAMERA))(maps)
    expected = [one(each, CAMERA) for each in maps]
    np.testing.assert_allclose(batch, np.stack(expected), **tolerance("float32"))


def test_derivatives_agree(x64):
    assert_derivatives(lambda d: ops.depth_from_disparity(d, CAMERA), DISPARITY)
    depth = 1.0 + np.abs(DISPARITY)
    assert_derivatives(lambda z: ops.disparity_from_depth(z, CAMERA), depth)
    assert_derivatives(lambda z: ops.back_project(z, CAMERA), depth)


def test_gradients_are_finite_where_there_is_no_value():
    def total(values, function):
        result = function(values, CAMERA)
        return jnp.where(jnp.isfinite(result), result, 0.0).sum()

    distant = jax.grad(total)(jnp.array([[0.0, -100.0]]), ops.depth_from_disparity)
    assert distant[0, 1] == 0.0
    # dZ/dd = -Z^2 / (f b) at the focus: f = 100 / 35 * 2.
    np.testing.assert_allclose(distant[0, 0], -(7.2**2) / (100 / 35 * 2 * 0.05), rtol=1e-5)
    for function in (ops.disparity_from_depth, ops.back_project):
        gradient = jax.grad(total)(jnp.array([[1.0, 0.0, -1.0]]), function)
        assert np.isfinite(gradient).all()
        assert gradient[0, 0] != 0.0
        assert gradient[0, 1:].tolist() == [0.0, 0.0]
