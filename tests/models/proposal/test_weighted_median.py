"""Weighted median: against sorted values in a NumPy loop, and at a depth edge."""

import jax
import jax.numpy as jnp
import numpy as np

from occjax.models.proposal.config import WeightedMedianConfig
from occjax.models.proposal.weighted_median import replace_uncertain

replace = jax.jit(replace_uncertain, static_argnames="config")


def reference(disparity, confidence, centre, config):
    """Sort the values around each uncertain pixel; take the first with half of the weight."""
    result = disparity.copy()
    height, width = disparity.shape
    samples = np.arange(-config.radius_px, config.radius_px + 1)
    for y, x in np.argwhere(confidence < config.max_confidence):
        votes = []
        for dy in samples:
            for dx in samples:
                place = min(max(y + dy, 0), height - 1), min(max(x + dx, 0), width - 1)
                weight = np.exp(-(dy**2 + dx**2) / (2 * config.deviation_px**2))
                weight *= np.exp(-abs(centre[place] - centre[y, x]) / config.grey_scale)
                votes.append((disparity[place], weight * (confidence[place] ** 2 + 1e-6)))
        values, weights = np.array(sorted(votes)).T
        result[y, x] = values[np.searchsorted(np.cumsum(weights), weights.sum() / 2)]
    return result


def test_it_is_the_weighted_median_of_the_samples():
    generator = np.random.default_rng(0)
    disparity, confidence, centre = generator.random((3, 17, 14), np.float32)
    centre /= 10
    for config in (WeightedMedianConfig(), WeightedMedianConfig(0.5, 1, 2.0, 0.05)):
        expected = reference(disparity, confidence, centre, config)
        found = np.asarray(replace(disparity, confidence, centre, config=config))
        assert (found != disparity).sum() > 50
        np.testing.assert_array_equal(found, expected)


def test_an_uncertain_pixel_at_a_depth_edge_takes_the_side_of_its_colour():
    near = np.arange(15) >= 7
    disparity = np.tile(np.where(near, 2.0, -1.0).astype(np.float32), (15, 1))
    centre = np.tile(np.where(near, 0.6, 0.3).astype(np.float32), (15, 1))
    confidence = np.ones_like(disparity)
    wrong = disparity.copy()
    wrong[5:9, 6], confidence[5:9, 6] = 2.0, 0.2  # fattened by a pixel
    wrong[3, 3], confidence[3, 3] = 9.0, 0.0
    found = replace(wrong, confidence, centre, config=WeightedMedianConfig())
    np.testing.assert_array_equal(found, disparity)


def test_where_nothing_is_certain_all_pixels_count():
    disparity = jnp.asarray(np.random.default_rng(1).random((9, 9), np.float32))
    config = WeightedMedianConfig(radius_px=1, deviation_px=1e6)
    found = replace(disparity, jnp.zeros((9, 9)), jnp.zeros((9, 9)), config=config)
    assert float(found[4, 4]) == float(jnp.median(disparity[3:6, 3:6]))
