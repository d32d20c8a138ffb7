"""Comparison of the maps of different views with the closed form of two fronto-parallel planes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import TypeCheckError

from occjax.errors import InputError
from occjax.ops import cross_view_counts, cross_view_difference
from tests.scenes import two_plane_maps

FAR, NEAR = 0, 2
SIZE = 24


def test_two_planes_agree_except_where_the_near_one_hides_the_far_one():
    """Seen from one view to the right, the square has moved 2 columns to the left."""
    maps = jnp.asarray(two_plane_maps())
    difference = np.asarray(cross_view_difference(maps[1, 1], maps[1, 2], np.array([0.0, 1.0])))
    expected = np.zeros((SIZE, SIZE))
    expected[8:16, 6:8] = NEAR - FAR
    np.testing.assert_array_equal(difference, expected)


def test_points_outside_of_the_other_image_have_no_difference():
    flat = jnp.full((SIZE, SIZE), float(NEAR))
    outside = np.isnan(cross_view_difference(flat, flat, np.array([0.0, 1.0])))
    assert outside[:, :NEAR].all()
    assert not outside[:, NEAR:].any()


def test_counts_of_a_wrong_patch_are_those_of_pixels_compared_one_by_one():
    maps = two_plane_maps()
    maps[1, 1, 1:4, 1:4] = 1.0  # nearer than what the other views see there: they conflict
    usable = np.ones((3, 3), bool)
    usable[0, 0] = False
    counts = cross_view_counts(jnp.asarray(maps), tolerance=0.1, radius=1, usable=usable)
    agreeing, conflicting = np.zeros((2, SIZE, SIZE), int)
    for y, x in np.ndindex(SIZE, SIZE):
        d = int(maps[1, 1, y, x])
        for v, u in np.argwhere(usable):
            row, column = y - d * (v - 1), x - d * (u - 1)
            if (v, u) == (1, 1) or not (0 <= row < SIZE and 0 <= column < SIZE):
                continue
            agreeing[y, x] += maps[v, u, row, column] == d
            conflicting[y, x] += maps[v, u, row, column] < d
    np.testing.assert_array_equal(counts.agreeing[1, 1], agreeing)
    np.testing.assert_array_equal(counts.conflicting[1, 1], conflicting)
    consistency = np.asarray(counts.consistency[1, 1])
    assert (consistency[1:4, 1:4] == 0).all()
    assert consistency[10, 10] == 1


def test_the_gradient_is_that_of_finite_differences(tolerance):
    generator = np.random.default_rng(0)
    maps = generator.uniform(0.2, 0.8, (2, 6, 7))
    offset = np.array([0.3, -0.4])

    def loss(disparity):
        difference = cross_view_difference(disparity, jnp.asarray(maps[1]), offset)
        return jnp.nansum(difference**2)

    with jax.enable_x64(True):
        gradient = np.asarray(jax.grad(loss)(jnp.asarray(maps[0])))
        step = np.zeros((6, 7))
        step[3, 3] = 1e-6
        numeric = (loss(jnp.asarray(maps[0] + step)) - loss(jnp.asarray(maps[0] - step))) / 2e-6
    np.testing.assert_allclose(gradient[3, 3], float(numeric), **tolerance("finite difference"))


def test_maps_of_another_shape_are_refused():
    with pytest.raises((InputError, TypeCheckError)):  # annotations are checked in tests
        cross_view_difference(jnp.zeros((3, 4)), jnp.zeros((4, 4)), np.zeros(2))
    with pytest.raises((InputError, TypeCheckError)):
        cross_view_counts(jnp.zeros((3, 4)), tolerance=0.1)
