"""Half resolution and back.

At half resolution a pixel is a block of 2x2 pixels. Its centre is the centre of the block, and
disparities in pixels are half as large.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


def downsample2x(
    maps: Float[Array, "*shape"], axes: tuple[int, int] = (-2, -1)
) -> Float[Array, "*half"]:
    """Compute the mean of each block of 2x2 pixels.

    Args:
        maps: Maps, ``[..., h, w]`` by default; h and w must be even.
        axes: Axes of rows and columns.

    Returns:
        Maps with half as many rows and columns.

    Example:
        >>> downsample2x(jnp.arange(4.0).reshape(2, 2)).tolist()
        [[1.5]]
    """
    for axis in axes:
        first, second = (
            jax.lax.slice_in_dim(maps, start, None, stride=2, axis=axis) for start in (0, 1)
        )
        maps = first + second
    return maps / 4


def upsample2x(
    maps: Float[Array, "*shape"], axes: tuple[int, int] = (-2, -1)
) -> Float[Array, "*double"]:
    """Repeat each pixel as a block of 2x2 pixels.

    Args:
        maps: Maps, ``[..., h, w]`` by default.
        axes: Axes of rows and columns.

    Returns:
        Maps with twice as many rows and columns.

    Example:
        >>> upsample2x(jnp.array([[1.0, 2.0]])).tolist()
        [[1.0, 1.0, 2.0, 2.0], [1.0, 1.0, 2.0, 2.0]]
    """
    for axis in axes:
        maps = jnp.repeat(maps, 2, axis)
    return maps


def space_to_depth(images: Float[Array, "n h w c"]) -> Float[Array, "n i j k"]:
    """Store each block of 2x2 pixels as one pixel with four times as many channels.

    A convolution with few channels at full resolution takes as long as one with many channels at
    half resolution.

    Args:
        images: ``[n, h, w, c]`` images; h and w must be even.

    Returns:
        ``[n, h / 2, w / 2, 4 c]``; channels in the order row, column, c.

    Example:
        >>> space_to_depth(jnp.arange(4.0).reshape(1, 2, 2, 1)).tolist()
        [[[[0.0, 1.0, 2.0, 3.0]]]]
    """
    n, h, w, c = images.shape
    blocks = images.reshape(n, h // 2, 2, w // 2, 2, c)
    return blocks.transpose(0, 1, 3, 2, 4, 5).reshape(n, h // 2, w // 2, 4 * c)


def depth_to_space(images: Float[Array, "n i j k"]) -> Float[Array, "n h w c"]:
    """Invert :func:`space_to_depth`.

    Args:
        images: ``[n, i, j, 4 c]`` images.

    Returns:
        ``[n, 2 i, 2 j, c]`` images.

    Example:
        >>> images = jnp.arange(24.0).reshape(1, 2, 4, 3)
        >>> bool((depth_to_space(space_to_depth(images)) == images).all())
        True
    """
    n, i, j, k = images.shape
    blocks = images.reshape(n, i, j, 2, 2, k // 4)
    return blocks.transpose(0, 1, 3, 2, 4, 5).reshape(n, 2 * i, 2 * j, k // 4)
