"""Semi-global search: interpolation of volumes, and surfaces under noise."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.lightfield import view_offsets
from occjax.models.proposal import ProposalNetConfig, search
from occjax.models.proposal.filters import edge_aware_mean
from occjax.models.proposal.search import GreyViews, interpolate_volume
from tests.scenes import noisy_waves


def test_volumes_are_interpolated_linearly_within_their_range(uniform, tolerance):
    candidates = jnp.linspace(-1.0, 1.0, 5)
    volume, disparities = uniform(5, 3, 4), 2.6 * uniform(2, 3, 4, seed=1) - 1.3
    found = interpolate_volume(volume, candidates, disparities)
    for k, y, x in np.ndindex(2, 3, 4):
        expected = np.interp(disparities[k, y, x], candidates, volume[:, y, x])
        np.testing.assert_allclose(found[k, y, x], expected, **tolerance("absolute"))


@pytest.mark.slow
def test_noisy_waves_are_found(tolerance):
    disparity = 0.5
    grey = GreyViews(noisy_waves(0.02, disparity), jnp.asarray(view_offsets(3, 3)))
    found = jax.jit(search.search, static_argnames="config")(
        grey, jnp.linspace(-1.0, 2.0, 13), config=ProposalNetConfig(selector=None)
    )
    assert found.disparity.shape == (32, 32)
    error = np.abs(found.disparity - disparity)[4:-4, 4:-4]
    assert np.quantile(error, 0.9) < 0.125  # half an interval
    np.testing.assert_allclose(found.probabilities.sum(0), 1.0, **tolerance("absolute"))
    np.testing.assert_array_equal(found.aggregated.min(0), np.zeros((32, 32)))


def test_means_along_a_slanted_surface_find_it_where_means_at_one_disparity_do_not():
    """Costs of a plane that rises by five candidates; noise hides it in each pixel."""
    candidates = jnp.linspace(-2.0, 2.0, 17)
    truth = jnp.asarray(np.linspace(-0.6, 0.6, 40)[None].repeat(40, 0), jnp.float32)
    noise = np.random.default_rng(0).normal(0.3, 0.2, (17, 40, 40))
    costs = jnp.minimum(jnp.abs(candidates[:, None, None] - truth[None]), 0.5) / 2 + noise
    settings, edges = ProposalNetConfig().search, jnp.zeros((1, 40, 40))
    found = jax.jit(search.refine_along_surfaces, static_argnames="settings")(
        costs, candidates, truth + 0.2, edges, jnp.zeros((40, 40), bool), settings=settings
    )
    means = jax.jit(partial(edge_aware_mean, radius=settings.context_radius_px))(costs, edges)
    at_one_disparity = candidates[means.argmin(0)]
    error, other = (
        float(jnp.abs(each - truth)[4:-4, 4:-4].mean()) for each in (found, at_one_disparity)
    )
    assert error < 0.03
    assert other > 3 * error
