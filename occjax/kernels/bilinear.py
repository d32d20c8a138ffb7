"""Bilinear taps, and fast bilinear reads of one or two channels with the border replicated.

The reference of :func:`warp_plane` and :func:`warp_packed_pair` is :func:`occjax.ops.warp`.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Float16, Int, UInt32

from occjax.kernels.padding import materialised
from occjax.lightfield import project


def whole_and_fraction(
    displacement: Float[Array, "2"], size: tuple[int, int], dtype: jnp.dtype
) -> tuple[Int[Array, "2"], Float[Array, "2"]]:
    """Split a displacement ``(row, column)`` into whole pixels and a fraction in [0, 1).

    A shift by more than the size of the image reads only the zeros outside it. Therefore the whole
    pixels can be clamped to ``[-size - 2, size + 1]``, which keeps them in the range of int32.

    Args:
        displacement: ``[2]`` displacement, in pixels.
        size: ``(h, w)`` of the image, in pixels.
        dtype: Type of the fraction.

    Returns:
        ``[2]`` int32 whole pixels and ``[2]`` fraction.
    """
    whole = jnp.floor(displacement)
    fraction = (displacement - whole).astype(dtype)
    limit = jnp.array(size, whole.dtype)
    whole = jnp.clip(jax.lax.stop_gradient(whole), -limit - 2.0, limit + 1.0)
    return whole.astype(jnp.int32), fraction


def displaced_plane(
    padded: Float[Array, "*n i j"],
    plane: tuple[ArrayLike, ...],
    displacement: Float[Array, "2"],
    margin: int,
) -> Float[Array, "h w"]:
    """Read a plane ``[h, w]`` at a displacement, bilinearly, from planes padded on all sides.

    Unlike :func:`occjax.ops.shift`, it reads an array that was padded once for all displacements.
    Four slices and their weighted sum fuse into one pass over memory.

    Args:
        padded: ``[*n, h + 2 margin + 1, w + 2 margin + 1]`` planes with ``margin`` pixels more at
            the top and left, and ``margin + 1`` more at the bottom and right.
        plane: Index of the plane, one number for each leading axis.
        displacement: ``[2]`` displacement ``(row, column)``, in pixels; limited to the margin.
        margin: Pixels of the padding.

    Returns:
        ``[h, w]``: ``plane(y + displacement[0], x + displacement[1])``.

    Example:
        >>> ramp = jnp.tile(jnp.arange(3.0), (3, 1))
        >>> padded = jnp.pad(ramp, (1, 2), mode="edge")
        >>> displaced_plane(padded[None], (0,), jnp.array([0.0, 0.5]), 1)[0].tolist()
        [0.5, 1.5, 2.0]
    """
    size = tuple(side - 2 * margin - 1 for side in padded.shape[-2:])
    displacement = jnp.clip(displacement, -margin, margin)
    whole = jax.lax.stop_gradient(jnp.floor(displacement))
    row_fraction, column_fraction = (displacement - whole).astype(padded.dtype)
    row, column = whole.astype(jnp.int32) + margin

    def tap(down, right):
        start = (*plane, row + down, column + right)
        return jax.lax.dynamic_slice(padded, start, (*(1 for _ in plane), *size)).reshape(size)

    left = tap(0, 0) * (1 - row_fraction) + tap(1, 0) * row_fraction
    right = tap(0, 1) * (1 - row_fraction) + tap(1, 1) * row_fraction
    return left * (1 - column_fraction) + right * column_fraction


def base_and_fraction(coordinate: Array, size: int) -> tuple[Array, Array]:
    """Return the lower bilinear tap in [0, size - 2] and the weight of the upper tap in [0, 1].

    In an image one pixel wide the taps are -1 and 0; index -1 is that pixel too.
    """
    base = jax.lax.stop_gradient(jnp.clip(jnp.floor(coordinate), 0.0, size - 2.0))
    fraction = coordinate - base
    # jnp.clip would halve the derivative at 0, which is the fraction at every whole pixel.
    fraction = jnp.where(fraction < 0.0, 0.0, jnp.where(fraction >= 1.0, 1.0, fraction))
    return base.astype(jnp.int32), fraction


def project_pixels(
    disparity: Float[Array, "h w"], offset: Float[Array, "2"], first_row: int | Int[Array, ""] = 0
) -> tuple[Float[Array, "h w"], Float[Array, "h w"]]:
    """Project pixels of the centre view into another view; rows and columns, in pixels.

    ``first_row`` is the row of the centre view at which ``disparity`` begins.
    """
    h, w = disparity.shape
    y = (jnp.arange(h, dtype=disparity.dtype) + jnp.asarray(first_row, disparity.dtype))[:, None]
    x = jnp.arange(w, dtype=disparity.dtype)[None, :]
    return project(y, x, disparity, offset)


def inside_view(disparity: Float[Array, "h w"], offset: Float[Array, "2"]) -> Bool[Array, "h w"]:
    """Return where the points of the centre view lie within the image of another view."""
    h, w = disparity.shape
    y, x = project_pixels(disparity, offset)
    return (y >= 0) & (y <= h - 1) & (x >= 0) & (x <= w - 1)


def warp_plane(
    image: Float[Array, "h w"], disparity: Float[Array, "h w"], offset: Float[Array, "2"]
) -> Float[Array, "h w"]:
    """Warp a single channel; equals :func:`occjax.ops.warp` with a replicated border.

    XLA fuses the bilinear taps of an ``[h, w]`` image into the surrounding arithmetic. It cannot do
    so for arrays with a short trailing axis.
    """
    taps, down, right = _taps(image, disparity, offset)
    return _interpolate(taps, down.astype(image.dtype), right.astype(image.dtype))


def pack_pairs(images: Float16[Array, "*b h w 2"]) -> UInt32[Array, "*b h w"]:
    """Store two half-precision channels in the bits of one integer (:func:`warp_packed_pair`)."""
    return jax.lax.bitcast_convert_type(images, jnp.uint32)


def warp_packed_pair(
    pairs: UInt32[Array, "h w"], disparity: Float[Array, "h w"], offset: Float[Array, "2"]
) -> tuple[Float[Array, "h w"], Float[Array, "h w"]]:
    """Warp two channels at once; equals two calls of :func:`warp_plane`.

    Reads at scattered addresses take most of the time of a warp on a CPU. Packed pairs halve their
    number. The result has a derivative with respect to the disparity only.

    Args:
        pairs: ``[h, w]`` two channels packed by :func:`pack_pairs`.
        disparity: ``[h, w]`` disparity of the centre view, pixels per view step.
        offset: ``[2]`` offset ``(row, column)`` of the view from the centre view, in view steps.

    Returns:
        Two warped channels ``[h, w]``, float32.
    """
    taps, down, right = _taps(pairs, disparity, offset)

    def channel(shift):
        halves = [(tap >> jnp.uint32(shift)).astype(jnp.uint16) for tap in taps]
        values = [jax.lax.bitcast_convert_type(half, jnp.float16) for half in halves]
        return _interpolate([value.astype(jnp.float32) for value in values], down, right)

    return channel(0), channel(16)


def _taps(image: Array, disparity: Array, offset: Array) -> tuple[list[Array], Array, Array]:
    """Read the four bilinear taps ``[h, w]`` of each point and the fractions between them.

    The flat image is read, so that one index serves all four taps.
    """
    h, w = image.shape
    y, x = project_pixels(disparity, offset)
    row, down = base_and_fraction(y, h)
    column, right = base_and_fraction(x, w)
    # In an image one pixel high or wide both taps are that pixel.
    flat, base = image.reshape(-1), materialised(jnp.maximum(row, 0) * w + jnp.maximum(column, 0))
    row_step, column_step = min(h - 1, 1) * w, min(w - 1, 1)
    steps = (0, column_step, row_step, row_step + column_step)
    return [flat.at[base + step].get(mode="promise_in_bounds") for step in steps], down, right


def _interpolate(taps: list[Array], down: Array, right: Array) -> Array:
    """Interpolate between four taps, given row by row."""
    upper, lower = (
        left_tap * (1 - right) + right_tap * right for left_tap, right_tap in (taps[:2], taps[2:])
    )
    return upper * (1 - down) + lower * down
