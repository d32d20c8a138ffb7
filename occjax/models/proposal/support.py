"""Support of the proposals of a pixel by the pixels around it that have its colour.

On a blank wall next to a thin object, the costs do not tell the disparity of the wall from that of
the object. The certain pixels of the wall have the colour of the pixel, and the disparity of one
of its proposals. This is the adaptive support of Yoon and Kweon (Adaptive Support-Weight Approach
for Correspondence Search, PAMI 2006), with disparities that are already selected instead of
matching costs, over a large window. The supporting pixels continue their surfaces by their slope.

Disparities are those at the configured reach.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from occjax.kernels.padding import pad_borders
from occjax.kernels.reductions import sum_leading
from occjax.models.proposal.config import SupportConfig


def proposal_support(
    proposed: Float[Array, "k h w"],
    disparity: Float[Array, "h w"],
    slopes: Float[Array, "2 h w"],
    confidence: Float[Array, "h w"],
    appearance: Float[Array, "c h w"],
    config: SupportConfig,
) -> Float[Array, "k h w"]:
    """Compute how much the pixels around each pixel support each of its proposals.

    A pixel at the offset ``o`` supports a proposal by the product of its squared confidence, the
    similarity of its appearance ``exp(-|difference| / appearance_scale)``, with the mean over the
    channels, and the agreement ``1 / (1 + ((d - d_o) / disparity_scale)^2)`` of the proposal ``d``
    with the disparity ``d_o`` of its surface, continued by its slope.

    Args:
        proposed: ``[k, h, w]`` proposed disparities.
        disparity: ``[h, w]`` selected disparity.
        slopes: ``[2, h, w]`` its slope along rows and columns, per pixel.
        confidence: ``[h, w]`` its confidence in [0, 1].
        appearance: ``[c, h, w]`` colour or grey of the centre view.
        config: Settings.

    Returns:
        ``[k, h, w]`` support in [0, 1]: the mean over the window, in which pixels outside of the
        image count as 0.

    Example:
        >>> blue = jnp.arange(16) < 8
        >>> appearance = jnp.tile(jnp.where(blue, 0.2, 0.6), (1, 16, 1))
        >>> disparity = jnp.tile(jnp.where(blue, -1.0, 2.0), (16, 1))
        >>> slopes = jnp.zeros((2, 16, 16))
        >>> proposed = jnp.stack([jnp.full((16, 16), -1.0), jnp.full((16, 16), 2.0)])
        >>> support = proposal_support(
        ...     proposed, disparity, slopes, jnp.ones((16, 16)), appearance, SupportConfig()
        ... )
        >>> (support[0] > support[1])[8].astype(int).tolist()
        [1, 1, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0]
    """
    height, width = disparity.shape
    radius, channels = config.radius_px, len(appearance)
    padded = pad_window_maps(appearance, disparity, slopes, jnp.square(confidence), radius)
    starts = range(0, 2 * radius + 1, config.step_px)  # of the shifted images in the padded one

    def add_row(sums: Float[Array, "k h w"], row: Array) -> tuple[Float[Array, "k h w"], None]:
        strip = jax.lax.dynamic_slice(
            padded, (0, row, 0), (len(padded), height, width + 2 * radius)
        )
        distance = (row - radius).astype(disparity.dtype)
        terms = []
        for column in starts:
            shifted = strip[:, :, column : column + width]
            difference = sum_leading(jnp.abs(shifted[:channels] - appearance)) / channels
            surface, slope_down, slope_right, weight = shifted[channels:]
            surface = surface - distance * slope_down - float(column - radius) * slope_right
            weight = weight * jnp.exp(-difference / config.appearance_scale)
            terms.append(
                weight[None]
                / (1.0 + jnp.square((proposed - surface[None]) / config.disparity_scale))
            )
        return sums + sum(terms), None

    support, _ = jax.lax.scan(add_row, jnp.zeros_like(proposed), jnp.array(starts))
    return support / len(starts) ** 2


def pad_window_maps(
    appearance: Float[Array, "c h w"],
    disparity: Float[Array, "h w"],
    slopes: Float[Array, "2 h w"],
    weights: Float[Array, "h w"],
    radius: int,
) -> Float[Array, "m i j"]:
    """Stack the maps of the pixels around, padded so that each window lies within them.

    Args:
        appearance: ``[c, h, w]`` colour or grey of the centre view.
        disparity: ``[h, w]`` disparity of each pixel.
        slopes: ``[2, h, w]`` its slope along rows and columns, per pixel.
        weights: ``[h, w]`` weight of each pixel.
        radius: Half width of the window, in pixels.

    Returns:
        ``[c + 4, h + 2 radius, w + 2 radius]`` appearance, disparity, slopes and weight; the weight
        of pixels outside of the image is 0.
    """
    margins = (radius, radius), (radius, radius)
    maps = pad_borders(jnp.concatenate([appearance, disparity[None], slopes]), *margins)
    return jnp.concatenate([maps, jnp.pad(weights, margins)[None]])
