"""Filters against NumPy loops, at edges, and their gradients."""

import math

import jax
import jax.numpy as jnp
import jax.test_util
import numpy as np
import pytest

from occjax.models.proposal import filters
from tests.reference import filtering as reference

box_filter = jax.jit(filters.box_filter, static_argnames="radius")
binomial_filter = jax.jit(filters.binomial_filter)
edge_aware_mean = jax.jit(filters.edge_aware_mean, static_argnames="radius")
fit_planes = jax.jit(filters.fit_planes, static_argnames=("radius", "ridge", "passes"))


@pytest.mark.parametrize("radius", [0, 1, 12])
def test_box_filter_is_the_mean_of_each_window(radius, uniform, tolerance):
    stack = uniform(2, 7, 10)
    expected = [reference.box_filter(np.asarray(image), radius) for image in stack]
    np.testing.assert_allclose(box_filter(stack, radius), expected, **tolerance("float32"))


def test_binomial_filter_has_binomial_weights_in_both_directions(uniform, tolerance):
    stack = uniform(2, 6, 11)
    row = np.array([math.comb(8, k) for k in range(9)]) / 2**8
    padded = np.pad(stack, [(0, 0), (4, 4), (4, 4)], mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (9, 9), axis=(1, 2))
    expected = np.einsum("nyxij,i,j->nyx", windows, row, row)
    np.testing.assert_allclose(binomial_filter(stack), expected, **tolerance("float32"))


def test_binomial_gain_and_correlation_are_those_of_filtered_noise():
    noise = np.random.default_rng(0).normal(0, 1, (400, 500)).astype(np.float32)
    blurred = np.asarray(binomial_filter(jnp.asarray(noise)))
    np.testing.assert_allclose(blurred.std(), filters.BINOMIAL_GAIN, rtol=0.02)
    correlation = (blurred[:, 1:] * blurred[:, :-1]).mean() / np.square(blurred).mean()
    np.testing.assert_allclose(correlation, filters.BINOMIAL_CORRELATION, atol=0.02)


def test_values_are_sampled_at_offsets_with_replicated_borders():
    image = np.arange(20.0, dtype=np.float32).reshape(4, 5)
    offsets = [(0, 0), (-2, 0), (0, 3), (4, -4)]
    result = filters.sample_at_offsets(jnp.asarray(image), offsets)
    for index, (row, column) in enumerate(offsets):
        for y, x in np.ndindex(4, 5):
            expected = image[np.clip(y + row, 0, 3), np.clip(x + column, 0, 4)]
            assert result[index, y, x] == expected


SIZES = pytest.mark.parametrize("size", [(5, 6), (1, 6), (6, 1)])


@pytest.mark.usefixtures("x64", "platform")
@SIZES
def test_edge_aware_mean_weighs_neighbourhoods(size, uniform, tolerance):
    values, guides = (uniform(3, *size).astype(float), uniform(2, *size, seed=2).astype(float))
    means = edge_aware_mean(values, guides, radius=3.0)
    expected = reference.edge_aware_mean(np.asarray(values), np.asarray(guides), 3.0, 2)
    np.testing.assert_allclose(means, expected, **tolerance("float64"))


@pytest.mark.usefixtures("x64", "platform")
@SIZES
def test_fit_planes_solves_weighted_least_squares(size, uniform, tolerance):
    shapes = (size, size, (2, *size))
    values, weights, guides = (
        uniform(*shape, seed=seed).astype(float) for seed, shape in enumerate(shapes)
    )
    fitted = fit_planes(values, 0.1 + weights, guides, radius=3.0, ridge=1e-4)
    expected = reference.fit_planes(
        np.asarray(values), 0.1 + np.asarray(weights), np.asarray(guides), 3.0, 1e-4, 2
    )
    np.testing.assert_allclose(fitted, expected, **tolerance("float64"))


def test_fit_planes_does_not_reach_across_an_edge_of_the_guide(tolerance):
    step = jnp.repeat(jnp.array([0.0, 1.0]), 12)[None].repeat(20, 0)
    fitted = fit_planes(step, jnp.ones_like(step), 20.0 * step[None], radius=8.0)
    np.testing.assert_allclose(fitted, step, **tolerance("float32"))


def smooth(image, guide):
    return fit_planes(filters.box_filter(image, 1), 1.0 + image, guide[None], radius=3.0)


@pytest.mark.usefixtures("x64", "platform")
def test_derivatives_agree_with_finite_differences(tolerance):
    generator = np.random.default_rng(0)
    arrays = jnp.asarray(generator.random((4, 5))), jnp.asarray(generator.random((4, 5)))
    jax.test_util.check_grads(
        jax.jit(smooth), arrays, order=1, modes=("rev",), eps=1e-6, **tolerance("finite difference")
    )
