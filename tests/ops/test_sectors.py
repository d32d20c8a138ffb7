"""Costs of the aperture's sectors against NumPy loops, and what they promise."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.errors import InputError
from occjax.ops import (
    SectorCosts,
    geman_mcclure,
    refined_sector_costs,
    sector_channels,
    view_offsets,
)
from tests.reference import sectors as reference
from tests.scenes import plane

STAR = jnp.array(
    [
        (t, s)
        for t in (-2, -1, 0, 1, 2)
        for s in (-2, -1, 0, 1, 2)
        if 0 in (t, s) or abs(t) == abs(s)
    ],
    jnp.float32,
)[None]
"""The 17 views on the row, the column and the diagonals of a 5x5 grid, the centre amidst."""


def _random(*shape, seed=0):
    return jnp.asarray(np.random.default_rng(seed).random(shape, np.float32))


def _absolute(differences):
    return [jnp.abs(differences[0])]


def _channels(costs):
    """Of the only measure."""
    return sector_channels(SectorCosts(costs.sums[0], costs.weights))


def _arrangement(name):
    """Offsets [v, u, 2] of a full grid, a row, or a list of views in no order."""
    if name == "star":
        return STAR
    return view_offsets(*{"grid": (3, 3), "row": (1, 4), "even": (2, 2)}[name])


ARRANGEMENTS = pytest.mark.parametrize("name", ["grid", "row", "even", "star"])


@ARRANGEMENTS
def test_costs_are_sums_over_the_views_of_each_sector(name, tolerance):
    offsets = _arrangement(name)
    features, disparities = _random(*offsets.shape[:2], 6, 7, 2), _random(3, 6, 7, seed=1) - 0.5

    @jax.jit
    def costs_of(features, disparities):
        def penalties(differences):
            first, second = differences
            return geman_mcclure(first, 0.1), jnp.abs(second)

        return refined_sector_costs(features, disparities, penalties=penalties, offsets=offsets)

    costs = costs_of(features, disparities)
    sums, weights = reference.refined_sector_costs(
        *map(np.asarray, (features, disparities, offsets)),
        lambda difference: [1 / (1 + (0.1 / (difference[0] + 1e-30)) ** 2), abs(difference[1])],
    )
    np.testing.assert_allclose(costs.sums, sums, **tolerance("float32"))
    np.testing.assert_array_equal(costs.weights, weights)


def test_two_features_of_half_precision_cost_what_they_do_in_single(tolerance):
    features, disparities = _random(1, 17, 6, 7, 2), _random(3, 6, 7, seed=1) - 0.5

    def both(differences):
        return [jnp.abs(difference) for difference in differences]

    def costs_of(features):
        return refined_sector_costs(features, disparities, penalties=both, offsets=STAR)

    half = features.astype(jnp.float16)
    packed, plain = costs_of(half), costs_of(half.astype(jnp.float32))
    np.testing.assert_allclose(packed.sums, plain.sums, **tolerance("float32"))
    np.testing.assert_array_equal(packed.weights, plain.weights)
    of_disparity = jax.grad(
        lambda disparities, features: refined_sector_costs(
            features, disparities, penalties=both, offsets=STAR
        ).sums.sum()
    )
    np.testing.assert_allclose(
        of_disparity(disparities, half),
        of_disparity(disparities, half.astype(jnp.float32)),
        **tolerance("float32"),
    )


@pytest.mark.parametrize("tolerance_", [0.01, 0.3])
def test_the_robust_cost_is_half_at_the_tolerance_and_one_far_beyond(tolerance_):
    costs = geman_mcclure(jnp.array([0.0, tolerance_, -tolerance_, 1e3]), tolerance_)
    np.testing.assert_allclose(costs, [0.0, 0.5, 0.5, 1.0], atol=1e-6)


def test_channels_are_sectors_whole_aperture_and_best_half():
    costs = SectorCosts(_random(8, 3, 5, 6), 1.0 + _random(8, 3, 5, 6, seed=1))
    expected = reference.sector_channels(*map(np.asarray, costs))
    # A thousandth of a view stands for all others where a sector sees nothing.
    np.testing.assert_allclose(sector_channels(costs), expected, atol=2e-3)


def test_a_sector_without_views_has_the_mean_of_the_others():
    costs = refined_sector_costs(_random(1, 5, 9, 9, 1), jnp.zeros((1, 9, 9)), penalties=_absolute)
    channels = _channels(costs)
    assert costs.weights[2].max() == 0  # a row of views has none above or below
    np.testing.assert_allclose(channels[2], channels[8], rtol=1e-5)


def test_a_point_hidden_on_one_side_costs_nothing_in_the_other_half():
    views = (
        jnp.zeros((3, 3, 6, 6)).at[:, 2:].set(1.0)
    )  # seen by the centre view and those left of it
    costs = refined_sector_costs(views[..., None], jnp.zeros((1, 6, 6)), penalties=_absolute)
    whole, best = _channels(costs)[-2:]
    assert whole.min() > 0.3
    assert best.max() < 1e-3


def test_costs_are_least_at_the_true_disparity_of_a_slanted_plane():
    scene = plane(grid=(5, 5), size=(32, 40), disparity=-0.4, slope=(0.004, 0.01))
    views, truth = jnp.asarray(scene.grey()), jnp.asarray(scene.ground_truth)
    errors = jnp.linspace(-0.2, 0.2, 9)
    costs = refined_sector_costs(
        views[..., None],
        truth[None] + errors[:, None, None],
        penalties=lambda differences: [jnp.square(differences[0])],
    )
    best = errors[_channels(costs)[8].argmin(0)]
    assert np.quantile(jnp.abs(best)[4:-4, 4:-4], 0.8) < 0.051


def test_a_single_view_is_refused():
    with pytest.raises(InputError, match="one view has no disparity"):
        refined_sector_costs(jnp.zeros((1, 1, 4, 4, 1)), jnp.zeros((1, 4, 4)), penalties=_absolute)
