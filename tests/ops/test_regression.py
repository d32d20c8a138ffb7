"""Regression and confidence against NumPy loops, closed forms, and their derivatives."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax import ops
from tests.ops.arrays import random
from tests.ops.derivatives import assert_derivatives
from tests.reference import ops as reference

SHAPE = (5, 3, 4)

soft_argmin = jax.jit(ops.soft_argmin)
expected_disparity = jax.jit(ops.expected_disparity)
confidence = jax.jit(ops.confidence)

COSTS = random(*SHAPE, low=-3.0, high=3.0)
PROBABILITIES = reference.softmax_of_negative(COSTS).astype(np.float32)
SHARED = np.array([-2.0, -0.5, 0.1, 1.0, 2.5], np.float32)
CANDIDATES = {"shared": SHARED, "per pixel": random(*SHAPE, seed=1, low=-3.0, high=3.0)}
candidates = pytest.mark.parametrize("candidates", CANDIDATES.values(), ids=CANDIDATES)


def one_hot(chosen):
    probabilities = np.zeros(SHAPE, np.float32)
    probabilities[chosen] = 1.0
    return probabilities


@candidates
def test_regression_matches_loop(candidates, tolerance):
    probabilities = reference.softmax_of_negative(COSTS)
    mean, deviation, entropy = reference.moments_and_entropy(probabilities, candidates)
    tolerances = tolerance("float32")
    np.testing.assert_allclose(soft_argmin(COSTS, candidates), mean, **tolerances)
    np.testing.assert_allclose(expected_disparity(PROBABILITIES, candidates), mean, **tolerances)
    actual = confidence(PROBABILITIES, candidates)
    np.testing.assert_allclose(actual.standard_deviation, deviation, **tolerances)
    np.testing.assert_allclose(actual.entropy, entropy, **tolerances)


def test_lowest_cost_is_selected_without_overflow():
    costs = np.full(SHAPE, 1e4, np.float32)
    costs[3] = -1e4
    np.testing.assert_array_equal(soft_argmin(costs, SHARED), np.full(SHAPE[1:], 1.0))


@candidates
def test_constant_added_to_all_costs_changes_nothing(candidates, tolerance):
    moved = soft_argmin(COSTS + np.float32(100.0), candidates)
    # 100 takes seven of float32's 24 bits from the costs
    np.testing.assert_allclose(moved, soft_argmin(COSTS, candidates), **tolerance("float32"))


@pytest.mark.parametrize("vertex", [-0.95, -0.3, 0.0, 0.45, 0.9])
def test_winner_takes_all_finds_the_vertex_of_a_parabola(vertex, tolerance):
    evenly = jnp.linspace(-1.0, 1.0, 9)
    costs = jnp.square(evenly - vertex)[:, None, None] + jnp.zeros((9, 2, 3))
    found = jax.jit(ops.winner_takes_all)(costs, evenly)
    np.testing.assert_allclose(found, np.full((2, 3), vertex), **tolerance("float32"))


def test_winner_takes_all_of_costs_without_curvature_is_the_candidate():
    costs = jnp.array([1.0, 0.0, 0.0, 0.0, 1.0])[:, None, None]
    gradient = jax.grad(lambda c: ops.winner_takes_all(c, jnp.arange(5.0)).sum())(costs)
    assert np.isfinite(gradient).all()
    assert ops.winner_takes_all(jnp.ones((5, 1, 1)), jnp.arange(5.0)).tolist() == [[1.0]]


def test_certain_and_uniform_probabilities(tolerance):
    """One certain candidate: no spread, no entropy. All equal: log(5) nats."""
    certain = confidence(one_hot(2), SHARED)
    assert not np.any(certain.standard_deviation)
    assert not np.any(certain.entropy)
    np.testing.assert_array_equal(certain.certainty(5), 1.0)
    uniform = confidence(np.full(SHAPE, 0.2, np.float32), SHARED)
    np.testing.assert_allclose(uniform.standard_deviation, SHARED.std(), **tolerance("relative"))
    np.testing.assert_allclose(uniform.entropy, math.log(5), **tolerance("relative"))
    np.testing.assert_allclose(uniform.certainty(5), 0.0, **tolerance("absolute"))
    half = ops.confidence(jnp.array([0.5, 0.5, 0.0, 0.0])[:, None, None], jnp.arange(4.0))
    np.testing.assert_allclose(half.certainty(4), 0.5, **tolerance("relative"))  # 1 - log 2 / log 4
    single = ops.confidence(jnp.ones((1, 2, 2)), jnp.array([0.3]))
    np.testing.assert_array_equal(single.certainty(1), 1.0)


@pytest.mark.parametrize("rounding", [1e-7, -1e-7])
def test_rounding_of_the_entropy_keeps_certainty_in_range(rounding):
    entropy = jnp.array([[-abs(rounding), math.log(3) * (1.0 + rounding)]])
    certainty = ops.Confidence(entropy, entropy).certainty(3)
    assert np.all((certainty >= 0.0) & (certainty <= 1.0))


@pytest.mark.parametrize("dtype", ["bfloat16", "float64"])
def test_dtype_of_the_result_is_at_least_single_precision(dtype, tolerance):
    """Rounding the candidates to bfloat16 would cost 0.01 pixel."""
    result = "float64" if dtype == "float64" else "float32"
    with jax.enable_x64(dtype == "float64"):
        costs = jnp.asarray(COSTS, dtype)
        exact = reference.softmax_of_negative(np.asarray(costs, np.float64))
        probabilities = jnp.asarray(exact, dtype)
        expected = (
            reference.moments_and_entropy(exact, SHARED)[0],
            *reference.moments_and_entropy(np.float64(probabilities), SHARED),
        )
        actual = (
            soft_argmin(costs, SHARED),
            expected_disparity(probabilities, SHARED),
            *confidence(probabilities, SHARED),
        )
        for found, loop in zip(actual, expected, strict=True):
            assert found.dtype == result
            np.testing.assert_allclose(found, loop, **tolerance(result))


@pytest.mark.usefixtures("x64")
@candidates
def test_derivatives(candidates):
    def stacked(probabilities, candidates):
        return jnp.stack(ops.confidence(probabilities, candidates))

    assert_derivatives(ops.soft_argmin, COSTS, candidates)
    assert_derivatives(stacked, PROBABILITIES, candidates)


@pytest.mark.usefixtures("x64")
def test_derivatives_of_winner_takes_all():
    costs = np.square(np.arange(5.0)[:, None, None] - random(1, 3, 4, low=1.1, high=1.4))
    assert_derivatives(lambda c: ops.winner_takes_all(c, jnp.arange(5.0)), costs)


def test_derivative_of_soft_argmin_in_closed_form(tolerance):
    """``-p_k * (candidate_k - disparity)``: raising a cost pushes the result away from it."""
    gradient = jax.jit(jax.grad(lambda costs: ops.soft_argmin(costs, jnp.asarray(SHARED)).sum()))
    probabilities = reference.softmax_of_negative(COSTS)
    mean, _, _ = reference.moments_and_entropy(probabilities, SHARED)
    expected = -probabilities * (SHARED[:, None, None] - mean)
    np.testing.assert_allclose(gradient(COSTS), expected, **tolerance("float32"))


@pytest.mark.parametrize(
    "probabilities",
    [one_hot(0), np.full(SHAPE, 0.2), one_hot(1) + 1e-40 * one_hot(2), 0 * one_hot(0)],
    ids=["certain", "uniform", "denormal", "none"],
)
def test_gradients_are_finite_for_exact_zeros_and_ones(probabilities):
    def total(probabilities, candidates):
        return sum(each.sum() for each in ops.confidence(probabilities, candidates))

    gradients = jax.jit(jax.grad(total, argnums=(0, 1)))(probabilities.astype(np.float32), SHARED)
    assert all(np.all(np.isfinite(gradient)) for gradient in gradients)


@pytest.mark.parametrize("gap", [0.0, 95.0, 1e30])
def test_gradients_through_softmax_are_finite(gap):
    """For a gap of 95 the second probability is a denormal number; beyond, it is zero."""

    def total(costs, candidates):
        probabilities = jax.nn.softmax(-costs, axis=0)
        return sum(each.sum() for each in ops.confidence(probabilities, candidates))

    costs = np.float32(gap) * (1 - one_hot(2))
    gradients = jax.jit(jax.grad(total, argnums=(0, 1)))(costs, SHARED)
    assert all(np.all(np.isfinite(gradient)) for gradient in gradients)
