"""Textures: bounded, tied to the surface, and noise against a NumPy loop."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.data.textures import (
    PATTERNS,
    albedo,
    fractal_noise,
    linear_from_srgb,
    material,
    srgb_from_linear,
    take,
)

POINTS = jnp.asarray(np.random.default_rng(0).uniform(-40.0, 40.0, (500, 3)), jnp.float32)


def hash_unit(*coordinates):
    """The hash in Python integers, modulo 2^32."""
    state = 0x2545F491
    for value in coordinates:
        state = ((state ^ (int(value) % 2**32)) * 0x9E3779B1) % 2**32
        state = ((state ^ (state >> 15)) * 0x85EBCA6B) % 2**32
        state ^= state >> 13
    return (state >> 8) / 2**24


def noise_loop(point, octaves):
    total = 0.0
    for octave in range(octaves):
        scaled = np.asarray(point, np.float64) * 2.0**octave + 19.19 * octave
        cell = np.floor(scaled)
        fraction = scaled - cell
        smooth = 6 * fraction**5 - 15 * fraction**4 + 10 * fraction**3
        for corner in np.ndindex(2, 2, 2):
            weight = np.prod(np.where(np.array(corner) == 1, smooth, 1 - smooth))
            total += 0.5**octave * weight * hash_unit(*(cell + np.array(corner)))
    return total / (2.0 - 0.5 ** (octaves - 1))


def test_noise_is_that_of_a_loop_over_octaves_and_corners():
    points = POINTS[:40] * 0.2
    expected = [noise_loop(point, 3) for point in np.asarray(points)]
    np.testing.assert_allclose(fractal_noise(points, 3), expected, atol=1e-4)


def test_noise_is_spread_around_one_half():
    values = np.asarray(fractal_noise(POINTS))
    assert values.min() >= 0.0
    assert values.max() <= 1.0
    assert abs(values.mean() - 0.5) < 0.05
    assert values.std() > 0.08


def of_one(material_, points):
    return albedo(take(material_, jnp.zeros(len(points), jnp.int32)), points)


@pytest.mark.parametrize("pattern", PATTERNS)
def test_every_pattern_has_contrast_and_is_a_reflectance(pattern):
    painted = material(pattern, ground=(0.9, 0.5, 0.2), figure=(0.1, 0.2, 0.3), frequency=0.21)
    colours = np.asarray(jax.jit(of_one)(painted, POINTS))
    assert colours.min() >= 0.0
    assert colours.max() <= 1.0
    assert colours.std(axis=0).min() > 0.005


def test_checks_alternate_from_cell_to_cell():
    board = material("checks", ground=(1, 1, 1), figure=(0, 0, 0), frequency=0.5, grain=0.0)
    points = jnp.array([[1.0, 1.0, 0.1], [3.0, 1.0, 0.1], [3.0, 3.0, 0.1], [-1.0, 1.0, 0.1]])
    assert of_one(board, points)[:, 0].tolist() == [1.0, 0.0, 1.0, 0.0]


def test_a_texture_laid_around_depends_on_angle_and_height_alone():
    label = material("checks", frequency=(8.0, 0.2, 0.0), grain=0.0, around=True)
    angle = jnp.linspace(0.1, 6.0, 50)

    def at(radius):
        points = jnp.stack([radius * jnp.cos(angle), radius * jnp.sin(angle), angle], axis=1)
        return of_one(label, points)

    np.testing.assert_array_equal(at(1.0), at(7.0))


def test_the_srgb_curve_is_that_of_the_standard():
    # IEC 61966-2-1: the toe is linear up to 0.04045; 50 % grey is 0.2140 of full light.
    coded = jnp.array([0.0, 0.04045, 0.5, 1.0])
    expected = [0.0, 0.04045 / 12.92, ((0.5 + 0.055) / 1.055) ** 2.4, 1.0]
    np.testing.assert_allclose(linear_from_srgb(coded[:, None].repeat(3, 1))[:, 0], expected, 1e-5)
    ramp = jnp.linspace(0.0, 1.0, 30).reshape(10, 3)
    np.testing.assert_allclose(srgb_from_linear(linear_from_srgb(ramp)), ramp, atol=1e-6)
