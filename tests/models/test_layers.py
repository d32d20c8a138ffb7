"""Layers against loops and closed forms."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.models import preset
from occjax.models.aggregation import ViewAttention
from occjax.models.features import FeatureNetwork, upsample
from occjax.models.layers import VolumeConv
from tests.reference.variables import random_variables


def convolve_by_loops(volume, kernel):
    padded = np.pad(volume, ((1, 1), (1, 1), (1, 1), (0, 0)))
    d, h, w, _ = volume.shape
    result = np.zeros((d, h, w, kernel.shape[-1]))
    for i, j, k in np.ndindex(3, 3, 3):
        result += padded[i : i + d, j : j + h, k : k + w] @ kernel[i, j, k]
    return result


@pytest.mark.parametrize("depth", [1, 2, 5])
def test_volume_convolution_is_the_three_dimensional_one(depth, tolerance):
    generator = np.random.default_rng(0)
    volume = generator.normal(size=(depth, 4, 5, 3)).astype(np.float32)
    kernel = generator.normal(size=(3, 3, 3, 3, 2)).astype(np.float32)
    result = VolumeConv(2).apply({"params": {"kernel": jnp.asarray(kernel)}}, jnp.asarray(volume))
    np.testing.assert_allclose(result, convolve_by_loops(volume, kernel), **tolerance("float32"))


def test_upsampling_keeps_the_corners_and_is_linear_between_them():
    corners = jnp.array([[0.0, 3.0], [10.0, 13.0]])[None, :, :, None]
    rows, columns = np.mgrid[0:6, 0:4]
    expected = rows / 5 * 10 + columns / 3 * 3
    np.testing.assert_allclose(upsample(corners, 6, 4)[0, ..., 0], expected, rtol=1e-6)


def test_upsampling_a_single_pixel_repeats_it():
    result = upsample(jnp.full((1, 1, 1, 1), 7.0), 3, 5)
    np.testing.assert_array_equal(result, np.full((1, 3, 5, 1), 7.0))


def test_attention_is_symmetric_under_all_flips_and_the_transpose():
    attention = ViewAttention(views=5, hidden=4)
    mean = jax.random.normal(jax.random.key(0), (5 * 5 * 2,))
    weights, _ = attention.init_with_output(jax.random.key(1), mean)
    np.testing.assert_array_equal(weights, weights.T)
    np.testing.assert_array_equal(weights, weights[::-1])
    np.testing.assert_array_equal(weights, weights[:, ::-1])
    assert len(np.unique(np.asarray(weights))) == 6  # one octant of a 5x5 grid


def test_features_of_a_view_do_not_depend_on_the_other_views():
    config = preset("tiny")
    network = FeatureNetwork(config.features)
    everything = random_variables(config)
    variables = {name: collection["features"] for name, collection in everything.items()}
    images = jax.random.uniform(jax.random.key(0), (3, 9, 10, 1))
    features = jax.jit(functools.partial(network.apply, train=False))
    together = features(variables, images)
    changed = features(variables, images.at[0].set(0.0).at[2].set(1.0))
    np.testing.assert_array_equal(together[1], changed[1])
    assert np.abs(together[0] - changed[0]).max() > 0.01
