"""The sorting network against NumPy's median of each window."""

import jax.numpy as jnp
import numpy as np
import pytest

from occjax.kernels.median import median_filter


@pytest.mark.parametrize("shape", [(5, 6), (1, 6), (6, 1)])
@pytest.mark.parametrize("kind", [np.asarray, jnp.asarray])
def test_median_filter_is_the_median_of_each_window(kind, shape):
    image = np.random.default_rng(0).random(shape, np.float32)
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(image, 1, mode="edge"), (3, 3))
    medians = median_filter(kind(image))
    assert type(medians) is type(kind(image))
    np.testing.assert_array_equal(medians, np.median(windows, (2, 3)))
