"""The cascade as a function: shapes, vmapped training statistics, options, gradients."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.models import OccCasNet, preset

TINY = OccCasNet(preset("tiny"))


def train_step_statistics(network, variables, views):
    def one(views):
        return network.apply(variables, views, train=True, mutable=["batch_stats"])

    _, state = jax.jit(jax.vmap(one, axis_name="batch", out_axes=(0, None)))(views)
    return state["batch_stats"]


def test_every_stage_answers_for_every_pixel(tiny_variables, tiny_views):
    coarse, refined = jax.jit(TINY.apply)(tiny_variables, tiny_views[0])
    assert coarse.disparity.shape == refined.disparity.shape == (12, 14)
    assert coarse.probabilities.shape == (5, 12, 14)
    assert refined.probabilities.shape == (3, 12, 14)
    assert coarse.occlusion is None
    assert refined.occlusion.shape == (3, 3, 12, 14)
    np.testing.assert_allclose(coarse.probabilities.sum(0), 1.0, rtol=1e-5)
    # A refinement cannot leave the range of its candidates.
    assert np.abs(refined.disparity - coarse.disparity).max() <= 0.5 + 1e-6


def test_vmap_is_a_loop(tiny_variables, tiny_views):
    apply = partial(TINY.apply, tiny_variables)
    batched = jax.jit(jax.vmap(apply))(tiny_views)
    for index, views in enumerate(tiny_views):
        alone = jax.jit(apply)(views)
        np.testing.assert_allclose(
            batched[-1].disparity[index], alone[-1].disparity, rtol=1e-4, atol=1e-4
        )


def test_batch_statistics_are_those_of_the_whole_batch(tiny_variables, tiny_views):
    """The first convolution's statistics, by hand over batch, views and pixels."""
    state = train_step_statistics(TINY, tiny_variables, tiny_views)
    images = tiny_views.reshape(-1, 12, 14)
    kernel = np.asarray(tiny_variables["params"]["features"]["stem_0"]["kernel"])[:, :, 0]
    padded = np.pad(images, ((0, 0), (1, 1), (1, 1)))
    convolved = sum(
        padded[:, i : i + 12, j : j + 14, None] * kernel[i, j] for i, j in np.ndindex(3, 3)
    )
    before = tiny_variables["batch_stats"]["features"]["stem_0_norm"]
    for name, value in (("mean", convolved.mean((0, 1, 2))), ("var", convolved.var((0, 1, 2)))):
        expected = 0.99 * before[name] + 0.01 * value
        np.testing.assert_allclose(
            state["features"]["stem_0_norm"][name], expected, rtol=1e-4, atol=1e-6
        )


def test_per_view_statistics_update_once_per_view(tiny_variables, tiny_views):
    network = OccCasNet(preset("tiny", feature_statistics="per_view"))
    state = train_step_statistics(network, tiny_variables, tiny_views)
    kernel = np.asarray(tiny_variables["params"]["features"]["stem_0"]["kernel"])[:, :, 0]
    expected = np.asarray(tiny_variables["batch_stats"]["features"]["stem_0_norm"]["mean"])
    for view in np.moveaxis(np.asarray(tiny_views).reshape(2, 9, 12, 14), 1, 0):
        padded = np.pad(view, ((0, 0), (1, 1), (1, 1)))
        convolved = sum(
            padded[:, i : i + 12, j : j + 14, None] * kernel[i, j] for i, j in np.ndindex(3, 3)
        )
        expected = 0.99 * expected + 0.01 * convolved.mean((0, 1, 2))
    np.testing.assert_allclose(
        state["features"]["stem_0_norm"]["mean"], expected, rtol=1e-4, atol=1e-6
    )


def test_gradients_reach_every_parameter_and_are_finite(tiny_variables, tiny_views):
    def loss(params):
        def one(views):
            return TINY.apply(
                {**tiny_variables, "params": params}, views, train=True, mutable=["batch_stats"]
            )[0]

        outputs = jax.vmap(one, axis_name="batch")(tiny_views)
        return sum(jnp.abs(stage.disparity - 0.3).mean() for stage in outputs)

    gradients = jax.jit(jax.grad(loss))(tiny_variables["params"])
    for path, gradient in jax.tree_util.tree_leaves_with_path(gradients):
        assert np.isfinite(gradient).all(), path
        assert np.abs(gradient).max() > 0, path


