"""The edge-aware filters against NumPy loops and what they promise about edges and gradients."""

import jax
import jax.numpy as jnp
import jax.test_util
import numpy as np
import pytest

from occjax.ops.filtering import box_filter, guided_filter, semi_global
from tests.reference import filtering as reference

PENALTIES = {"small_penalty": 0.2, "large_penalty": 0.5, "guide_scale": 0.1}


def _random(*shape, seed=0):
    return jnp.asarray(np.random.default_rng(seed).random(shape, np.float32))


@pytest.mark.parametrize("radius", [0, 1, 3, 12])
def test_box_filter_is_the_mean_of_each_window(radius, tolerance):
    image = _random(7, 10)
    expected = reference.box_filter(np.asarray(image), radius)
    np.testing.assert_allclose(box_filter(image, radius), expected, **tolerance("float32"))


def test_box_filter_treats_stacked_maps_one_by_one(tolerance):
    stack = _random(2, 3, 5, 6)
    expected = np.stack(
        [[reference.box_filter(image, 2) for image in row] for row in np.asarray(stack)]
    )
    np.testing.assert_allclose(box_filter(stack, 2), expected, **tolerance("float32"))


@pytest.mark.parametrize("epsilon", [1e-3, 1.0])
def test_guided_filter_is_the_average_of_local_affine_fits(epsilon, tolerance):
    image, guide = _random(7, 10), _random(7, 10, seed=1)
    filtered = guided_filter(image, guide, radius=2, epsilon=epsilon)
    expected = reference.guided_filter(*np.float64([image, guide]), 2, epsilon)
    np.testing.assert_allclose(filtered, expected, **tolerance("float32"))


def test_guided_filter_is_accurate_for_a_faint_pattern_on_a_bright_guide():
    image, guide = _random(7, 10), 0.9 + 1e-3 * _random(7, 10, seed=1)
    filtered = guided_filter(image, guide, radius=2, epsilon=1e-6)
    expected = reference.guided_filter(*np.float64([image, guide]), 2, 1e-6)
    np.testing.assert_allclose(filtered, expected, atol=2e-3)


def test_guided_filter_removes_noise_and_keeps_the_edge_of_the_guide():
    guide = jnp.repeat(jnp.array([0.0, 1.0]), 16)[None].repeat(32, 0)
    noise = np.random.default_rng(0).normal(0, 0.1, guide.shape).astype(np.float32)
    error = guided_filter(guide + noise, guide, radius=3, epsilon=1e-3) - guide
    assert error.std() < 0.1 / 3  # the mean of 24 or more of the noise values
    assert jnp.abs(error[:, 15:17].mean(0)).max() < 0.03  # a box filter would err by 0.43


@pytest.mark.parametrize("shape", [(4, 5, 6), (3, 1, 5), (1, 4, 3)])
def test_semi_global_follows_the_recursion_along_eight_paths(shape, tolerance):
    costs, guide = _random(*shape), _random(*shape[1:], seed=1)
    expected = reference.semi_global(np.asarray(costs), np.asarray(guide), **PENALTIES)
    np.testing.assert_allclose(
        semi_global(costs, guide, **PENALTIES), expected, **tolerance("float32")
    )


def test_semi_global_mirrors_with_its_input(tolerance):
    costs, guide = _random(4, 5, 6), _random(5, 6, seed=1)
    aggregated = semi_global(costs, guide, **PENALTIES)
    for flip in (np.s_[:, ::-1, :], np.s_[:, :, ::-1]):
        mirrored = semi_global(costs[flip], guide[flip[1:]], **PENALTIES)
        np.testing.assert_allclose(mirrored[flip], aggregated, **tolerance("float32"))


def test_semi_global_carries_disparity_into_a_flat_region_up_to_the_edge_of_the_guide():
    costs = jnp.full((3, 4, 12), 0.5)
    costs = costs.at[0, :, 0].set(0.0).at[2, :, -1].set(0.0)  # all else is unknown
    guide = jnp.repeat(jnp.array([0.0, 1.0]), np.array([4, 8]))[None].repeat(4, 0)
    winner = semi_global(costs, guide, **PENALTIES).argmin(0)
    np.testing.assert_array_equal(winner, np.repeat([0, 2], [4, 8])[None].repeat(4, 0))


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize(
    "function",
    [
        lambda x, g: guided_filter(x, g, radius=1, epsilon=0.1),
        lambda x, g: semi_global(x[None] * jnp.arange(1.0, 4.0)[:, None, None], g, **PENALTIES),
    ],
    ids=["guided_filter", "semi_global"],
)
def test_derivatives_agree_with_finite_differences(function):
    rng = np.random.default_rng(0)
    image, guide = jnp.asarray(rng.random((4, 5))), jnp.asarray(rng.random((4, 5)))
    jax.test_util.check_grads(
        lambda *arrays: function(*map(jnp.asarray, arrays)),
        (image, guide),
        order=1,
        atol=1e-5,
        rtol=1e-5,
        eps=1e-6,
    )


def test_vmap_agrees_with_a_loop(tolerance):
    costs, guides = _random(2, 3, 4, 5), _random(2, 4, 5, seed=1)

    def aggregate(cost, guide):
        return semi_global(guided_filter(cost, guide, radius=1, epsilon=0.1), guide, **PENALTIES)

    looped = [aggregate(cost, guide) for cost, guide in zip(costs, guides, strict=True)]
    np.testing.assert_allclose(
        jax.vmap(aggregate)(costs, guides), np.stack(looped), **tolerance("float32")
    )
