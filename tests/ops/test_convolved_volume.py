"""The convolved coarse volume against loops, against the volume made first, and its work."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax import ops
from occjax.errors import InputError
from occjax.models.volume_convolution import convolve_volume
from tests.reference import ops as reference
from tests.reference.network import convolve

CANDIDATES = jnp.array([-1.3, 0.0, 0.45, 2.0])
FAR = jnp.array([-9.0, -2.5, 7.25])  # further than the image is wide or high

convolved = jax.jit(ops.convolved_coarse_volume, static_argnames=("span", "streamed"))


def random(*shape, seed=0):
    return jnp.asarray(np.random.default_rng(seed).normal(size=shape), jnp.float32)


def case(grid, size, channels=2, results=3):
    features = random(*grid, *size, channels)
    return features, random(3, 3, 3, channels * grid[0] * grid[1], results, seed=1)


@pytest.mark.parametrize(
    ("grid", "size", "candidates"),
    [
        ((3, 3), (5, 4), CANDIDATES),
        ((3, 3), (4, 5), FAR),
        ((1, 4), (3, 5), CANDIDATES),
        ((4, 1), (2, 3), CANDIDATES),
        ((5, 3), (1, 1), CANDIDATES),
        ((3, 3), (3, 4), CANDIDATES[:1]),
    ],
)
@pytest.mark.parametrize("streamed", [False, True])
def test_matches_the_loop(grid, size, candidates, streamed):
    features, kernel = case(grid, size)
    expected = convolve(
        reference.coarse_volume(np.asarray(features), candidates), np.asarray(kernel)
    )
    actual = convolved(features, candidates, kernel, streamed=streamed)
    np.testing.assert_allclose(actual, expected, rtol=1e-5, atol=3e-5)


@pytest.mark.parametrize("span", [None, 3.3, 5.0, 1.0])
def test_strips_are_convolutions_of_some_rows_of_the_volume(span):
    features, kernel = case((3, 3), (19, 4))
    volume = reference.coarse_volume(np.asarray(features), CANDIDATES)

    @jax.jit
    def strip(first):
        rows = (first, 4)
        return ops.convolved_coarse_volume(features, CANDIDATES, kernel, rows=rows, span=span)

    for first in (0, 1, 8, 15):
        expected = convolve(volume[:, first : first + 4], kernel)
        np.testing.assert_allclose(strip(first), expected, rtol=1e-5, atol=3e-5)


def test_far_candidates_that_differ_little_read_far_rows():
    features, kernel = case((5, 5), (23, 5))
    candidates = jnp.array([3.1, 3.35, 3.6])
    volume = reference.coarse_volume(np.asarray(features), candidates)
    for first in (0, 9, 20):
        options = {"rows": (first, 3), "span": 0.5}
        actual = ops.convolved_coarse_volume(features, candidates, kernel, **options)
        expected = convolve(volume[:, first : first + 3], kernel)
        np.testing.assert_allclose(actual, expected, rtol=1e-5, atol=5e-5)


def by_the_volume(features, candidates, kernel):
    return convolve_volume(ops.coarse_volume(features, candidates), kernel)


def test_derivatives_are_those_of_the_volume_convolved():
    features, kernel = case((3, 3), (4, 5))
    arguments = features, CANDIDATES, kernel
    weights = random(4, 4, 5, 3, seed=2)

    def gradients(function):
        total = lambda *each: (weights * function(*each)).sum()  # noqa: E731
        return jax.jit(jax.grad(total, argnums=(0, 1, 2)))(*arguments)

    actual = gradients(partial(ops.convolved_coarse_volume, streamed=True))
    for found, expected in zip(actual, gradients(by_the_volume), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-4)


def test_half_precision_is_summed_in_single():
    features, kernel = case((5, 5), (6, 7), channels=4)
    features, kernel = (
        each.astype(jnp.bfloat16).astype(jnp.float32) for each in (features, kernel)
    )
    expected = convolve(reference.coarse_volume(np.asarray(features), CANDIDATES), kernel)
    features, kernel = features.astype(jnp.bfloat16), kernel.astype(jnp.bfloat16)
    actual = convolved(features, CANDIDATES, kernel)
    assert actual.dtype == jnp.bfloat16
    error = np.abs(np.asarray(actual, np.float64) - expected)
    by_volume = np.asarray(by_the_volume(features, CANDIDATES, kernel), np.float64)
    assert error.mean() < 1.1 * np.abs(by_volume - expected).mean()


def counted(function, grid, candidates, size):
    """Operations that XLA counts in the first layer of the published width."""
    features = jax.ShapeDtypeStruct((*grid, *size, 4), jnp.float32)
    kernel = jax.ShapeDtypeStruct((3, 3, 3, 4 * grid[0] * grid[1], 96), jnp.float32)
    values = jax.ShapeDtypeStruct((candidates,), jnp.float32)
    lowered = jax.jit(function).lower(features, values, kernel)
    assert "while" not in lowered.as_text()  # whose body would count once
    return lowered.cost_analysis()["flops"]


@pytest.mark.parametrize(("candidates", "least"), [(33, 8.5), (9, 4.5)])
def test_work_is_a_fraction_of_that_of_the_volume(candidates, least):
    """Counted with views of 96x80 pixels, of which the frame is a small part."""
    v, u, size, results, channels = 9, 9, (96, 80), 96, 4
    found = counted(ops.convolved_coarse_volume, (v, u), candidates, size)
    assert counted(by_the_volume, (v, u), candidates, size) > least * found
    once = 27 * results * channels * v * u / candidates
    each = 6 * results * u * (v + 1)
    formula = 2 * (once + each) * candidates * size[0] * size[1]
    assert found == pytest.approx(formula, rel=0.25)


def test_what_does_not_fit_is_refused():
    features, kernel = case((3, 3), (4, 5))
    with pytest.raises(InputError, match=r"kernel must be \[3, 3, 3, 18, k\], not \[3, 3, 3, 17"):
        ops.convolved_coarse_volume(features, CANDIDATES, kernel[:, :, :, :17])
