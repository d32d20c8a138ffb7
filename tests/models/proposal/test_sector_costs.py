"""Costs of disparity maps by sector, against NumPy loops and on a slanted plane."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.errors import InputError
from occjax.lightfield import view_offsets
from occjax.models.proposal.sector_costs import (
    SectorCosts,
    geman_mcclure,
    refined_costs,
    refined_sector_costs,
    sector_means,
)
from tests.reference import sectors as reference
from tests.scenes import plane

ARRANGEMENTS = {
    "grid": view_offsets(3, 3),
    "row": view_offsets(1, 4),
    "even": view_offsets(2, 2),
    "irregular": np.float32([[[-1.2, -0.8], [0.3, 1.1], [0.0, 0.0], [0.9, -0.4], [0.2, 2.0]]]),
}


def absolute(differences):
    return [jnp.abs(difference) for difference in differences]


def means_of_first(costs):
    return sector_means(SectorCosts(costs.sums[0], costs.weights))


@pytest.mark.parametrize("name", ARRANGEMENTS)
def test_costs_are_sums_over_the_views_of_each_sector(name, uniform, tolerance):
    offsets = ARRANGEMENTS[name]
    features, disparities = uniform(*offsets.shape[:2], 6, 7, 2), uniform(3, 6, 7, seed=1) - 0.5

    @jax.jit
    def costs_of(features, disparities):
        def penalties(differences):
            return geman_mcclure(differences[0], 0.1), jnp.abs(differences[1])

        return refined_sector_costs(
            features, disparities, penalties=penalties, offsets=jnp.asarray(offsets)
        )

    costs = costs_of(features, disparities)
    sums, weights = reference.refined_sector_costs(
        *map(np.asarray, (features, disparities, offsets)),
        lambda difference: [1 / (1 + (0.1 / (difference[0] + 1e-30)) ** 2), abs(difference[1])],
    )
    np.testing.assert_allclose(costs.sums, sums, **tolerance("float32"))
    np.testing.assert_array_equal(costs.weights, weights)
    total, count = refined_costs(
        [features[..., :1], features[..., 1:]],
        disparities,
        penalties=absolute,
        offsets=jnp.asarray(offsets),
    )
    sums, weights = reference.refined_sector_costs(
        *map(np.asarray, (features, disparities, offsets)), np.abs
    )
    np.testing.assert_allclose(total, sums.sum(1), **tolerance("float32"))
    np.testing.assert_array_equal(count, weights.sum(0))


def test_half_precision_pairs_equal_single_precision(uniform, tolerance):
    disparities = uniform(3, 6, 7, seed=1) - 0.5
    half = uniform(3, 3, 6, 7, 2).astype(jnp.float16)

    def total(disparities, features):
        costs = refined_sector_costs(features, disparities, penalties=absolute)
        return costs.sums.sum(), costs

    def values_and_derivative(features):
        (_, costs), gradient = jax.value_and_grad(total, has_aux=True)(disparities, features)
        return costs.sums, costs.weights, gradient

    packed, plain = map(values_and_derivative, (half, half.astype(jnp.float32)))
    for one, other in zip(packed, plain, strict=True):
        np.testing.assert_allclose(one, other, **tolerance("float32"))


def test_means_are_those_of_sectors_aperture_and_best_half(uniform):
    costs = SectorCosts(uniform(8, 3, 5, 6), 1.0 + uniform(8, 3, 5, 6, seed=1))
    expected = reference.sector_means(*map(np.asarray, costs))
    for found, truth in zip(sector_means(costs), expected, strict=True):
        # The mean over the aperture enters each sector with the weight of a thousandth of a view.
        np.testing.assert_allclose(found, truth, atol=2e-3)


def test_sector_without_views_has_the_mean_of_the_aperture(uniform, tolerance):
    costs = refined_sector_costs(uniform(1, 5, 9, 9, 1), jnp.zeros((1, 9, 9)), penalties=absolute)
    means = means_of_first(costs)
    assert costs.weights[2].max() == 0  # a row has no views below
    np.testing.assert_allclose(means.sectors[2], means.aperture, **tolerance("relative"))


def test_costs_are_least_at_the_true_disparity_of_a_slanted_plane():
    scene = plane(grid=(5, 5), size=(32, 40), disparity=-0.4, slope=(0.004, 0.01))
    views, truth = jnp.asarray(scene.grey()), jnp.asarray(scene.ground_truth)
    errors = jnp.linspace(-0.2, 0.2, 9)
    costs = refined_sector_costs(
        views[..., None],
        truth[None] + errors[:, None, None],
        penalties=lambda differences: [jnp.square(differences[0])],
    )
    best = errors[means_of_first(costs).aperture.argmin(0)]
    assert np.quantile(jnp.abs(best)[4:-4, 4:-4], 0.8) < 0.051


def test_single_view_is_refused():
    with pytest.raises(InputError, match="one view has no disparity"):
        refined_sector_costs(jnp.zeros((1, 1, 4, 4, 1)), jnp.zeros((1, 4, 4)), penalties=absolute)
