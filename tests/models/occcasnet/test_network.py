"""OccCasNet as a function: shapes, vmap, statistics of training, options, gradients."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.models import OccCasNet, preset
from tests.reference.variables import random_variables
from tests.training.conftest import NETWORK

TINY = OccCasNet(preset("tiny", features=NETWORK.features))


@pytest.fixture(scope="module")
def tiny_variables():
    """Variables of the network with few layers of features."""
    return random_variables(TINY.config)


@pytest.fixture(scope="module")
def outputs(tiny_variables, tiny_views):
    """Outputs of the tiny network for both light fields, one after the other."""
    apply = jax.jit(TINY.apply)
    return [apply(tiny_variables, views) for views in tiny_views]


def test_every_stage_estimates_every_pixel(outputs, tolerance):
    coarse, refined = outputs[0]
    assert coarse.disparity.shape == refined.disparity.shape == (12, 14)
    assert coarse.probabilities.shape == (5, 12, 14)
    assert refined.probabilities.shape == (3, 12, 14)
    assert coarse.occlusion is None
    assert refined.occlusion.shape == (3, 3, 12, 14)
    np.testing.assert_allclose(coarse.probabilities.sum(0), 1.0, **tolerance("relative"))
    # A refinement cannot leave the range of its candidates.
    assert np.abs(refined.disparity - coarse.disparity).max() <= 0.5 + 1e-6


def test_vmap_agrees_with_a_loop(tiny_variables, tiny_views, outputs, tolerance):
    batched = jax.jit(jax.vmap(partial(TINY.apply, tiny_variables)))(tiny_views)
    expected = np.stack([stages[-1].disparity for stages in outputs])
    np.testing.assert_allclose(batched[-1].disparity, expected, **tolerance("float32"))


def stem_statistics(variables, views, **changes):
    """Statistics of the first BatchNorm after one training step, and before it."""
    network = OccCasNet(dataclasses.replace(TINY.config, **changes))

    def step(views):
        return network.apply(variables, views, train=True, mutable=["batch_stats"])

    _, state = jax.jit(jax.vmap(step, axis_name="batch", out_axes=(0, None)))(views)
    after, before = (
        stats["batch_stats"]["features"]["stem_0_norm"] for stats in (state, variables)
    )
    return after, {name: np.asarray(value) for name, value in before.items()}


def first_convolution(variables, images):
    """First convolution ``[..., h, w, 4]`` of the feature network, as a NumPy loop."""
    kernel = np.asarray(variables["params"]["features"]["stem_0"]["kernel"])[:, :, 0]
    h, w = images.shape[-2:]
    padded = np.pad(images, ((0, 0), (1, 1), (1, 1)))
    return sum(padded[:, i : i + h, j : j + w, None] * kernel[i, j] for i, j in np.ndindex(3, 3))


def test_pooled_statistics_are_those_of_the_whole_batch(tiny_variables, tiny_views, tolerance):
    after, before = stem_statistics(tiny_variables, tiny_views)
    convolved = first_convolution(tiny_variables, tiny_views.reshape(-1, 12, 14))
    for name, value in (("mean", convolved.mean((0, 1, 2))), ("var", convolved.var((0, 1, 2)))):
        expected = 0.99 * before[name] + 0.01 * value
        np.testing.assert_allclose(after[name], expected, **tolerance("relative"))


def test_per_view_statistics_are_updated_once_per_view(tiny_variables, tiny_views, tolerance):
    after, before = stem_statistics(tiny_variables, tiny_views, feature_statistics="per_view")
    expected = before["mean"]
    for view in np.moveaxis(np.asarray(tiny_views).reshape(2, 9, 12, 14), 1, 0):
        expected = 0.99 * expected + 0.01 * first_convolution(tiny_variables, view).mean((0, 1, 2))
    np.testing.assert_allclose(after["mean"], expected, **tolerance("relative"))


@pytest.mark.slow
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


def test_transposed_warp_swaps_rows_and_columns_of_the_occlusion_maps(
    tiny_variables, tiny_views, tolerance
):
    """A transposed grid with the correct warp equals the grid with the transposed warp."""
    views, disparity = tiny_views[0], 0.7 * jnp.ones((12, 14))

    def maps(views, warp):
        network = OccCasNet(dataclasses.replace(TINY.config, warp=warp))
        return network.apply(tiny_variables, 1, views, disparity, method="occlusion")

    transposed = maps(views, "transposed")
    swapped = maps(views.transpose(1, 0, 2, 3), "correct").transpose(1, 0, 2, 3)
    np.testing.assert_allclose(transposed, swapped, **tolerance("absolute"))
    assert np.abs(maps(views, "correct") - transposed).max() > 0.1


def test_candidates_are_an_argument(tiny_variables, tiny_views, outputs, tolerance):
    configured = jnp.array(TINY.config.stages[0].candidates)
    apply = jax.jit(
        lambda candidates: TINY.apply(tiny_variables, tiny_views[0], candidates=candidates)
    )
    same, moved = apply(configured)[0], apply(configured + 1.5)[0]
    np.testing.assert_allclose(same.disparity, outputs[0][0].disparity, **tolerance("float32"))
    assert moved.disparity.min() >= configured[0] + 1.5


def test_exact_visibility_is_the_occlusion_map(tiny_variables, tiny_views):
    first, second = TINY.config.stages
    stages = (first, dataclasses.replace(second, occlusion="visibility"))
    network, views = OccCasNet(dataclasses.replace(TINY.config, stages=stages)), tiny_views[0]
    with pytest.raises(ValueError, match="visibility of every view"):
        network.apply(tiny_variables, 1, views, None, method="occlusion")
    visibility = views > 0.5
    maps = network.apply(tiny_variables, 1, views, None, None, visibility, method="occlusion")
    np.testing.assert_array_equal(maps, np.where(visibility, 0.0, 1.0))


def test_ground_truth_occlusion_needs_and_uses_the_ground_truth(
    tiny_variables, tiny_views, tolerance
):
    first, second = TINY.config.stages
    stages = (first, dataclasses.replace(second, occlusion="ground_truth"))
    network, views = OccCasNet(dataclasses.replace(TINY.config, stages=stages)), tiny_views[0]
    with pytest.raises(ValueError, match="ground truth"):
        network.apply(tiny_variables, 1, views, None, method="occlusion")
    truth = jnp.full((12, 14), 0.5)
    maps = network.apply(tiny_variables, 1, views, None, truth, method="occlusion")
    # View row -1 of disparity 0.5 is read half a pixel below.
    expected = jnp.abs((views[0, 1, 4, 5] + views[0, 1, 5, 5]) / 2 - views[1, 1, 4, 5])
    np.testing.assert_allclose(maps[0, 1, 4, 5], expected, **tolerance("relative"))


def test_bfloat16_is_close_to_float32(tiny_variables, tiny_views, outputs, tolerance):
    half = OccCasNet(TINY.config, dtype=jnp.bfloat16)
    with jax.numpy_dtype_promotion("standard"):  # Flax's BatchNorm subtracts float32 statistics
        rounded = jax.jit(half.apply)(tiny_variables, tiny_views[0])[-1].disparity
    assert rounded.dtype == jnp.float32
    candidates = TINY.config.stages[0].candidates
    limit = tolerance("bfloat16")["rtol"] * (candidates[-1] - candidates[0])
    assert np.abs(outputs[0][-1].disparity - rounded).mean() < limit


def test_volume_of_statistics_is_mean_and_variance_over_the_views(uniform, tolerance):
    network = OccCasNet(TINY.config.with_stages(attention=False, volume="statistics"))
    features, zero = uniform(3, 3, 6, 5, 4), jnp.zeros(1)  # registered at disparity 0
    coarse = network.apply({}, 0, features, zero, None, None, method="volume")
    maps = jnp.zeros((3, 3, 6, 5)).at[0].set(1.0)  # the upper row is occluded
    refined = network.apply({}, 1, features, zero, jnp.zeros((6, 5)), maps, method="volume")
    for volume, views in ((coarse, features), (refined, features[1:])):
        views = np.asarray(views).reshape(-1, 6, 5, 4)
        expected = np.concatenate([views.mean(0), views.var(0)], axis=-1)
        np.testing.assert_allclose(volume[0], expected, **tolerance("absolute"))
