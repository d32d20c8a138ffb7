"""Noise of the images against draws of it, and where it must not be seen."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.ops import noise
from occjax.ops.matching import aperture_costs
from tests.reference.matching import bilinear

noise_level = jax.jit(noise.noise_level)
CANDIDATES = jnp.array([0.0, 0.25, 0.5])


def _waves(deviation, disparity=0.25, size=64):
    """``[3, 3, size, size]`` noisy views of smooth waves at one disparity."""
    y, x = np.mgrid[:size, :size].astype(float)
    rng = np.random.default_rng(0)
    views = np.empty((3, 3, size, size), np.float32)
    for row, column in np.ndindex(3, 3):
        scene_y, scene_x = y + disparity * (row - 1), x + disparity * (column - 1)
        wave = 0.2 * np.sin(0.3 * scene_x + 0.1 * scene_y) + 0.2 * np.sin(0.25 * scene_y)
        views[row, column] = 0.5 + wave + rng.normal(0, deviation, y.shape)
    return jnp.asarray(views)


@pytest.mark.parametrize("displacement", [(0.0, 3.0), (-0.5, 0.5), (0.3, -1.2)])
def test_the_gain_is_the_variance_of_interpolated_noise(displacement):
    # Interpolation is linear: its response to one bright pixel at each place holds all weights.
    weights = [
        bilinear(np.eye(1, 49, k).reshape(7, 7), 3 + displacement[0], 3 + displacement[1])
        for k in range(49)
    ]
    gain = noise.interpolation_gain(jnp.array(displacement))
    np.testing.assert_allclose(gain, np.square(weights).sum(), rtol=1e-5)


@pytest.mark.parametrize("deviation", [0.0, 0.2, 1.0, 5.0])
def test_the_expected_departure_is_the_mean_over_many_draws(deviation):
    draws = np.abs(np.random.default_rng(0).normal(0, deviation, 200_000))
    expected = noise.expected_departure(jnp.array(deviation), jnp.array(1.0))
    np.testing.assert_allclose(expected, np.minimum(draws, 1.0).mean(), atol=3e-3)


@pytest.mark.parametrize("deviation", [0.005, 0.02])
@pytest.mark.parametrize("disparity", [0.0, 0.25])
def test_the_level_of_added_noise_is_found(deviation, disparity):
    level = noise_level(_waves(deviation, disparity), CANDIDATES)
    np.testing.assert_allclose(level, deviation, rtol=0.15)


def test_views_without_noise_have_none():
    assert float(noise_level(_waves(0.0), CANDIDATES)) < 1e-3


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
