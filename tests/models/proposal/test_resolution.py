"""Half resolution and back."""

import jax.numpy as jnp
import numpy as np
import pytest

from occjax.models.proposal.resolution import (
    depth_to_space,
    downsample2x,
    space_to_depth,
    upsample2x,
)


def test_downsampling_is_the_mean_of_blocks(uniform, tolerance):
    maps = uniform(3, 4, 6)
    expected = [
        [[image[2 * i : 2 * i + 2, 2 * j : 2 * j + 2].mean() for j in range(3)] for i in range(2)]
        for image in maps
    ]
    np.testing.assert_allclose(downsample2x(maps), expected, **tolerance("relative"))


@pytest.mark.parametrize("axes", [(-2, -1), (0, 1), (0, 2)])
def test_upsampling_repeats_each_pixel(axes, uniform):
    maps = uniform(3, 4, 6)
    upsampled = upsample2x(maps, axes)
    block = np.ones([2 if axis in (axes[0] % 3, axes[1] % 3) else 1 for axis in range(3)])
    np.testing.assert_array_equal(upsampled, np.kron(maps, block))
    np.testing.assert_array_equal(downsample2x(upsampled, axes), maps)


def test_blocks_become_channels_and_pixels_again(uniform):
    images = uniform(2, 4, 6, 3)
    blocks = np.asarray(space_to_depth(images))
    for row, column in np.ndindex(2, 2):
        first = 3 * (2 * row + column)
        expected = images[:, row::2, column::2]
        np.testing.assert_array_equal(blocks[..., first : first + 3], expected)
    np.testing.assert_array_equal(depth_to_space(jnp.asarray(blocks)), images)
