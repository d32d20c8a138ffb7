"""Padding against ``numpy.pad``."""

import jax.numpy as jnp
import numpy as np
import pytest

from occjax.kernels.padding import pad_borders


@pytest.mark.parametrize("shape", [(5, 6), (1, 1), (2, 3, 4, 5)])
@pytest.mark.parametrize("margins", [((0, 0), (0, 0)), ((2, 3), (4, 1)), ((0, 7), (7, 0))])
def test_the_outermost_pixels_are_replicated(shape, margins):
    images = np.random.default_rng(0).random(shape, np.float32)
    expected = np.pad(images, [(0, 0)] * (len(shape) - 2) + list(margins), mode="edge")
    np.testing.assert_array_equal(pad_borders(jnp.asarray(images), *margins), expected)
