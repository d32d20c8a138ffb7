"""Semi-global aggregation against a NumPy loop, its symmetry, and its purpose."""

from functools import partial

import jax
import jax.numpy as jnp
import jax.test_util
import numpy as np
import pytest

from occjax.models.proposal.semi_global import semi_global
from tests.reference import matching as reference

PENALTIES = {"small_penalty": 0.2, "large_penalty": 0.5, "guide_scale": 0.1}
aggregate = jax.jit(partial(semi_global, **PENALTIES))


@pytest.mark.usefixtures("platform")
@pytest.mark.parametrize("shape", [(4, 5, 6), (3, 1, 5)])
def test_recursion_along_eight_paths(shape, uniform, tolerance):
    costs, guide = uniform(*shape), uniform(*shape[1:], seed=1)
    expected = reference.semi_global(np.asarray(costs), np.asarray(guide), **PENALTIES)
    np.testing.assert_allclose(aggregate(costs, guide), expected, **tolerance("float32"))
    batch = jax.vmap(aggregate)(jnp.stack([costs, costs]), jnp.stack([guide, guide]))
    np.testing.assert_allclose(batch[1], expected, **tolerance("float32"))


def test_reflected_input_gives_the_reflected_result(uniform, tolerance):
    costs, guide = uniform(4, 5, 6), uniform(5, 6, seed=1)
    aggregated = aggregate(costs, guide)
    for flip in (np.s_[:, ::-1, :], np.s_[:, :, ::-1]):
        mirrored = aggregate(costs[flip], guide[flip[1:]])
        np.testing.assert_allclose(mirrored[flip], aggregated, **tolerance("float32"))


def test_disparity_fills_a_flat_region_up_to_the_edge_of_the_guide():
    costs = jnp.full((3, 4, 12), 0.5)
    costs = costs.at[0, :, 0].set(0.0).at[2, :, -1].set(0.0)  # unknown everywhere else
    guide = jnp.repeat(jnp.array([0.0, 1.0]), np.array([4, 8]))[None].repeat(4, 0)
    winner = aggregate(costs, guide).argmin(0)
    np.testing.assert_array_equal(winner, np.repeat([0, 2], [4, 8])[None].repeat(4, 0))


@pytest.mark.slow
@pytest.mark.usefixtures("x64")
def test_derivatives_agree_with_finite_differences(tolerance):
    generator = np.random.default_rng(0)
    arrays = generator.random((3, 4, 5)), generator.random((4, 5))
    jax.test_util.check_grads(
        aggregate, arrays, order=1, modes=("rev",), eps=1e-7, **tolerance("finite difference")
    )
