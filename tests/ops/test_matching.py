"""Matching costs and semi-global aggregation against NumPy loops, and what they promise."""

from functools import partial

import jax
import jax.numpy as jnp
import jax.test_util
import numpy as np
import pytest

from occjax.errors import InputError
from occjax.ops import filtering, matching, sector_of, view_offsets
from occjax.ops.matching import semi_global
from tests.reference import matching as reference
from tests.scenes import noisy_waves

PENALTIES = {"small_penalty": 0.2, "large_penalty": 0.5, "guide_scale": 0.1}
aperture_costs = jax.jit(matching.aperture_costs, static_argnames=("aperture", "radius"))
aggregate = jax.jit(partial(semi_global, **PENALTIES))
CANDIDATES = jnp.array([-1.3, 0.0, 0.4])
TRUNCATION = jnp.array([0.3, 0.6])


def _random(*shape, seed=0):
    return jnp.asarray(np.random.default_rng(seed).random(shape, np.float32))


@pytest.mark.parametrize(("aperture", "reach"), [("half", 2), ("quarter", 1)])
@pytest.mark.parametrize("grid", [(3, 3), (1, 4)])
def test_aperture_costs_are_the_least_mean_over_the_parts(grid, aperture, reach, tolerance):
    features = _random(*grid, 5, 8, 2)
    costs = aperture_costs(features, CANDIDATES, truncation=TRUNCATION, aperture=aperture, radius=0)
    expected = reference.aperture_costs(*map(np.asarray, (features, CANDIDATES, TRUNCATION)), reach)
    np.testing.assert_allclose(costs, expected, **tolerance("float32"))


