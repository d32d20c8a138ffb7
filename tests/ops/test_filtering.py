"""The filters against NumPy loops and what they promise about edges and gradients."""

import math

import jax
import jax.numpy as jnp
import jax.test_util
import numpy as np
import pytest

from occjax.ops import filtering
from tests.reference import filtering as reference

box_filter = jax.jit(filtering.box_filter, static_argnames="radius")
fit_planes = jax.jit(filtering.fit_planes, static_argnames=("radius", "ridge", "passes"))


def _random(*shape, seed=0):
    return jnp.asarray(np.random.default_rng(seed).random(shape, np.float32))


@pytest.mark.parametrize("radius", [0, 1, 12])
def test_box_filter_is_the_mean_of_each_window(radius, tolerance):
    image = _random(7, 10)
    expected = reference.box_filter(np.asarray(image), radius)
    np.testing.assert_allclose(box_filter(image, radius), expected, **tolerance("float32"))


def test_box_filter_treats_stacked_maps_one_by_one(tolerance):
    stack = _random(2, 3, 5, 6)
    expected = np.stack(
        [[reference.box_filter(image, 2) for image in row] for row in np.asarray(stack)]
    )
    np.testing.assert_allclose(box_filter(stack, 2), expected, **tolerance("float32"))


def test_binomial_filter_is_pascals_triangle_in_both_directions(tolerance):
    stack = _random(2, 6, 11)
    row = np.array([math.comb(8, k) for k in range(9)]) / 2**8
    padded = np.pad(stack, [(0, 0), (4, 4), (4, 4)], mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (9, 9), axis=(1, 2))
    expected = np.einsum("nyxij,i,j->nyx", windows, row, row)
    np.testing.assert_allclose(filtering.binomial_filter(stack), expected, **tolerance("float32"))


def test_binomial_filter_leaves_as_much_noise_as_it_says():
    noise = np.random.default_rng(0).normal(0, 1, (400, 500)).astype(np.float32)
    blurred = np.asarray(filtering.binomial_filter(jnp.asarray(noise)))
    np.testing.assert_allclose(blurred.std(), filtering.BINOMIAL_GAIN, rtol=0.02)
    beside = (blurred[:, 1:] * blurred[:, :-1]).mean() / np.square(blurred).mean()
    np.testing.assert_allclose(beside, filtering.BINOMIAL_CORRELATION, atol=0.02)


@pytest.mark.usefixtures("x64", "platform")
@pytest.mark.parametrize("size", [(5, 6), (1, 6), (6, 1)])
def test_edge_aware_mean_weighs_the_same_neighbourhoods(size):
    values, guides = _random(3, *size), _random(2, *size, seed=2)
    arguments = [array.astype(jnp.float64) for array in (values, guides)]
    means = filtering.edge_aware_mean(*arguments, radius=3.0)
    expected = reference.edge_aware_mean(*map(np.asarray, arguments), 3.0, 2)
    np.testing.assert_allclose(means, expected, atol=1e-12)


@pytest.mark.usefixtures("x64", "platform")
@pytest.mark.parametrize("passes", [1, 2])
def test_fit_planes_solves_the_weighted_least_squares_of_each_neighbourhood(passes):
    values, weights = _random(5, 6), 0.1 + _random(5, 6, seed=1)
    guides = _random(2, 5, 6, seed=2)
    arguments = [array.astype(jnp.float64) for array in (values, weights, guides)]
    fitted = fit_planes(*arguments, radius=3.0, ridge=1e-4, passes=passes)
    expected = reference.fit_planes(*map(np.asarray, arguments), 3.0, 1e-4, passes)
    np.testing.assert_allclose(fitted, expected, atol=1e-9)


def test_fit_planes_keeps_a_plane_whose_weights_lie_unevenly():
    y, x = np.mgrid[:20, :24]
    plane = jnp.asarray(2.0 + 0.05 * x - 0.03 * y, jnp.float32)
    weights = jnp.asarray(np.where((x + 3 * y) % 11 == 0, 1.0, 1e-3), jnp.float32)
    fitted = fit_planes(plane, weights, jnp.zeros((1, 20, 24)), radius=8.0, ridge=1e-6)
    np.testing.assert_allclose(fitted, plane, atol=2e-3)


@pytest.mark.usefixtures("platform")
@pytest.mark.parametrize("size", [(1, 6), (6, 1), (1, 1)])
def test_fit_planes_of_a_single_row_or_column(size):
    values, weights = _random(*size), 0.1 + _random(*size, seed=1)
    guides = _random(1, *size, seed=2)
    fitted = fit_planes(values, weights, guides, radius=3.0, ridge=1e-2)
    expected = reference.fit_planes(*map(np.asarray, (values, weights, guides)), 3.0, 1e-2, 2)
    np.testing.assert_allclose(fitted, expected, atol=1e-4)


def test_fit_planes_does_not_reach_across_an_edge_of_the_guide():
    step = jnp.repeat(jnp.array([0.0, 1.0]), 12)[None].repeat(20, 0)
    fitted = fit_planes(step, jnp.ones_like(step), 20.0 * step[None], radius=8.0)
    np.testing.assert_allclose(fitted, step, atol=1e-4)


@pytest.mark.usefixtures("x64", "platform")
def test_derivatives_agree_with_finite_differences():
    rng = np.random.default_rng(0)
    arrays = rng.random((4, 5)), rng.random((4, 5))

    @jax.jit
    def smooth(image, guide):
        image, guide = jnp.asarray(image), jnp.asarray(guide)
        local = box_filter(image, 1)
        return fit_planes(local, 1.0 + image, guide[None], radius=3.0)

    jax.test_util.check_grads(
        smooth, arrays, order=1, modes=("rev",), atol=1e-5, rtol=1e-5, eps=1e-6
    )


def test_vmap_agrees_with_a_loop(tolerance):
    images, guides = _random(2, 4, 5), _random(2, 4, 5, seed=1)

    @jax.jit
    def smooth(image, guide):
        local = box_filter(image, 1)
        return fit_planes(local, 1.0 + image, guide[None], radius=3.0)

    looped = [smooth(image, guide) for image, guide in zip(images, guides, strict=True)]
    np.testing.assert_allclose(
        jax.vmap(smooth)(images, guides), np.stack(looped), **tolerance("float32")
    )


def test_neighbours_are_the_values_that_far_away_with_replicated_borders():
    image = np.arange(20.0, dtype=np.float32).reshape(4, 5)
    places = [(0, 0), (-2, 0), (0, 3), (4, -4)]
    result = filtering.neighbours(jnp.asarray(image), places)
    for index, (row, column) in enumerate(places):
        for y, x in np.ndindex(4, 5):
            expected = image[np.clip(y + row, 0, 3), np.clip(x + column, 0, 4)]
            assert result[index, y, x] == expected
