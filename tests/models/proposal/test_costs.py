"""Matching costs against NumPy loops, and their behaviour under occlusion and noise."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.errors import InputError
from occjax.lightfield import view_offsets
from occjax.models.proposal import CostConfig, NoiseConfig, costs
from occjax.models.proposal.filters import BINOMIAL_GAIN, central_differences
from tests.reference import matching as reference
from tests.scenes import correlated_noise, noisy_waves

aperture_costs = jax.jit(costs.aperture_costs, static_argnames="radius")
photometric_costs = jax.jit(costs.photometric_costs, static_argnames=("config", "noise"))
CANDIDATES = jnp.array([-1.3, 0.0, 0.4])
TRUNCATION = jnp.array([0.3, 0.6])


@pytest.mark.parametrize("grid", [(3, 3), (1, 4), (2, 2), (3, 5)])
def test_sums_are_over_the_views_of_each_sector(grid, uniform, tolerance):
    features, offsets = uniform(*grid, 5, 8, 2), view_offsets(*grid)
    arrays = map(np.asarray, (features, CANDIDATES, TRUNCATION, offsets))
    expected_sums, expected_counts = reference.sector_sums(*arrays)
    settings = {"truncation": TRUNCATION, "combine": lambda *kept: kept}
    sums, counts = costs.sector_sums(features, CANDIDATES, **settings)
    np.testing.assert_allclose(sums, expected_sums, **tolerance("float32"))
    np.testing.assert_array_equal(counts[0], expected_counts)
    totals, count = costs.sector_sums(features, CANDIDATES, **settings, by_sector=False)
    np.testing.assert_allclose(totals[:, 0], expected_sums.sum(1), **tolerance("float32"))
    np.testing.assert_array_equal(count[0], [expected_counts.sum()])


@pytest.mark.parametrize("grid", [(3, 3), (1, 4)])
@pytest.mark.parametrize("radius", [0, 1])
def test_aperture_costs_are_the_least_mean_over_the_parts(grid, radius, uniform, tolerance):
    features, offsets = uniform(*grid, 5, 8, 2), view_offsets(*grid)
    found = aperture_costs(features, CANDIDATES, truncation=TRUNCATION, radius=radius)
    arrays = map(np.asarray, (features, CANDIDATES, TRUNCATION, offsets))
    expected = reference.aperture_costs(*arrays, radius)
    np.testing.assert_allclose(found, expected, **tolerance("float32"))


def test_photometric_costs_compare_grey_and_its_derivatives(uniform, tolerance):
    views, config = uniform(3, 3, 6, 9), CostConfig(0.3, 0.1)
    found = photometric_costs(views, CANDIDATES, jnp.zeros(()), config, NoiseConfig())
    padded = np.pad(views, [(0, 0), (0, 0), (1, 1), (1, 1)], mode="edge")
    down = (padded[..., 2:, 1:-1] - padded[..., :-2, 1:-1]) / 2
    right = (padded[..., 1:-1, 2:] - padded[..., 1:-1, :-2]) / 2
    features = np.stack([views, down, right], axis=-1)
    expected = reference.aperture_costs(
        features, np.asarray(CANDIDATES), np.array([0.3, 0.1, 0.1]), view_offsets(3, 3), 1
    )
    np.testing.assert_allclose(found, expected, **tolerance("float32"))


def test_order_of_the_views_does_not_matter(uniform, tolerance):
    features, offsets = uniform(3, 3, 6, 7, 2), view_offsets(3, 3)
    order = np.array([8, 1, 2, 3, 4, 0, 6, 7, 5])  # the centre view stays
    found = aperture_costs(
        features.reshape(1, 9, 6, 7, 2)[:, order],
        CANDIDATES,
        truncation=TRUNCATION,
        offsets=jnp.asarray(offsets.reshape(1, 9, 2)[:, order]),
    )
    expected = aperture_costs(features, CANDIDATES, truncation=TRUNCATION)
    np.testing.assert_allclose(found, expected, **tolerance("float32"))


def test_single_view_is_refused():
    with pytest.raises(InputError, match="at least 1x2"):
        aperture_costs(jnp.zeros((1, 1, 4, 4, 1)), jnp.zeros(3), truncation=jnp.ones(1))


def test_blurred_grey_finds_disparity_where_noise_hides_the_derivatives():
    disparity, deviation = 1.0, 0.03
    views = noisy_waves(deviation, disparity, amplitude=0.05)
    candidates = jnp.linspace(0.0, 2.0, 9)
    found = photometric_costs(
        views, candidates, jnp.float32(deviation), CostConfig(), NoiseConfig()
    )
    noise = deviation * jnp.array([1.0, 0.5**0.5, 0.5**0.5])
    sharp = aperture_costs(
        jnp.stack([views, *central_differences(views)], axis=-1),
        candidates,
        truncation=jnp.hypot(jnp.array([0.02, 0.004, 0.004]), noise),
        noise=noise,
    )

    def fraction_correct(volume):
        winner = candidates[volume.argmin(0)][16:-16, 16:-16]
        return float((jnp.abs(winner - disparity) <= 0.25).mean())

    assert fraction_correct(found) > 1.5 * fraction_correct(sharp)


# In the tests below a blank wall is noisy: each candidate matches as well as any other.
SUB_PIXEL = jnp.array([0.0, 0.25, 0.5])


def relative_spread(means):
    return float(jnp.ptp(means) / means.max())


def test_correlated_noise_favours_no_candidate():
    draws, correlation = correlated_noise((9, 96, 96), 0.5, 0.5)
    views = jnp.asarray(draws.reshape(3, 3, 96, 96, 1))

    def means(correlation):
        return costs.sector_sums(
            views,
            SUB_PIXEL,
            truncation=jnp.full(1, 0.1),
            noise=jnp.full(1, 0.01 * 1.25),  # of variance 1 + a^2 in each direction
            correlation=correlation,
            combine=lambda sums, counts: sums.mean(),
        )

    independent = means(None)
    assert float(independent[0]) < 0.96 * float(independent[2])
    assert relative_spread(means(jnp.array([correlation]))) < 0.03


def test_noise_favours_no_candidate_of_photometric_costs():
    deviation = 0.02
    noise = np.random.default_rng(0).normal(0.5, deviation, (3, 3, 96, 96)).astype(np.float32)
    means = photometric_costs(
        jnp.asarray(noise),
        SUB_PIXEL,
        jnp.float32(deviation),
        CostConfig(grey_truncation=0.002, derivative_truncation=1.0),
        NoiseConfig(),
    ).mean((1, 2))
    assert relative_spread(means) < 0.03
    # At disparity 0: |n_1 - n_2| of blurred noise, truncated at a value that this noise widens.
    blurred = deviation * BINOMIAL_GAIN
    draws = np.abs(np.random.default_rng(1).normal(0, np.sqrt(2) * blurred, 100_000))
    expected = np.minimum(draws / np.hypot(0.003, blurred), 1.0).mean()
    np.testing.assert_allclose(means[0], expected, rtol=0.1)
