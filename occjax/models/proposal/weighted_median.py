"""Weighted median around uncertain pixels: the disparity of the certain pixels that look alike.

The weights are those of Ma et al. (Constant Time Weighted Median Filtering for Stereo Matching and
Beyond, ICCV 2013), times the squared confidence. Unlike a mean, a median does not blend the
disparities of the two sides of a depth edge.
"""

from __future__ import annotations

import itertools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from occjax.kernels.reductions import sum_leading
from occjax.models.proposal.config import WeightedMedianConfig


def replace_uncertain(
    disparity: Float[Array, "h w"],
    confidence: Float[Array, "h w"],
    centre: Float[Array, "h w"],
    config: WeightedMedianConfig,
) -> Float[Array, "h w"]:
    """Replace the disparity of uncertain pixels by the weighted median of the pixels around them.

    Args:
        disparity: ``[h, w]`` disparity map.
        confidence: ``[h, w]`` its confidence in [0, 1].
        centre: ``[h, w]`` grey centre view.
        config: Settings.

    Returns:
        ``[h, w]`` disparity map; pixels of sufficient confidence keep their disparity.

    Example:
        >>> wall = jnp.ones((9, 9)).at[4, 4].set(5.0)
        >>> certain = jnp.ones((9, 9)).at[4, 4].set(0.1)
        >>> grey = jnp.full((9, 9), 0.5)
        >>> float(replace_uncertain(wall, certain, grey, WeightedMedianConfig()).max())
        1.0
    """
    height, width = disparity.shape
    margin = config.radius_px
    corners = list(itertools.product(range(2 * margin + 1), repeat=2))

    # Where nothing is certain, all pixels count.
    maps = jnp.stack([jnp.square(confidence) + 1e-6, centre, disparity])
    margins = [(0, 0), (margin, margin), (margin, margin)]
    padded = jnp.pad(maps, margins, mode="edge")

    def weight(corner: Int[Array, "2"]) -> Float[Array, "h w"]:
        certainty, grey, _ = jax.lax.dynamic_slice(padded, (0, *corner), (3, height, width))
        distance = jnp.square(corner - margin).sum().astype(centre.dtype)
        proximity = jnp.exp(-distance / (2 * config.deviation_px**2))
        return proximity * certainty * jnp.exp(-jnp.abs(grey - centre) / config.grey_scale)

    weights = jax.lax.map(weight, jnp.asarray(corners))
    disparities = padded[2]
    half = sum_leading(weights) / 2

    def lower(median: Float[Array, "h w"], corner: Int[Array, "2"]):
        value = jax.lax.dynamic_slice(disparities, corner, (height, width))
        # Sums of slices are one loop over the pixels; a stack would be read from memory.
        others = (disparities[y : y + height, x : x + width] for y, x in corners)
        terms = zip(others, weights, strict=True)
        weight_up_to_value = sum(jnp.where(other <= value, weight, 0.0) for other, weight in terms)
        found = (weight_up_to_value >= half) & (value < median)
        return jnp.where(found, value, median), None

    # The median is the smallest value up to which there is half of the weight.
    start = jnp.full_like(disparity, jnp.inf)
    median, _ = jax.lax.scan(lower, start, jnp.asarray(corners))
    return jnp.where(confidence < config.max_confidence, median, disparity)
