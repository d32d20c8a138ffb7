"""Layers against loops and closed forms."""

import functools

import jax
import jax.numpy as jnp
import numpy as np

from occjax.models import preset
from occjax.models.aggregation import ViewAttention
from occjax.models.features import FeatureNetwork, upsample
from occjax.models.layers import (
    Residual3x3,
    depth_to_space,
    space_to_depth,
)
from occjax.ops.convolution import convolve_images
from tests.reference.variables import random_variables


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


def test_four_pixels_become_four_groups_of_channels_and_back():
    images = np.random.default_rng(0).normal(size=(2, 4, 6, 3)).astype(np.float32)
    blocks = np.asarray(space_to_depth(jnp.asarray(images)))
    for row, column in np.ndindex(2, 2):
        first = 3 * (2 * row + column)
        expected = images[:, row::2, column::2]
        np.testing.assert_array_equal(blocks[..., first : first + 3], expected)
    np.testing.assert_array_equal(depth_to_space(jnp.asarray(blocks)), images)


def test_a_residual_block_adds_half_of_what_two_convolutions_make():
    layer = Residual3x3()
    images = jnp.asarray(np.random.default_rng(0).normal(size=(1, 4, 5, 2)), jnp.float32)
    variables = random_variables_of(layer, images)
    first, second = (variables["params"][name] for name in ("conv_0", "conv_1"))

    def convolved(x, layer):
        return convolve_images(x, layer["kernel"]) + layer["bias"][None, None, None]

    added = convolved(jax.nn.relu(convolved(images, first)), second)
    expected = np.maximum(images + 0.5 * added, 0)
    np.testing.assert_allclose(layer.apply(variables, images), expected, atol=1e-5)


def random_variables_of(layer, *arguments):
    """Of any layer, biases too."""
    generator = np.random.default_rng(5)
    return jax.tree.map(
        lambda array: jnp.asarray(generator.normal(size=array.shape), jnp.float32),
        layer.init(jax.random.key(0), *arguments),
    )
