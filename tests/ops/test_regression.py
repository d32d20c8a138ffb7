import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax import ops
from tests.ops.derivatives import assert_derivatives
from tests.reference import ops as reference

SHAPE = (5, 3, 4)

soft_argmin = jax.jit(ops.soft_argmin)
expected_disparity = jax.jit(ops.expected_disparity)
confidence = jax.jit(ops.confidence)


def random(*shape, seed=0, low=-3.0, high=3.0):
    return np.random.default_rng(seed).uniform(low, high, shape).astype(np.float32)


COSTS = random(*SHAPE)
PROBABILITIES = reference.softmax_of_negative(COSTS).astype(np.float32)
CANDIDATES = {
    "shared": np.array([-2.0, -0.5, 0.1, 1.0, 2.5], np.float32),
    "per pixel": random(*SHAPE, seed=1),
}
candidates = pytest.mark.parametrize("candidates", CANDIDATES.values(), ids=CANDIDATES)


def one_hot(chosen):
    probabilities = np.zeros(SHAPE, np.float32)
    probabilities[chosen] = 1.0
    return probabilities


@candidates
def test_regression_matches_the_loop(candidates, tolerance):
    probabilities = reference.softmax_of_negative(COSTS)
    mean, deviation, entropy = reference.moments_and_entropy(probabilities, candidates)
    tolerances = tolerance("float32")
    np.testing.assert_allclose(soft_argmin(COSTS, candidates), mean, **tolerances)
    np.testing.assert_allclose(expected_disparity(PROBABILITIES, candidates), mean, **tolerances)
    actual = confidence(PROBABILITIES, candidates)
    np.testing.assert_allclose(actual.standard_deviation, deviation, **tolerances)
    np.testing.assert_allclose(actual.entropy, entropy, **tolerances)


def test_the_lowest_cost_is_chosen():
    costs = np.full(SHAPE, 1e4, np.float32)
    costs[3] = -1e4
    disparity = soft_argmin(costs, CANDIDATES["shared"])
    np.testing.assert_array_equal(disparity, np.full(SHAPE[1:], 1.0))


@candidates
def test_a_constant_added_to_all_costs_changes_nothing(candidates, tolerance):
    moved = soft_argmin(COSTS + np.float32(100.0), candidates)
    # 100 takes seven of float32's 24 bits from the costs
    np.testing.assert_allclose(moved, soft_argmin(COSTS, candidates), rtol=1e-4, atol=1e-4)


def test_moving_and_stretching_the_candidates_moves_and_stretches_the_answer(tolerance):
    shared, tolerances = CANDIDATES["shared"], tolerance("float32")
    moved = 2 * shared + np.float32(0.7)
    disparity = soft_argmin(COSTS, shared)
    np.testing.assert_allclose(soft_argmin(COSTS, moved), 2 * disparity + 0.7, **tolerances)
    before, after = confidence(PROBABILITIES, shared), confidence(PROBABILITIES, moved)
    np.testing.assert_allclose(
        after.standard_deviation, 2 * before.standard_deviation, **tolerances
    )
    np.testing.assert_array_equal(after.entropy, before.entropy)


def test_certainty_and_ignorance():
    """One candidate certain: no spread, no entropy. All alike: log(5) nats, spread of a uniform."""
    shared = CANDIDATES["shared"]
    certain = confidence(one_hot(2), shared)
    assert not np.any(certain.standard_deviation)
    assert not np.any(certain.entropy)
    np.testing.assert_array_equal(certain.certainty(5), 1.0)
    uniform = confidence(np.full(SHAPE, 0.2, np.float32), shared)
    np.testing.assert_allclose(uniform.standard_deviation, shared.std(), rtol=1e-5)
    np.testing.assert_allclose(uniform.entropy, math.log(5), rtol=1e-6)
    np.testing.assert_allclose(uniform.certainty(5), 0.0, atol=1e-6)


def test_half_of_the_candidates_alike_is_the_certainty_of_their_number():
    probabilities = np.zeros((4, 1, 1), np.float32)
    probabilities[:2] = 0.5
    between = ops.confidence(jnp.asarray(probabilities), jnp.arange(4.0))
    np.testing.assert_allclose(between.certainty(4), 0.5, rtol=1e-6)  # 1 - log 2 / log 4
    np.testing.assert_allclose(between.standard_deviation, 0.5, rtol=1e-6)


def test_a_single_candidate_is_certain():
    only = ops.confidence(jnp.ones((1, 2, 2)), jnp.array([0.3]))
    np.testing.assert_array_equal(only.certainty(1), 1.0)
    np.testing.assert_array_equal(only.standard_deviation, 0.0)


@pytest.mark.parametrize("rounding", [1e-7, -1e-7])
def test_rounding_of_the_entropy_does_not_take_certainty_out_of_its_range(rounding):
    entropy = jnp.array([[-abs(rounding), math.log(3) * (1.0 + rounding)]])
    certainty = ops.Confidence(entropy, entropy).certainty(3)
    assert np.all((certainty >= 0.0) & (certainty <= 1.0))


def test_candidates_are_data_not_part_of_the_compiled_program(tolerance):
    traces = []

    @jax.jit
    def regress(costs, candidates):
        traces.append(candidates)
        return ops.soft_argmin(costs, candidates)

    for shared in (CANDIDATES["shared"], CANDIDATES["shared"][::-1] * np.float32(3.0)):
        expected, _, _ = reference.moments_and_entropy(reference.softmax_of_negative(COSTS), shared)
        np.testing.assert_allclose(regress(COSTS, shared), expected, **tolerance("float32"))
    assert len(traces) == 1


