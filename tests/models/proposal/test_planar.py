"""Planes of large planar surfaces in disparity maps of known surfaces."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.models.proposal import PlanarConfig
from occjax.models.proposal.planar import flatten_planar_surfaces, quadratic_fraction

CONFIG = PlanarConfig()
SIZE = (64, 96)
Y, X = np.mgrid[: SIZE[0], : SIZE[1]].astype(np.float32)
SLANTED = 0.5 + 0.02 * Y - 0.004 * X
# An error of up to 0.015 pixels that varies over dozens of pixels, as gloss causes it.
ERROR = 0.015 * np.sin(Y / 4) * np.cos(X / 5)

_flatten = jax.jit(flatten_planar_surfaces, static_argnames="config")


def flatten(disparity, information=1e3, config=CONFIG):
    information = np.broadcast_to(np.float32(information), disparity.shape)
    return np.asarray(_flatten(jnp.asarray(disparity), jnp.asarray(information), config=config))


def test_slowly_varying_error_of_a_slanted_plane_is_averaged():
    found = flatten(SLANTED + ERROR)
    assert np.abs(found - SLANTED).max() < 0.004


@pytest.mark.parametrize("curvature", [1e-3, 3e-5])
def test_curved_surface_keeps_its_disparity(curvature):
    curved = 1.0 + curvature * ((Y - 32) ** 2 + (X - 48) ** 2) / 2
    np.testing.assert_array_equal(flatten(curved), curved)


def test_surface_in_front_of_a_plane_keeps_its_disparity_and_its_edge():
    bump = 3.0 - np.hypot(Y - 32, X - 48) / 4
    in_front = bump > 0.0
    found = flatten(np.where(in_front, 3.0 + bump, SLANTED + ERROR))
    np.testing.assert_array_equal(found[in_front], (3.0 + bump)[in_front])
    assert np.abs(found - SLANTED)[~in_front].max() < 0.004


def test_two_planes_that_meet_have_one_plane_each():
    truth = np.maximum(0.02 * Y, 1.3 - 0.02 * Y)
    found = flatten(truth + ERROR)
    error = np.abs(found - truth)
    assert error.mean() < 0.3 * np.abs(ERROR).mean()
    assert error.max() < 0.02


@pytest.mark.parametrize("certain", [True, False])
def test_only_uncertain_pixels_follow_a_plane_far_from_them(certain):
    disturbed = (np.abs(Y - 32) < 4) & (np.abs(X - 48) < 4)
    found = flatten(
        SLANTED + np.where(disturbed, 0.06, 0.0), np.where(disturbed & (not certain), 1.0, 1e3)
    )
    # The information of a pixel is a mean over 3x3 pixels.
    inner = (np.abs(Y - 32) < 3) & (np.abs(X - 48) < 3)
    moved = np.abs(found - SLANTED)[inner] < 0.01
    assert moved.all() == moved.any() == (not certain)


@pytest.mark.parametrize("size", [(3, 3), (5, 40)])
def test_small_images_and_no_information_give_finite_maps(size):
    disparity = np.random.default_rng(0).uniform(-1, 1, size).astype(np.float32)
    found = flatten(disparity, 0.0)
    assert np.isfinite(found).all()
    assert np.abs(found - disparity).max() <= CONFIG.tolerance * CONFIG.max_deviation


def test_the_fraction_that_a_quadratic_function_explains_is_that_of_least_squares(tolerance):
    rng = np.random.default_rng(0)
    weights = rng.uniform(0, 1, (3, 200)).astype(np.float32)
    positions = np.stack([np.ones(200), *rng.uniform(0, 8, (2, 200))]).astype(np.float32)
    _, x, y = positions
    bowl = np.outer([0.0, 0.1, 1.0], (x - 4) ** 2 - (y - 3) ** 2)
    residuals = (bowl + rng.normal(0, 1, (3, 200))).astype(np.float32)
    found = quadratic_fraction(*map(jnp.asarray, (weights, positions, residuals)))
    terms = np.stack([x**0, x, y, x * x, x * y, y * y], 1)
    for weight, residual, fraction in zip(weights, residuals, found, strict=True):
        root = np.sqrt(weight)
        solution = np.linalg.lstsq(terms * root[:, None], residual * root, rcond=None)[0]
        expected = weight @ (terms @ solution) ** 2 / (weight @ residual**2)
        np.testing.assert_allclose(fraction, expected, **tolerance("float32"))
