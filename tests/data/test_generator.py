"""Random light fields against independent geometry in NumPy, and against what was asked for."""

import jax
import numpy as np
import pytest

from occjax.data.generator import (
    SceneConfig,
    generate,
)

SMALL = SceneConfig(image_size=(40, 48), grid=(3, 3), views="all", sheets=3, solids=3)


@pytest.fixture(scope="module")
def samples():
    """A few small light fields."""
    keys = jax.random.split(jax.random.key(7), 6)
    return [jax.tree.map(np.asarray, generate(key, SMALL)) for key in keys]


def test_shapes_and_ranges(samples):
    for sample in samples:
        assert sample.views.shape == sample.visibility.shape == (3, 3, 40, 48)
        assert sample.disparity.shape == sample.valid.shape == (40, 48)
        assert sample.views.min() >= 0.0
        assert sample.views.max() <= 1.0
        assert np.isfinite(sample.views).all()
        assert sample.disparity.min() >= SMALL.disparity_range[0]
        assert sample.disparity.max() <= SMALL.disparity_range[1]
        assert sample.valid.all()
        assert sample.visibility[1, 1].all()
