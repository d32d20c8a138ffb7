"""Refinement of disparity maps of known planes."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.models.proposal import RefinementConfig
from occjax.models.proposal.planes import refine_disparity, refinement_features
from tests.scenes import noisy_waves, plane

CONFIG = RefinementConfig(steps=2, radius_px=8.0)
NO_EDGES = RefinementConfig(steps=8, guide_edge=10.0)
refined = jax.jit(partial(refine_disparity, max_step=0.125), static_argnames="config")


@pytest.fixture(scope="module")
def slanted():
    """Views ``[3, 3, 20, 24, 1]`` of a slanted plane, its disparity, and a disturbed disparity."""
    scene = plane(size=(20, 24), disparity=0.2, slope=(0.02, -0.01))
    error = np.random.default_rng(0).uniform(-0.1, 0.1, scene.image_size)
    start = jnp.asarray(scene.ground_truth + error, jnp.float32)
    return jnp.asarray(scene.grey())[..., None], scene.ground_truth, start


def test_disturbed_slanted_plane_is_restored(slanted):
    views, truth, start = slanted
    found = refined(views, start, jnp.zeros((20, 24)), config=CONFIG).disparity
    error = np.abs(found - truth)[3:-3, 3:-3]  # before: mean 0.05, maximum 0.1
    assert error.mean() < 0.01
    assert error.max() < 0.06


def test_texture_determines_a_blank_neighbourhood(slanted):
    views, truth, start = slanted
    # Every view sees the blank patch at its own position.
    seen = np.arange(24) + truth * np.arange(-1, 2)[:, None, None]
    blank = jnp.asarray(np.abs(seen - 12) < 4)[None, ..., None]
    found = refined(jnp.where(blank, 0.5, views), start, jnp.zeros((20, 24)), config=CONFIG)
    assert np.abs(found.disparity - truth)[3:-3, 10:15].mean() < 0.02


def test_zero_steps_return_the_map(slanted):
    views, _, start = slanted
    found = refined(views, start, views[1, 1, ..., 0], config=RefinementConfig(steps=0))
    np.testing.assert_array_equal(found.disparity, start)
    np.testing.assert_array_equal(found.information, 0.0)


@pytest.mark.slow
def test_gradients_are_finite_where_all_views_are_equal():
    views = jnp.full((3, 3, 20, 24, 1), 0.5)

    def total(views, disparity):
        guide = views[1, 1, ..., 0]
        refined = refine_disparity(views, disparity, guide, CONFIG, max_step=0.1)
        return refined.disparity.sum()

    gradients = jax.jit(jax.grad(total, argnums=(0, 1)))(views, jnp.zeros((20, 24)))
    assert all(bool(jnp.isfinite(gradient).all()) for gradient in gradients)


@pytest.mark.parametrize("deviation", [0.0, 0.005, 0.02])
def test_features_are_derivatives_and_grey_weighted_by_the_noise(deviation, uniform, tolerance):
    views = 0.5 + uniform(2, 2, 8, 9)
    features = refinement_features(views, jnp.float32(deviation), CONFIG)
    down, right, grey = jnp.moveaxis(features, -1, 0)
    inner = np.s_[..., 1:-1, :]
    np.testing.assert_allclose(
        down[inner], (views[..., 2:, :] - views[..., :-2, :]) / 2, **tolerance("absolute")
    )
    inner = np.s_[..., 1:-1]
    np.testing.assert_allclose(
        right[inner], (views[..., 2:] - views[..., :-2]) / 2, **tolerance("absolute")
    )
    fraction = deviation**2 / 2 / (deviation**2 + 0.01**2)
    np.testing.assert_allclose(grey, np.sqrt(fraction) * views, **tolerance("relative"))


def test_grey_helps_where_noise_hides_the_derivatives():
    disparity, deviation = 0.3, 0.01
    views = noisy_waves(deviation, disparity, views=5, amplitude=0.03)
    features = refinement_features(views, jnp.float32(deviation), NO_EDGES)
    start, guide = jnp.full((64, 64), disparity + 0.1), jnp.zeros((64, 64))
    with_grey, without = (
        jnp.abs(refined(each, start, guide, config=NO_EDGES).disparity - disparity)[
            8:-8, 8:-8
        ].mean()
        for each in (features, features.at[..., 2].set(0.0))
    )
    assert with_grey < 0.5 * without
