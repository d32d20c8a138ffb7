"""Padding against ``numpy.pad``, and maps that are stored."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.kernels.padding import materialised, pad_borders


@pytest.mark.parametrize("shape", [(5, 6), (1, 1), (2, 3, 4, 5)])
@pytest.mark.parametrize("margins", [((0, 0), (0, 0)), ((2, 3), (4, 1)), ((0, 7), (7, 0))])
def test_the_outermost_pixels_are_replicated(shape, margins):
    images = np.random.default_rng(0).random(shape, np.float32)
    expected = np.pad(images, [(0, 0)] * (len(shape) - 2) + list(margins), mode="edge")
    np.testing.assert_array_equal(pad_borders(jnp.asarray(images), *margins), expected)


@pytest.mark.skipif(jax.default_backend() != "cpu", reason="other platforms fuse differently")
def test_materialised_maps_are_computed_once_for_all_readers():
    def read(values, position):
        index = materialised((31.5 + 31.5 * jnp.sin(position)).astype(jnp.int32))
        return [values[index + step] for step in range(4)]

    values, position = np.arange(128.0, dtype=np.float32), np.full((5, 6), 0.5, np.float32)
    program = jax.jit(read).lower(values, position).compile()
    assert program.as_text().count(" sine(") == 1  # 4, one for each reader, if it is not stored
    index = int(31.5 + 31.5 * np.sin(0.5))
    expected = [np.full((5, 6), index + step) for step in range(4)]
    np.testing.assert_array_equal(program(values, position), expected)
