"""Refinement of a disparity map on scenes whose disparity is known in closed form."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.ops import refinement
from occjax.ops.refinement import median_filter
from tests.scenes import noisy_waves

QUICK = {"xla_backend_optimization_level": 0}  # compilation is most of the time
refine_disparity = jax.jit(
    refinement.refine_disparity,
    static_argnames=("steps", "radius", "guide_edge"),
    compiler_options=QUICK,
)
HEIGHT, WIDTH = 20, 24


def _slanted(blank=False):
    """Grey 3x3 views of a slanted plane of smooth waves, half of it blank on request, and truth."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    views = np.empty((3, 3, HEIGHT, WIDTH, 1), np.float32)
    for row, column in np.ndindex(3, 3):
        down, right = row - 1, column - 1
        d = (0.2 + 0.02 * y - 0.01 * x) / (1 - 0.02 * down + 0.01 * right)
        scene_y, scene_x = y + d * down, x + d * right
        wave = 0.25 * np.sin(0.6 * scene_x + 0.2 * scene_y) + 0.25 * np.sin(0.7 * scene_y)
        if blank:
            wave = np.where(np.abs(scene_x - 12) < 4, 0.0, wave)
        views[row, column, ..., 0] = 0.5 + wave
    return jnp.asarray(views), 0.2 + 0.02 * y - 0.01 * x


def _disturbed(truth):
    error = np.random.default_rng(0).uniform(-0.1, 0.1, truth.shape)
    return jnp.asarray(truth + error, jnp.float32)


def test_a_disturbed_slanted_plane_is_restored():
    views, truth = _slanted()
    refined = refine_disparity(views, _disturbed(truth), views[1, 1, ..., 0], guide_edge=10.0)
    error = np.abs(refined - truth)[3:-3, 3:-3]  # the disturbance is 0.05 on average, up to 0.1
    assert error.mean() < 0.01
    assert error.max() < 0.06


def test_textured_surroundings_speak_for_a_blank_patch():
    views, truth = _slanted(blank=True)
    refined = refine_disparity(views, _disturbed(truth), jnp.zeros_like(views[0, 0, ..., 0]))
    error = np.abs(refined - truth)[3:-3, 9:15]
    assert error.mean() < 0.015


def _faint(deviation, disparity=0.3):
    """Grey 5x5 views of broad, faint waves under noise, and their disparity."""
    return noisy_waves(deviation, disparity, views=5, amplitude=0.03), disparity


@pytest.mark.parametrize("deviation", [0.0, 0.005, 0.02])
def test_grey_counts_as_far_as_there_is_noise(deviation):
    views, disparity = _faint(deviation)
    features = refinement.refinement_features(views, jnp.full((64, 64), disparity))
    np.testing.assert_allclose(
        features[..., 0][..., 1:-1, :], (views[..., 2:, :] - views[..., :-2, :]) / 2, atol=1e-6
    )
    np.testing.assert_allclose(
        features[..., 1][..., 1:-1], (views[..., 2:] - views[..., :-2]) / 2, atol=1e-6
    )
    share = deviation**2 / 2 / (deviation**2 + 0.01**2)
    np.testing.assert_allclose(features[..., 2] / views, np.sqrt(share), rtol=0.15, atol=0.02)


def test_grey_makes_up_for_derivatives_under_noise():
    views, disparity = _faint(0.01)
    start = jnp.full((64, 64), disparity + 0.1)
    features = refinement.refinement_features(views, start)
    options = {"steps": 8, "radius": 12.0, "guide_edge": 10.0}
    guide = jnp.zeros((64, 64))
    inner = np.s_[8:-8, 8:-8]
    with_grey, without = (
        float(jnp.abs(refine_disparity(some, start, guide, **options) - disparity)[inner].mean())
        for some in (features, features[..., :2])
    )
    assert with_grey < 0.5 * without


def test_no_steps_leave_the_map_alone():
    views, truth = _slanted()
    start = _disturbed(truth)
    refined = refine_disparity(views, start, views[1, 1, ..., 0], steps=0)
    np.testing.assert_array_equal(refined, start)


def test_gradients_are_finite_where_all_views_are_equal():
    views = jnp.full((3, 3, HEIGHT, WIDTH, 1), 0.5)

    def total(views, disparity):
        return refinement.refine_disparity(views, disparity, views[1, 1, ..., 0]).sum()

    gradients = jax.jit(jax.grad(total, argnums=(0, 1)), compiler_options=QUICK)(
        views, jnp.zeros((HEIGHT, WIDTH))
    )
    assert all(bool(jnp.isfinite(gradient).all()) for gradient in gradients)


def test_median_filter_is_the_median_of_each_window():
    image = np.random.default_rng(0).random((5, 6), np.float32)
    padded = np.pad(image, 1, mode="edge")
    expected = [[np.median(padded[y : y + 3, x : x + 3]) for x in range(6)] for y in range(5)]
    np.testing.assert_array_equal(median_filter(jnp.asarray(image)), expected)