@pytest.mark.parametrize("dtype", ["float32", "bfloat16", "float64"])
def test_every_dtype_matches_the_loop_and_answers_in_at_least_single_precision(dtype, tolerance):
    """A bfloat16 volume too: rounding the candidates to it would cost 0.01 pixel."""
    answer = "float64" if dtype == "float64" else "float32"
    with jax.enable_x64(dtype == "float64"):
        costs, shared = jnp.asarray(COSTS, dtype), jnp.asarray(CANDIDATES["shared"])
        exact = reference.softmax_of_negative(np.asarray(costs, np.float64))
        probabilities = jnp.asarray(exact, dtype)
        expected = (
            reference.moments_and_entropy(exact, CANDIDATES["shared"])[0],
            *reference.moments_and_entropy(np.float64(probabilities), CANDIDATES["shared"]),
        )
        actual = (
            soft_argmin(costs, shared),
            expected_disparity(probabilities, shared),
            *confidence(probabilities, shared),
        )
        for answered, wanted in zip(actual, expected, strict=True):
            assert answered.dtype == answer
            np.testing.assert_allclose(answered, wanted, **tolerance(answer))


def test_vmap_is_a_loop_over_volumes(tolerance):
    costs = np.stack([COSTS, -COSTS])
    probabilities = np.stack([PROBABILITIES, PROBABILITIES[::-1]])
    shared = CANDIDATES["shared"]
    disparities = jax.jit(jax.vmap(ops.soft_argmin, in_axes=(0, None)))(costs, shared)
    spreads = jax.jit(jax.vmap(ops.confidence, in_axes=(0, None)))(probabilities, shared)
    for k in range(2):
        one = soft_argmin(costs[k], shared)
        np.testing.assert_allclose(disparities[k], one, **tolerance("float32"))
        for actual, expected in zip(spreads, confidence(probabilities[k], shared), strict=True):
            np.testing.assert_allclose(actual[k], expected, **tolerance("float32"))


def test_compiled_and_not_are_the_same(tolerance):
    costs, shared = jnp.asarray(COSTS), jnp.asarray(CANDIDATES["shared"])
    compiled = soft_argmin(costs, shared)
    np.testing.assert_allclose(ops.soft_argmin(costs, shared), compiled, **tolerance("float32"))


@pytest.mark.usefixtures("x64")
class TestDerivatives:
    @candidates
    def test_soft_argmin(self, candidates):
        assert_derivatives(ops.soft_argmin, COSTS, candidates)

    @candidates
    def test_confidence(self, candidates):
        def stacked(probabilities, candidates):
            return jnp.stack(ops.confidence(probabilities, candidates))

        assert_derivatives(stacked, PROBABILITIES, candidates)


def test_derivative_of_soft_argmin_in_closed_form(tolerance):
    """``-p_k * (candidate_k - disparity)``: raising a cost pushes the answer away from it."""
    shared = CANDIDATES["shared"]
    gradient = jax.jit(jax.grad(lambda costs: ops.soft_argmin(costs, jnp.asarray(shared)).sum()))
    probabilities = reference.softmax_of_negative(COSTS)
    mean, _, _ = reference.moments_and_entropy(probabilities, shared)
    expected = -probabilities * (shared[:, None, None] - mean)
    np.testing.assert_allclose(gradient(COSTS), expected, **tolerance("float32"))


@pytest.mark.parametrize(
    "probabilities",
    [one_hot(0), one_hot(4), np.full(SHAPE, 0.2), one_hot(1) + 1e-40 * one_hot(2), 0 * one_hot(0)],
    ids=["first", "last", "uniform", "denormal", "none"],
)
def test_gradients_are_finite_for_exact_zeros_and_ones(probabilities):
    def total(probabilities, candidates):
        return sum(each.sum() for each in ops.confidence(probabilities, candidates))

    gradients = jax.jit(jax.grad(total, argnums=(0, 1)))(
        probabilities.astype(np.float32), CANDIDATES["shared"]
    )
    assert all(np.all(np.isfinite(gradient)) for gradient in gradients)


@pytest.mark.parametrize("gap", [0.0, 50.0, 95.0, 1e3, 1e30])
def test_gradients_through_softmax_are_finite_however_sure_it_is(gap):
    """Around 95 the second probability is a denormal number; further on it is exactly zero."""

    def total(costs, candidates):
        probabilities = jax.nn.softmax(-costs, axis=0)
        return sum(each.sum() for each in ops.confidence(probabilities, candidates))

    costs = np.float32(gap) * (1 - one_hot(2))
    gradients = jax.jit(jax.grad(total, argnums=(0, 1)))(costs, CANDIDATES["shared"])
    assert all(np.all(np.isfinite(gradient)) for gradient in gradients)


@pytest.mark.parametrize("own", [False, True])
def test_probability_near_sums_what_is_within_reach(own, tolerance):
    generator = np.random.default_rng(0)
    probabilities = generator.dirichlet(np.ones(6), (4, 5)).transpose(2, 0, 1)
    candidates = generator.uniform(-1, 1, (6, 4, 5) if own else 6)
    disparity = generator.uniform(-1, 1, (4, 5))
    found = ops.probability_near(
        *(jnp.asarray(each, jnp.float32) for each in (probabilities, candidates, disparity)), 0.4
    )
    expected = np.zeros((4, 5))
    for k, y, x in np.ndindex(6, 4, 5):
        value = candidates[k, y, x] if own else candidates[k]
        if abs(value - disparity[y, x]) <= 0.4:
            expected[y, x] += probabilities[k, y, x]
    np.testing.assert_allclose(found, expected, **tolerance("float32"))
    assert 0 < expected.max() < 1
