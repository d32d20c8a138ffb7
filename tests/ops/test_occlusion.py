"""Occlusion maps against NumPy loops and a scene whose occlusions are known."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax import ops
from tests.ops.arrays import random
from tests.ops.derivatives import assert_derivatives
from tests.reference import ops as reference

SHAPE = (3, 3, 4, 5, 2)

occlusion_maps = jax.jit(ops.occlusion_maps, static_argnames="border")

VIEWS = random(*SHAPE, low=0.0)
DISPARITY = random(*SHAPE[2:4], seed=1, low=-2.0, high=2.0)
OFFSETS = reference.view_offsets(3, 3).astype(np.float32) + random(3, 3, 2, seed=2, high=0.2)


@pytest.mark.parametrize("options", [{}, {"offsets": OFFSETS, "border": "zero"}])
def test_maps_match_loop(options, tolerance):
    expected = reference.occlusion_maps(VIEWS, DISPARITY, **options)
    assert expected.max() == 1.0  # the sum of two channels exceeds one somewhere: clipping matters
    actual = occlusion_maps(VIEWS, DISPARITY, **options)
    np.testing.assert_allclose(actual, expected, **tolerance("float32"))


@pytest.mark.parametrize("grid", [(1, 4), (2, 2)])
def test_maps_of_any_regular_grid_match_loop(grid, tolerance):
    views = VIEWS.reshape(-1, *SHAPE[2:])[: grid[0] * grid[1]].reshape(*grid, *SHAPE[2:])
    expected = reference.occlusion_maps(views, DISPARITY)
    np.testing.assert_allclose(occlusion_maps(views, DISPARITY), expected, **tolerance("float32"))


@pytest.mark.parametrize("moves", ["columns", "rows"])
def test_occluder_hides_the_adjacent_background_in_the_views_of_the_other_side(moves):
    """A white half plane of disparity 2 covers the first 5 of 12 columns of a black background.

    In the view one step to the left it covers two columns more: these two are occluded there, and
    nothing is occluded in the view to the right.
    """
    views = np.zeros((1, 3, 3, 12, 1), np.float32)
    for u in range(3):
        views[0, u, :, : 5 - 2 * (u - 1)] = 1.0
    disparity = np.zeros((3, 12), np.float32)
    disparity[:, :5] = 2.0
    expected = np.zeros((1, 3, 3, 12), np.float32)
    expected[0, 0, :, 5:7] = 1.0
    if moves == "rows":
        views, disparity = views.transpose(1, 0, 3, 2, 4), disparity.T
        expected = expected.transpose(1, 0, 3, 2)
    np.testing.assert_array_equal(occlusion_maps(views, disparity), expected)


def test_weights_are_the_squared_visibility():
    maps = jnp.array([0.0, 0.25, 0.5, 1.0])
    np.testing.assert_array_equal(ops.occlusion_weights(maps), [1.0, 0.5625, 0.25, 0.0])


@pytest.mark.parametrize("dtype", ["bfloat16", "float64"])
def test_dtype_is_kept_and_matches_loop(dtype, tolerance):
    with jax.enable_x64(dtype == "float64"):
        views, disparity = jnp.asarray(VIEWS, dtype), jnp.asarray(DISPARITY, dtype)
        maps = occlusion_maps(views, disparity)
        weights = jax.jit(ops.occlusion_weights)(maps)
        loops = np.asarray(views, np.float64), np.asarray(disparity, np.float64)
        expected = reference.occlusion_maps(*loops)
        assert maps.dtype == weights.dtype == dtype
        np.testing.assert_allclose(np.float64(maps), expected, **tolerance(dtype))
        np.testing.assert_allclose(np.float64(weights), (1 - expected) ** 2, **tolerance(dtype))


@pytest.mark.usefixtures("x64")
def test_derivatives():
    def weights(views, disparity, offsets):
        return ops.occlusion_weights(ops.occlusion_maps(views, disparity, offsets=offsets))

    assert_derivatives(weights, 0.4 * VIEWS, DISPARITY, OFFSETS)


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_gradients_are_finite_where_all_views_agree(value):
    """The modulus and the clipping both have their kink there."""

    def total(views, disparity):
        return ops.occlusion_weights(ops.occlusion_maps(views, disparity)).sum()

    arguments = np.full(SHAPE, value, np.float32), np.zeros(SHAPE[2:4], np.float32)
    for gradient in jax.jit(jax.grad(total, argnums=(0, 1)))(*arguments):
        assert np.isfinite(gradient).all()
