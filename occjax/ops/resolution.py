"""Half the resolution and back.

A pixel of half resolution is a block of 2x2 pixels. Its centre lies between theirs, and a disparity
there is half as many of its pixels.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


def halve(
    maps: Float[Array, "*shape"], axes: tuple[int, int] = (-2, -1)
) -> Float[Array, "*halved"]:
    """Mean of each 2x2 pixels.

    Args:
        maps: Maps, ``[..., h, w]`` unless ``axes`` says otherwise; h and w are even.
        axes: Rows and columns.

    Returns:
        The same with half as many rows and columns.

    Example:
        >>> halve(jnp.arange(4.0).reshape(2, 2)).tolist()
        [[1.5]]
    """
    for axis in axes:
        first, second = (
            jax.lax.slice_in_dim(maps, start, None, stride=2, axis=axis) for start in (0, 1)
        )
        maps = first + second
    return maps / 4


def double(
    maps: Float[Array, "*shape"], axes: tuple[int, int] = (-2, -1)
) -> Float[Array, "*doubled"]:
    """Each pixel as 2x2 pixels: the grid that :func:`halve` came from.

    Args:
        maps: Maps, ``[..., h, w]`` unless ``axes`` says otherwise.
        axes: Rows and columns.

    Returns:
        The same with twice as many rows and columns.

    Example:
        >>> double(jnp.array([[1.0, 2.0]])).tolist()
        [[1.0, 1.0, 2.0, 2.0], [1.0, 1.0, 2.0, 2.0]]
    """
    for axis in axes:
        maps = jnp.repeat(maps, 2, axis)
    return maps


def blocks(maps: Float[Array, "*n h w"]) -> Float[Array, "*n 2 2 i j"]:
    """The pixels of each 2x2 block apart, so that they lie beside those of :func:`halve`.

    Args:
        maps: ``[..., h, w]``; h and w are even.

    Returns:
        ``[..., 2, 2, h / 2, w / 2]``: row and column in the block, then the block's.

    Example:
        >>> blocks(jnp.arange(8.0).reshape(2, 4))[1, 0].tolist()
        [[4.0, 6.0]]
    """
    *n, h, w = maps.shape
    apart = maps.reshape(*n, h // 2, 2, w // 2, 2)
    return jnp.moveaxis(apart, (-3, -1), (-4, -3))


def unblocked(maps: Float[Array, "*n 2 2 i j"]) -> Float[Array, "*n h w"]:
    """The inverse of :func:`blocks`.

    Example:
        >>> maps = jnp.arange(8.0).reshape(2, 4)
        >>> bool((unblocked(blocks(maps)) == maps).all())
        True
    """
    *n, _, _, i, j = maps.shape
    return jnp.moveaxis(maps, (-4, -3), (-3, -1)).reshape(*n, 2 * i, 2 * j)