def test_the_warp_option_swaps_rows_and_columns_of_the_occlusion_maps(tiny_variables, tiny_views):
    """A light field whose views and images are both transposed, seen with the other warp."""
    views = tiny_views[0]
    disparity = 0.7 * jnp.ones((12, 14))
    transposed = OccCasNet(preset("tiny", warp="transposed"))
    wrong = transposed.apply(tiny_variables, 1, views, disparity, method="occlusion")
    swapped = TINY.apply(
        tiny_variables, 1, views.transpose(1, 0, 2, 3), disparity, method="occlusion"
    )
    np.testing.assert_allclose(wrong, swapped.transpose(1, 0, 2, 3), rtol=1e-5, atol=1e-6)
    right = TINY.apply(tiny_variables, 1, views, disparity, method="occlusion")
    assert np.abs(right - wrong).max() > 0.1


def test_candidates_can_be_given_at_run_time(tiny_variables, tiny_views):
    configured = jnp.array(preset("tiny").stages[0].candidates)
    apply = jax.jit(
        lambda candidates: TINY.apply(tiny_variables, tiny_views[0], candidates=candidates)
    )
    plain = jax.jit(TINY.apply)(tiny_variables, tiny_views[0])
    same, moved = apply(configured), apply(configured + 1.5)
    np.testing.assert_allclose(same[0].disparity, plain[0].disparity, rtol=1e-5, atol=1e-5)
    assert moved[0].disparity.min() >= configured[0] + 1.5
    assert apply._cache_size() == 1


def test_ground_truth_occlusion_needs_and_uses_the_ground_truth(tiny_variables, tiny_views):
    config = preset("tiny")
    stage = config.stages[1].__class__(**{**config.stages[1].__dict__, "occlusion": "ground_truth"})
    network = OccCasNet(preset("tiny", stages=(config.stages[0], stage)))
    with pytest.raises(ValueError, match="ground truth"):
        network.apply(tiny_variables, tiny_views[0])
    truth = jnp.full((12, 14), 0.5)
    _, refined = network.apply(tiny_variables, tiny_views[0], ground_truth=truth)
    views = tiny_views[0]
    expected = np.clip(
        np.abs((views[0, 1, 4, 5] + views[0, 1, 5, 5]) / 2 - views[1, 1, 4, 5]), 0, 1
    )  # view row -1 of disparity 0.5 is read half a pixel below
    np.testing.assert_allclose(refined.occlusion[0, 1, 4, 5], expected, rtol=1e-5)


def test_bfloat16_stays_near_float32(tiny_variables, tiny_views, tolerance):
    half = OccCasNet(preset("tiny"), dtype=jnp.bfloat16)
    exact = jax.jit(TINY.apply)(tiny_variables, tiny_views[0])[-1].disparity
    with jax.numpy_dtype_promotion("standard"):  # Flax's BatchNorm subtracts float32 statistics
        rounded = jax.jit(half.apply)(tiny_variables, tiny_views[0])[-1].disparity
    assert rounded.dtype == jnp.float32
    candidates = preset("tiny").stages[0].candidates
    disparity_range = candidates[-1] - candidates[0]
    assert np.abs(exact - rounded).mean() < tolerance("bfloat16")["rtol"] * disparity_range


def test_a_volume_of_statistics_has_the_mean_and_variance_over_the_views():
    network = OccCasNet(TINY.config.with_stages(attention=False, volume="statistics"))
    features = np.random.default_rng(0).normal(size=(3, 3, 6, 5, 4)).astype(np.float32)
    here = jnp.zeros(1)  # where views are in register as they are
    coarse = network.apply({}, 0, jnp.asarray(features), here, None, None, method="volume")
    maps = jnp.zeros((3, 3, 6, 5)).at[0].set(1.0)  # the upper row is occluded
    refined = network.apply(
        {}, 1, jnp.asarray(features), here, jnp.zeros((6, 5)), maps, method="volume"
    )
    for volume, views in ((coarse, features.reshape(9, 6, 5, 4)), (refined, features[1:])):
        views = views.reshape(-1, 6, 5, 4)
        expected = np.concatenate([views.mean(0), views.var(0)], axis=-1)
        np.testing.assert_allclose(volume[0], expected, atol=1e-5)