@pytest.mark.parametrize("grid", [(3, 3), (1, 4), (2, 2)])
def test_sums_are_over_the_views_of_each_sector(grid, tolerance):
    features = _random(*grid, 5, 8, 2)
    offsets = view_offsets(*grid)
    sums, numbers = matching.sector_sums(
        features, CANDIDATES, truncation=TRUNCATION, combine=lambda *kept: kept
    )
    expected = reference.sector_sums(*map(np.asarray, (features, CANDIDATES, TRUNCATION, offsets)))
    np.testing.assert_allclose(sums, expected, **tolerance("float32"))
    sectors = np.delete(np.asarray(sector_of(offsets)), grid[0] // 2 * grid[1] + grid[1] // 2)
    np.testing.assert_array_equal(numbers[0], np.bincount(sectors, minlength=8))


def test_grey_costs_compare_grey_and_its_derivatives(tolerance):
    """At disparity 0 the views next to the centre one are alike: no noise is found."""
    views = np.array(_random(5, 5, 6, 9))
    views[1:4, 1:4] = views[2, 2]
    candidates = jnp.array([0.0, 0.7])
    costs = matching.grey_costs(
        jnp.asarray(views), candidates, grey_truncation=0.3, derivative_truncation=0.1
    )
    padded = np.pad(views, [(0, 0), (0, 0), (1, 1), (1, 1)], mode="edge")
    down = (padded[..., 2:, 1:-1] - padded[..., :-2, 1:-1]) / 2
    right = (padded[..., 1:-1, 2:] - padded[..., 1:-1, :-2]) / 2
    features = np.stack([views, down, right], axis=-1)
    sums = matching.sector_sums(
        jnp.asarray(features),
        candidates,
        truncation=jnp.array([0.3, 0.1, 0.1]),
        combine=lambda sums, numbers: matching.best_part(matching.box_filter(sums, 1), numbers),
    )
    np.testing.assert_allclose(costs, sums, **tolerance("float32"))


def test_where_noise_hides_the_texture_grey_costs_compare_blurred_grey():
    """Broad shading under noise: where derivatives say nothing, the costs still tell disparity."""
    disparity, deviation = 1.0, 0.03
    views = noisy_waves(deviation, disparity, amplitude=0.05)
    candidates = jnp.linspace(0.0, 2.0, 9)
    costs = matching.grey_costs(
        views, candidates, grey_truncation=0.02, derivative_truncation=0.004
    )
    features = [views, *filtering.central_differences(views)]
    noise = deviation * jnp.array([1.0, 0.5**0.5, 0.5**0.5])
    fine = aperture_costs(
        jnp.stack(features, axis=-1),
        candidates,
        truncation=jnp.hypot(jnp.array([0.02, 0.004, 0.004]), noise),
        noise=noise,
    )

    def right(costs):
        found = candidates[costs.argmin(0)][16:-16, 16:-16]
        return float((jnp.abs(found - disparity) <= 0.25).mean())

    assert right(costs) > 1.5 * right(fine)


def test_noise_favours_no_candidate_of_grey_costs():
    """A blank wall under noise, fine or blurred: each candidate is as good as any other."""
    noise = np.random.default_rng(0).normal(0.5, 0.02, (3, 3, 96, 96)).astype(np.float32)
    costs = matching.grey_costs(
        jnp.asarray(noise),
        jnp.array([0.0, 0.25, 0.5]),
        grey_truncation=0.002,
        derivative_truncation=1.0,
    ).mean((1, 2))
    assert float(jnp.ptp(costs)) < 0.03 * float(costs.mean())
    # At disparity 0: |n_1 - n_2| of blurred noise over a truncation that this noise has widened.
    blurred = 0.02 * filtering.BINOMIAL_GAIN
    draws = np.abs(np.random.default_rng(1).normal(0, np.sqrt(2) * blurred, 100_000))
    expected = np.minimum(draws / np.hypot(0.003, blurred), 1.0).mean()
    np.testing.assert_allclose(costs[0], expected, rtol=0.1)


def test_a_list_of_views_in_any_order_is_as_good_as_their_grid(tolerance):
    features, offsets = _random(3, 3, 6, 7, 2), view_offsets(3, 3)
    order = np.array([8, 1, 2, 3, 4, 0, 6, 7, 5])  # the centre view stays
    shuffled = aperture_costs(
        features.reshape(1, 9, 6, 7, 2)[:, order],
        CANDIDATES,
        truncation=TRUNCATION,
        offsets=offsets.reshape(1, 9, 2)[:, order],
    )
    expected = aperture_costs(features, CANDIDATES, truncation=TRUNCATION)
    np.testing.assert_allclose(shuffled, expected, **tolerance("float32"))


def test_a_point_hidden_from_the_views_of_one_side_still_costs_nothing():
    views = np.zeros((3, 3, 6, 6, 1), np.float32)
    views[:, 2:] = 1.0  # seen by the centre view and those left of it
    costs = aperture_costs(jnp.asarray(views), jnp.zeros(1), truncation=jnp.ones(1))
    assert float(costs.max()) < 1e-6


def test_averaging_over_windows_comes_before_the_choice_of_the_part():
    noise = _random(3, 3, 6, 6, 1)
    truncation = jnp.ones(1)
    rough = aperture_costs(noise, jnp.zeros(1), truncation=truncation, radius=0)
    even = aperture_costs(noise, jnp.zeros(1), truncation=truncation, radius=2)
    assert float(even.mean()) > float(rough.mean())  # noise no longer finds its best part


def test_one_view_alone_is_an_input_error():
    with pytest.raises(InputError, match="at least 1x2"):
        aperture_costs(jnp.zeros((1, 1, 4, 4, 1)), jnp.zeros(3), truncation=jnp.ones(1))


@pytest.mark.usefixtures("platform")
@pytest.mark.parametrize("shape", [(4, 5, 6), (3, 1, 5)])
def test_semi_global_follows_the_recursion_along_eight_paths(shape, tolerance):
    costs, guide = _random(*shape), _random(*shape[1:], seed=1)
    expected = reference.semi_global(np.asarray(costs), np.asarray(guide), **PENALTIES)
    np.testing.assert_allclose(aggregate(costs, guide), expected, **tolerance("float32"))


def test_semi_global_mirrors_with_its_input(tolerance):
    costs, guide = _random(4, 5, 6), _random(5, 6, seed=1)
    aggregated = aggregate(costs, guide)
    for flip in (np.s_[:, ::-1, :], np.s_[:, :, ::-1]):
        mirrored = aggregate(costs[flip], guide[flip[1:]])
        np.testing.assert_allclose(mirrored[flip], aggregated, **tolerance("float32"))


def test_semi_global_carries_disparity_into_a_flat_region_up_to_the_edge_of_the_guide():
    costs = jnp.full((3, 4, 12), 0.5)
    costs = costs.at[0, :, 0].set(0.0).at[2, :, -1].set(0.0)  # all else is unknown
    guide = jnp.repeat(jnp.array([0.0, 1.0]), np.array([4, 8]))[None].repeat(4, 0)
    winner = aggregate(costs, guide).argmin(0)
    np.testing.assert_array_equal(winner, np.repeat([0, 2], [4, 8])[None].repeat(4, 0))


@pytest.mark.usefixtures("x64")
def test_derivatives_of_the_aggregated_costs_agree_with_finite_differences():
    features = np.random.default_rng(0).random((1, 3, 4, 5, 1))
    candidates = np.array([-0.6, 0.1, 0.7])

    @jax.jit
    def aggregated(features, candidates):
        costs = aperture_costs(features, candidates, truncation=jnp.full(1, 2.0))
        return semi_global(costs, features[0, 1, ..., 0], **PENALTIES)

    jax.test_util.check_grads(
        aggregated, (features, candidates), order=1, modes=("rev",), atol=1e-5, rtol=1e-5, eps=1e-7
    )


def test_vmap_agrees_with_a_loop(tolerance):
    costs, guides = _random(2, 4, 5, 6), _random(2, 5, 6, seed=1)
    looped = [aggregate(cost, guide) for cost, guide in zip(costs, guides, strict=True)]
    np.testing.assert_allclose(
        jax.vmap(aggregate)(costs, guides), np.stack(looped), **tolerance("float32")
    )
