"""Costs of the aperture's sectors against NumPy loops, and what they promise."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.errors import InputError
from occjax.ops import (
    SectorCosts,
    refined_sector_costs,
    sector_channels,
    sector_steps,
    view_offsets,
)
from tests.reference import sectors as reference
from tests.scenes import plane

TOLERANCE = 0.1
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
    scales = jnp.array([0.1, 0.3])
    costs = jax.jit(refined_sector_costs)(features, disparities, tolerance=scales, offsets=offsets)
    sums, weights = reference.refined_sector_costs(
        *map(np.asarray, (features, disparities, offsets, scales))
    )
    np.testing.assert_allclose(costs.sums, sums, **tolerance("float32"))
    np.testing.assert_array_equal(costs.weights, weights)


@ARRANGEMENTS
def test_steps_are_weighted_sums_of_residuals_and_derivatives(name, tolerance):
    offsets = _arrangement(name)
    views, disparity = _random(*offsets.shape[:2], 6, 7), _random(6, 7, seed=1) - 0.5
    steps = jax.jit(sector_steps, static_argnames="tolerance")(
        views, disparity, tolerance=TOLERANCE, offsets=offsets
    )
    expected = reference.sector_steps(*map(np.asarray, (views, disparity, offsets)), TOLERANCE)
    np.testing.assert_allclose(np.stack(steps), expected, **tolerance("float32"))


def test_channels_are_sectors_whole_aperture_and_best_half():
    costs = SectorCosts(_random(8, 3, 5, 6), 1.0 + _random(8, 3, 5, 6, seed=1))
    expected = reference.sector_channels(*map(np.asarray, costs))
    # A thousandth of a view stands for all others where a sector sees nothing.
    np.testing.assert_allclose(sector_channels(costs), expected, atol=2e-3)


def test_a_sector_without_views_has_the_mean_of_the_others():
    costs = refined_sector_costs(
        _random(1, 5, 9, 9, 1), jnp.zeros((1, 9, 9)), tolerance=jnp.array([0.1])
    )
    channels = sector_channels(costs)
    assert costs.weights[2].max() == 0  # a row of views has none above or below
    np.testing.assert_allclose(channels[2], channels[8], rtol=1e-5)


def test_a_point_hidden_on_one_side_costs_nothing_in_the_other_half():
    views = (
        jnp.zeros((3, 3, 6, 6)).at[:, 2:].set(1.0)
    )  # seen by the centre view and those left of it
    costs = refined_sector_costs(views[..., None], jnp.zeros((1, 6, 6)), tolerance=jnp.array([0.1]))
    whole, best = sector_channels(costs)[-2:]
    assert whole.min() > 0.3
    assert best.max() < 1e-3


def test_costs_are_least_at_the_true_disparity_of_a_slanted_plane():
    scene = plane(grid=(5, 5), size=(32, 40), disparity=-0.4, slope=(0.004, 0.01))
    views, truth = jnp.asarray(scene.grey()), jnp.asarray(scene.ground_truth)
    errors = jnp.linspace(-0.2, 0.2, 9)
    costs = refined_sector_costs(
        views[..., None], truth[None] + errors[:, None, None], tolerance=jnp.ones(1)
    )
    best = errors[sector_channels(costs)[8].argmin(0)]
    assert np.quantile(jnp.abs(best)[4:-4, 4:-4], 0.8) < 0.051


def test_every_sector_steps_to_the_true_disparity():
    # Waves so long that bilinear reading is nearly exact: a step is wrong by about their wave
    # number, 0.05, times 1/8, over the offset: 0.006 pixels per view step.
    y, x = np.mgrid[:32, :40].astype(float)
    views = np.empty((5, 5, 32, 40), np.float32)
    for row, column in np.ndindex(5, 5):
        point_y, point_x = y + 0.3 * (row - 2), x + 0.3 * (column - 2)
        views[row, column] = 0.5 + 0.2 * np.sin(0.05 * point_x + 0.02 * point_y)
        views[row, column] += 0.2 * np.sin(0.04 * point_y - 0.02 * point_x)
    steps = sector_steps(jnp.asarray(views), jnp.full((32, 40), 0.25), tolerance=1.0)
    inner = np.s_[:, 6:-6, 6:-6]
    information, push = np.asarray(steps.information)[inner], np.asarray(steps.push)[inner]
    textured = information > 0.5 * information.max((1, 2), keepdims=True)
    assert np.abs((push / information)[textured] - 0.05).max() < 0.008


def test_the_order_of_the_views_does_not_matter(tolerance):
    views, disparity = _random(1, 17, 6, 7), _random(6, 7, seed=1)
    turned = np.concatenate([np.arange(8)[::-1], [8], np.arange(9, 17)[::-1]])
    steps = sector_steps(views, disparity, tolerance=TOLERANCE, offsets=STAR)
    again = sector_steps(views[:, turned], disparity, tolerance=TOLERANCE, offsets=STAR[:, turned])
    for one, other in zip(steps, again, strict=True):
        np.testing.assert_allclose(one, other, **tolerance("float32"))


def test_a_single_view_is_refused():
    view, disparity = jnp.zeros((1, 1, 4, 4)), jnp.zeros((4, 4))
    with pytest.raises(InputError, match="one view has no disparity"):
        sector_steps(view, disparity, tolerance=0.1)
    with pytest.raises(InputError, match="one view has no disparity"):
        refined_sector_costs(view[..., None], disparity[None], tolerance=jnp.array([0.1]))
