"""Noise of the images against draws and closed forms."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.models.proposal import NoiseConfig, noise
from tests.reference.matching import bilinear
from tests.scenes import correlated_noise, noisy_waves

CONFIG = NoiseConfig()
SUB_PIXEL = jnp.array([0.0, 0.25, 0.5])
noise_level = jax.jit(partial(noise.noise_level, config=CONFIG))
texture_weight = jax.jit(partial(noise.texture_weight, config=CONFIG))


@pytest.mark.parametrize("displacement", [(0.0, 3.0), (-0.5, 0.5), (-0.5, 0.25), (0.3, -1.2)])
@pytest.mark.parametrize("correlation", [(0.0, 0.0), (0.6, 0.3)])
def test_gain_is_the_variance_of_interpolated_noise(displacement, correlation, tolerance):
    # Interpolation is linear: its responses to single bright pixels are its weights.
    weights = [
        bilinear(np.eye(1, 49, k).reshape(7, 7), 3 + displacement[0], 3 + displacement[1])
        for k in range(49)
    ]
    y, x = np.indices((7, 7)).reshape(2, 49)
    down, right = (np.abs(line[:, None] - line[None]) for line in (y, x))
    covariance = np.float64(correlation[0]) ** down * np.float64(correlation[1]) ** right
    gain = noise.interpolation_gain(jnp.array(displacement), jnp.array(correlation))
    np.testing.assert_allclose(gain, weights @ covariance @ weights, **tolerance("relative"))


@pytest.mark.parametrize("deviation", [0.0, 0.2, 1.0, 5.0])
def test_expected_truncated_error_is_the_mean_over_draws(deviation):
    draws = np.abs(np.random.default_rng(0).normal(0, deviation, 200_000))
    expected = noise.expected_truncated_error(jnp.array(deviation), jnp.array(1.0))
    np.testing.assert_allclose(expected, np.minimum(draws, 1.0).mean(), atol=3e-3)


@pytest.mark.parametrize("deviation", [0.005, 0.02])
@pytest.mark.parametrize("disparity", [0.0, 0.25])
def test_level_of_added_noise_is_found(deviation, disparity):
    level = noise_level(noisy_waves(deviation, disparity), SUB_PIXEL)
    np.testing.assert_allclose(level, deviation, rtol=0.15)


def test_level_is_found_with_a_disparity_map():
    deviation, disparity = 0.02, 0.25
    views = noisy_waves(deviation, disparity)
    level = noise_level(views, jnp.full((1, 64, 64), disparity))
    np.testing.assert_allclose(level, deviation, rtol=0.15)
    wrong = noise_level(views, jnp.full((1, 64, 64), 2.0))
    assert float(wrong) > 2 * deviation  # texture counts as noise


def test_views_without_noise_have_level_zero():
    assert float(noise_level(noisy_waves(0.0), SUB_PIXEL)) < 1e-3


def test_noise_has_an_effect_from_twice_that_of_rounding_on():
    reference = 2 / 255 / np.sqrt(12)  # rounding errors are uniform over one step
    np.testing.assert_allclose(CONFIG.reference_level, reference, rtol=0.2)
    levels = CONFIG.reference_level * jnp.array([0.0, 0.5, 1.0, 2.0, 1e6])
    weights = jax.vmap(partial(noise.noise_weight, config=CONFIG))(levels)
    np.testing.assert_allclose(weights, [0.0, 0.0, 0.5, 1.0, 1.0], atol=0.02)


def test_texture_is_distinguished_from_noise():
    """A sine on the right half; its weight follows from the closed form of its derivatives."""
    deviation, amplitude, frequency = 0.02, 0.1, 0.7
    image = np.random.default_rng(0).normal(0, deviation, (96, 128)).astype(np.float32)
    image[:, 64:] += amplitude * np.sin(frequency * np.arange(64))
    weight = np.asarray(texture_weight(jnp.asarray(image), jnp.float32(deviation)))
    texture = np.square(amplitude * np.sin(frequency)) / 2  # central differences of a sine
    expected = 1 - CONFIG.texture_margin * deviation**2 / (texture + deviation**2)
    np.testing.assert_allclose(weight[8:-8, 72:-8].mean(), expected, atol=0.02)
    assert weight[8:-8, 8:-72].mean() < 0.06


def test_everything_is_texture_where_noise_is_weak():
    draws = np.random.default_rng(0).normal(0, 1e-4, (32, 32)).astype(np.float32)
    assert float(texture_weight(jnp.asarray(draws), jnp.float32(1e-4)).min()) > 0.99
    blank = texture_weight(jnp.full((8, 9), 0.3), jnp.float32(0.0))
    np.testing.assert_array_equal(blank, np.ones((8, 9)))


def test_texture_weight_has_gradient_zero():
    for image in (jnp.zeros((12, 12)), jnp.asarray(correlated_noise((12, 12), 0.5, 0.5)[0])):
        gradient = jax.grad(lambda image: texture_weight(image, jnp.float32(0.01)).sum())(image)
        np.testing.assert_array_equal(gradient, np.zeros((12, 12)))
