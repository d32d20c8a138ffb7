"""Half the resolution and back, by loops."""

import jax.numpy as jnp
import numpy as np
import pytest

from occjax.ops.resolution import blocks, double, halve, unblocked

MAPS = np.random.default_rng(0).random((3, 4, 6)).astype(np.float32)


def test_halving_is_the_mean_of_blocks():
    expected = [
        [[image[2 * i : 2 * i + 2, 2 * j : 2 * j + 2].mean() for j in range(3)] for i in range(2)]
        for image in MAPS
    ]
    np.testing.assert_allclose(halve(jnp.asarray(MAPS)), expected, rtol=1e-6)


@pytest.mark.parametrize("axes", [(-2, -1), (0, 1), (0, 2)])
def test_what_is_doubled_is_halved_to_what_it_was(axes):
    doubled = double(jnp.asarray(MAPS), axes)
    shape = list(MAPS.shape)
    for axis in axes:
        shape[axis] *= 2
    assert doubled.shape == tuple(shape)
    np.testing.assert_array_equal(halve(doubled, axes), MAPS)


def test_each_pixel_becomes_four_of_its_value():
    doubled = np.asarray(double(jnp.asarray(MAPS)))
    for y in range(8):
        for x in range(12):
            np.testing.assert_array_equal(doubled[:, y, x], MAPS[:, y // 2, x // 2])


def test_blocks_lie_beside_what_halving_gives():
    apart = np.asarray(blocks(jnp.asarray(MAPS)))
    assert apart.shape == (3, 2, 2, 2, 3)
    for y in range(4):
        for x in range(6):
            np.testing.assert_array_equal(apart[:, y % 2, x % 2, y // 2, x // 2], MAPS[:, y, x])
    np.testing.assert_array_equal(unblocked(jnp.asarray(apart)), MAPS)
