"""Noise of the images against draws of it, and where it must not be seen."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.ops import noise
from occjax.ops.matching import aperture_costs, sector_sums
from tests.reference.matching import bilinear
from tests.scenes import noisy_waves

noise_level = jax.jit(noise.noise_level)
CANDIDATES = jnp.array([0.0, 0.25, 0.5])


@pytest.mark.parametrize("displacement", [(0.0, 3.0), (-0.5, 0.5), (0.3, -1.2)])
def test_the_gain_is_the_variance_of_interpolated_noise(displacement):
    # Interpolation is linear: its response to one bright pixel at each place holds all weights.
    weights = [
        bilinear(np.eye(1, 49, k).reshape(7, 7), 3 + displacement[0], 3 + displacement[1])
        for k in range(49)
    ]
    gain = noise.interpolation_gain(jnp.array(displacement))
    np.testing.assert_allclose(gain, np.square(weights).sum(), rtol=1e-5)


@pytest.mark.parametrize("displacement", [(0.5, 0.5), (-0.5, 0.25), (0.3, -1.2)])
def test_the_gain_is_the_variance_of_interpolated_noise_that_is_alike_nearby(displacement):
    weights = [
        bilinear(np.eye(1, 49, k).reshape(7, 7), 3 + displacement[0], 3 + displacement[1])
        for k in range(49)
    ]
    alike = np.array([0.6, 0.3])
    y, x = np.indices((7, 7)).reshape(2, 49)
    down, right = (np.abs(line[:, None] - line[None]) for line in (y, x))
    covariance = alike[0] ** down * alike[1] ** right
    gain = noise.interpolation_gain(jnp.array(displacement), jnp.array(alike))
    np.testing.assert_allclose(gain, weights @ covariance @ weights, rtol=1e-5)


def _blurred(shape, down, right, seed=0):
    """Noise plus so much of the pixels above and to the left, and its correlation."""
    draws = np.random.default_rng(seed).normal(0, 0.01, (shape[0] + 1, shape[1] + 1))
    draws = draws[1:] + down * draws[:-1]
    draws = draws[:, 1:] + right * draws[:, :-1]
    # Of n_k + a n_(k - 1): a / (1 + a^2).
    return draws.astype(np.float32), [down / (1 + down**2), right / (1 + right**2)]


def test_texture_is_told_from_noise():
    """Waves on one half; the share by the closed form of their derivatives."""
    deviation, amplitude, frequency = 0.02, 0.1, 0.7
    image = np.random.default_rng(0).normal(0, deviation, (96, 128)).astype(np.float32)
    image[:, 64:] += amplitude * np.sin(frequency * np.arange(64))
    share = np.asarray(noise.texture_share(jnp.asarray(image), jnp.float32(deviation)))
    texture = np.square(amplitude * np.sin(frequency)) / 2  # central differences of a sine
    expected = 1 - noise.MARGIN * deviation**2 / (texture + deviation**2)
    np.testing.assert_allclose(share[8:-8, 72:-8].mean(), expected, atol=0.02)
    assert share[8:-8, 8:-72].mean() < 0.06


def test_no_derivative_passes_through_the_share_of_texture_even_where_all_is_blank():
    deviation = jnp.float32(0.01)
    for image in (jnp.zeros((12, 12)), jnp.asarray(_blurred((12, 12), 0.5, 0.5)[0])):
        gradient = jax.grad(lambda image: noise.texture_share(image, deviation).sum())(image)
        np.testing.assert_array_equal(gradient, np.zeros((12, 12)))


def test_noise_counts_from_twice_that_of_rounding_on():
    """Half of that limit is as good as none, twice of it as good as all."""
    limit = 2 / 255 / np.sqrt(12)  # rounding leaves errors spread evenly over one step
    share = jax.vmap(noise.noisiness)(jnp.array([0.0, limit / 2, noise.FAINT, 2 * limit, 1e6]))
    np.testing.assert_allclose(share, [0.0, 0.0, 0.5, 1.0, 1.0], atol=0.02)
    np.testing.assert_allclose(noise.FAINT, limit, rtol=0.2)


def test_where_noise_is_weak_all_is_texture():
    draws = np.random.default_rng(0).normal(0, 1e-4, (32, 32)).astype(np.float32)
    assert float(noise.texture_share(jnp.asarray(draws), jnp.float32(1e-4)).min()) > 0.99
    blank = noise.texture_share(jnp.full((8, 9), 0.3), jnp.float32(0.0))
    np.testing.assert_array_equal(blank, np.ones((8, 9)))


@pytest.mark.parametrize("deviation", [0.0, 0.2, 1.0, 5.0])
def test_the_expected_departure_is_the_mean_over_many_draws(deviation):
    draws = np.abs(np.random.default_rng(0).normal(0, deviation, 200_000))
    expected = noise.expected_departure(jnp.array(deviation), jnp.array(1.0))
    np.testing.assert_allclose(expected, np.minimum(draws, 1.0).mean(), atol=3e-3)


@pytest.mark.parametrize("deviation", [0.005, 0.02])
@pytest.mark.parametrize("disparity", [0.0, 0.25])
def test_the_level_of_added_noise_is_found(deviation, disparity):
    level = noise_level(noisy_waves(deviation, disparity), CANDIDATES)
    np.testing.assert_allclose(level, deviation, rtol=0.15)


def test_the_level_is_found_by_a_map_too():
    deviation, disparity = 0.02, 0.25
    level = noise_level(noisy_waves(deviation, disparity), jnp.full((1, 64, 64), disparity))
    np.testing.assert_allclose(level, deviation, rtol=0.15)
    wrong = noise_level(noisy_waves(deviation, disparity), jnp.full((1, 64, 64), 2.0))
    assert float(wrong) > 2 * deviation  # the waves are taken for noise


def test_views_without_noise_have_none():
    assert float(noise_level(noisy_waves(0.0), CANDIDATES)) < 1e-3


def test_noise_favours_no_candidate():
    """A blank wall under noise: each candidate is as good as any other."""
    deviation = 0.01
    draws = np.random.default_rng(0).normal(0, deviation, (3, 3, 64, 64, 1)).astype(np.float32)
    terms = {"truncation": jnp.full(1, 0.02), "radius": 2}
    favour = aperture_costs(jnp.asarray(draws), CANDIDATES, **terms).mean((1, 2))
    even = aperture_costs(
        jnp.asarray(draws), CANDIDATES, noise=jnp.full(1, deviation), **terms
    ).mean((1, 2))
    assert float(jnp.ptp(favour)) > 0.1 * float(favour.max())
    assert float(jnp.ptp(even)) < 0.03 * float(even.max())


def test_noise_that_is_alike_nearby_favours_no_candidate_either():
    """As it is told to be: taken for independent, it would favour whole pixels."""
    draws = np.stack([_blurred((96, 96), 0.5, 0.5, seed=k)[0] for k in range(9)])
    views = jnp.asarray(draws.reshape(3, 3, 96, 96, 1))
    correlation = _blurred((96, 96), 0.5, 0.5)[1]
    terms = {
        "truncation": jnp.full(1, 0.1),
        "noise": jnp.full(1, 0.01 * 1.25),  # of variance 1 + a^2 in each direction
        "combine": lambda sums, numbers: sums.mean(),
    }
    favour = sector_sums(views, CANDIDATES, **terms)
    even = sector_sums(views, CANDIDATES, correlation=jnp.array([correlation]), **terms)
    assert float(favour[0]) < 0.96 * float(favour[2])
    assert float(jnp.ptp(even)) < 0.03 * float(even.mean())
