"""Fast bilinear reads against the plain warp."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax import ops
from occjax.kernels.bilinear import (
    displaced_plane,
    inside_view,
    pack_pairs,
    warp_packed_pair,
    warp_plane,
)
from occjax.kernels.padding import pad_borders
from tests.ops.arrays import random

OFFSET = jnp.array([1.0, -1.3])


@pytest.mark.parametrize("size", [(6, 7), (1, 5), (5, 1), (1, 1)])
def test_fast_reads_are_warps(size, tolerance):
    images, disparity = random(*size, 2), random(*size, seed=1, low=-4.0, high=4.0)
    images = images.astype(np.float16).astype(np.float32)  # exact in a packed pair
    expected = jax.jit(ops.warp)(images, disparity, OFFSET)
    plane = jax.jit(warp_plane)(images[..., 0], disparity, OFFSET)
    np.testing.assert_allclose(plane, expected[..., 0], **tolerance("float32"))
    pairs = pack_pairs(jnp.asarray(images, jnp.float16))
    both = jax.jit(warp_packed_pair)(pairs, disparity, OFFSET)
    np.testing.assert_allclose(jnp.stack(both, -1), expected, **tolerance("float32"))


@pytest.mark.parametrize("disparity", [0.0, 1.0, -0.7, 2.4, 60.0])
def test_displaced_planes_are_warps_by_one_disparity(disparity, tolerance):
    images, margin = random(6, 7, 2), 7
    planes = jnp.moveaxis(jnp.asarray(images), -1, 0)
    padded = pad_borders(planes, (margin, margin + 1), (margin, margin + 1))
    expected = jax.jit(ops.warp)(images, jnp.full((6, 7), disparity), OFFSET)
    for plane in (0, 1):
        read = displaced_plane(padded, (plane,), -disparity * OFFSET, margin)
        np.testing.assert_allclose(read, expected[..., plane], **tolerance("float32"))


def test_derivatives_in_the_disparity_are_those_of_the_warp(tolerance):
    images, disparity = random(6, 7, 2), random(6, 7, seed=1, low=-4.0, high=4.0)
    images = images.astype(np.float16).astype(np.float32)
    pairs = pack_pairs(jnp.asarray(images, jnp.float16))

    def gradient(function):
        return jax.jit(jax.grad(lambda d: jnp.sin(function(d)).sum()))(disparity)

    expected = gradient(lambda d: ops.warp(jnp.asarray(images), d, OFFSET))
    found = gradient(lambda d: jnp.stack(warp_packed_pair(pairs, d, OFFSET)))
    np.testing.assert_allclose(found, expected, **tolerance("float32"))
    expected = gradient(lambda d: ops.warp(jnp.asarray(images[..., :1]), d, OFFSET))
    found = gradient(lambda d: warp_plane(jnp.asarray(images[..., 0]), d, OFFSET))
    np.testing.assert_allclose(found, expected, **tolerance("float32"))


def test_points_inside_a_view_are_those_between_its_outer_pixels():
    """Disparity 1 moves columns by -1.3 * -1 = 1.3 to the right and rows by 1 up."""
    expected = np.zeros((4, 5), bool)
    expected[1:, :3] = True  # columns 0 to 2 are at 1.3 to 3.3; 3 is at 4.3, outside of 0 to 4
    np.testing.assert_array_equal(inside_view(jnp.ones((4, 5)), OFFSET), expected)
