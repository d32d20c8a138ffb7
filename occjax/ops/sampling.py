"""Bilinear sampling of a view where a disparity points.

Two samplings, which differ at the image border; the published network uses both:

* :func:`shift`: one displacement for the whole image, taps outside it read zero;
* :func:`warp`: a displacement for each pixel; the border is replicated (default) or read as zero.

Coordinates are computed in at least float32, whatever the type of the image. Both are
differentiable in the image and in the disparity: the derivative with respect to disparity is that
of the bilinear interpolant, which is piecewise linear with kinks where a displacement is a whole
number of pixels (there the derivative is that of the segment towards larger coordinates).

What users pass becomes JAX arrays here, for all operations: :func:`as_images` and
:func:`as_coordinates` also take NumPy arrays, numbers and lists.
"""

from __future__ import annotations

from functools import partial
from typing import Literal, get_args

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Float16, Int, UInt32

from occjax.errors import InputError
from occjax.ops.convolution import type_of_sums

Border = Literal["replicate", "zero"]

Rows = tuple[int | Int[Array, ""], int]
"""First row (may be traced) and number of rows (static) of a strip of the centre view."""


def shift(
    image: Float[Array, "h w c"],
    disparity: Float[Array, ""] | float,
    offset: Float[Array, "2"],
    *,
    rows: Rows | None = None,
) -> Float[Array, "r w c"]:
    """Bring a view into register with the centre view, for one disparity of the whole image.

    ``result[y, x] = image(y - disparity * offset[0], x - disparity * offset[1])``, bilinear, where
    taps outside the image read zero. The derivative in the image is made of matrix products of its
    rows and columns, so that one value of it that is not finite spoils all of its channel.

    Args:
        image: ``[h, w, c]`` view or feature map.
        disparity: ``[]`` pixels per view step.
        offset: ``[2]`` offset ``(row, column)`` of the view from the centre view, in view steps.
        rows: First row and number of rows r of the result, which may begin and end one row beside
            the image; all h by default.

    Returns:
        ``[r, w, c]`` shifted image.

    Raises:
        InputError: If the image is not floating point or the disparity not one number.

    Example:
        >>> ramp = jnp.arange(4.0)[None, :, None]
        >>> shift(ramp, jnp.float32(0.5), jnp.array([0.0, -1.0]))[0, :, 0].tolist()
        [0.5, 1.5, 2.5, 1.5]
    """
    image = as_images(image, "h w c", "image")
    first, count = (0, image.shape[0]) if rows is None else rows
    disparity, offset = as_coordinates(disparity, offset)
    if disparity.ndim:
        raise InputError(
            f"disparity must be one number, not {list(disparity.shape)}; a map is for warp"
        )
    return _displaced(image, -disparity * offset, jnp.asarray(first, jnp.int32), count)


@partial(jax.custom_jvp, nondiff_argnums=(3,))
def _displaced(
    image: Float[Array, "h w c"], displacement: Float[Array, "2"], first: Int[Array, ""], count: int
) -> Float[Array, "r w c"]:
    """``image(first + y + displacement[0], x + displacement[1])``, zero outside."""
    taps, fraction = _taps_of_all(image, displacement, first, count)
    return _interpolated(_interpolated(taps, fraction[0], 0), fraction[1], 1)


@partial(_displaced.defjvp, symbolic_zeros=True)
def _displaced_jvp(count: int, primals, tangents):
    """As it is, the derivative in the image would transpose to a scattered sum.

    Sums of many terms in places that are only known while running are slow, on a GPU most of all.
    As matrix products of rows and columns it transposes to matrix products.
    """
    image, displacement, first = primals
    of_image, of_displacement, _ = tangents
    h, w, _ = image.shape
    taps, fraction = _taps_of_all(image, displacement, first, count)
    between_rows = _interpolated(taps, fraction[0], 0)
    value = _interpolated(between_rows, fraction[1], 1)
    change = jnp.zeros_like(value)
    if not isinstance(of_image, SymbolicZero):
        whole, _ = whole_and_fraction(displacement, (h, w), image.dtype)
        rows = _weights_of_taps(whole[0] + first, fraction[0], count, h)
        columns = _weights_of_taps(whole[1], fraction[1], w, w)
        change = jnp.einsum("yi,ijc->yjc", rows, of_image, precision="highest")
        change = jnp.einsum("xj,yjc->yxc", columns, change, precision="highest")
    if not isinstance(of_displacement, SymbolicZero):
        down = _interpolated(taps[1:] - taps[:-1], fraction[1], 1)
        right = between_rows[:, 1:] - between_rows[:, :-1]
        for slope, moved in zip((down, right), of_displacement, strict=True):
            change = change + slope * moved.astype(image.dtype)
    return value, change


def _taps_of_all(
    image: Float[Array, "h w c"], displacement: Float[Array, "2"], first: Int[Array, ""], count: int
) -> tuple[Float[Array, "i j c"], Float[Array, "2"]]:
    """The pixels that a displaced image lies between, and how far from one to the next."""
    h, w, _ = image.shape
    (row, column), fraction = whole_and_fraction(displacement, (h, w), image.dtype)
    row = row + first
    # One row and column of zeros on each side stand for all that lies outside.
    rows_read = jnp.clip(row + jnp.arange(count + 1, dtype=jnp.int32), -1, h) + 1
    columns_read = jnp.clip(column + jnp.arange(w + 1, dtype=jnp.int32), -1, w) + 1
    return jnp.pad(image, ((1, 1), (1, 1), (0, 0)))[rows_read][:, columns_read], fraction


def _interpolated(taps: Array, fraction: Float[Array, ""], axis: int) -> Array:
    """Linear, from each tap to the next along an axis, which gets shorter by one."""
    size = taps.shape[axis]
    lower = jax.lax.slice_in_dim(taps, 0, size - 1, axis=axis)
    upper = jax.lax.slice_in_dim(taps, 1, size, axis=axis)
    return lower * (jnp.ones((), taps.dtype) - fraction) + upper * fraction


def _weights_of_taps(
    first: Int[Array, ""], fraction: Float[Array, ""], count: int, size: int
) -> Float[Array, "count size"]:
    """Matrix of the interpolation along an axis; each row has at most two that are not zero."""
    place = jnp.arange(size, dtype=jnp.int32)[None, :]
    lower = first + jnp.arange(count, dtype=jnp.int32)[:, None]
    zero, one = jnp.zeros((), fraction.dtype), jnp.ones((), fraction.dtype)
    return jnp.where(place == lower, one - fraction, zero) + jnp.where(
        place == lower + 1, fraction, zero
    )


def whole_and_fraction(
    displacement: Float[Array, "2"], size: tuple[int, int], dtype: jnp.dtype
) -> tuple[Int[Array, "2"], Float[Array, "2"]]:
    """A displacement ``(row, column)`` as whole pixels and the fraction beyond, of the type.

    A shift by more than the image reads only zeros, in the rows beside it too; clamping the whole
    pixels to ``-size - 2`` and ``size + 1`` keeps them within integers.
    """
    whole = jnp.floor(displacement)
    fraction = (displacement - whole).astype(dtype)
    limit = jnp.array(size, whole.dtype)
    whole = jnp.clip(jax.lax.stop_gradient(whole), -limit - 2.0, limit + 1.0)
    return whole.astype(jnp.int32), fraction


def warp(
    image: Float[Array, "h w c"],
    disparity: Float[Array, "r w"],
    offset: Float[Array, "2"],
    *,
    border: Border = "replicate",
    first_row: int | Int[Array, ""] = 0,
) -> Float[Array, "r w c"]:
    """Warp a view to the centre view by a disparity map of the centre view (eq. 4).

    ``result[y, x] = image(y - d[y, x] * offset[0], x - d[y, x] * offset[1])``, bilinear.

    Args:
        image: ``[h, w, c]`` view or feature map.
        disparity: ``[r, w]`` of all or some rows of the centre view, pixels per view step.
        offset: ``[2]`` offset ``(row, column)`` of the view from the centre view, in view steps.
        border: ``"replicate"`` clamps the base tap to ``[0, size - 2]`` and the fraction to
            ``[0, 1]``, so that the border is repeated outwards; ``"zero"`` reads taps outside the
            image as zero, as :func:`shift` does.
        first_row: Row of the centre view at which ``disparity`` begins.

    Returns:
        ``[r, w, c]`` warped image.

    Raises:
        InputError: If the image is not floating point, the disparity does not fit it or there is
            no such border.

    Example:
        >>> ramp = jnp.tile(jnp.arange(4.0)[None, :, None], (2, 1, 1))
        >>> warp(ramp, jnp.full((2, 4), 0.5), jnp.array([0.0, -1.0]))[0, :, 0].tolist()
        [0.5, 1.5, 2.5, 3.0]
    """
    if border not in get_args(Border):
        raise InputError(f'border: must be "replicate" or "zero", not "{border}"')
    image = as_images(image, "h w c", "image")
    disparity, offset = as_coordinates(disparity, offset)
    h, w, _ = image.shape
    if disparity.ndim != 2 or disparity.shape[0] > h or disparity.shape[1] != w:
        raise InputError(
            f"disparity must be [{h}, {w}] as the image, or some rows of it, "
            f"not {list(disparity.shape)}"
        )
    height, width = disparity.shape
    y = jnp.arange(height, dtype=disparity.dtype) + jnp.asarray(first_row, disparity.dtype)
    y = y[:, None] - disparity * offset[0]
    x = jnp.arange(width, dtype=disparity.dtype)[None, :] - disparity * offset[1]
    if border == "zero":
        image = jnp.pad(image, ((1, 1), (1, 1), (0, 0)))
        y, x = y + 1.0, x + 1.0
    row, down = base_and_fraction(y, image.shape[0])
    column, right = base_and_fraction(x, image.shape[1])
    # The gradient of the image is a sum in single precision too: it is more exact, and a GPU adds
    # to two bytes of memory far more slowly than to four.
    values = image.astype(type_of_sums(image))
    down, right = (fraction.astype(values.dtype)[..., None] for fraction in (down, right))

    def between_columns(row):
        return values[row, column] * (1.0 - right) + values[row, column + 1] * right

    result = between_columns(row) * (1.0 - down) + between_columns(row + 1) * down
    return result.astype(image.dtype)


def point_in_view(
    disparity: Float[Array, "h w"], offset: Float[Array, "2"]
) -> tuple[Float[Array, "h w"], Float[Array, "h w"]]:
    """Where the points of the centre view lie in a view: their rows and columns, in pixels."""
    h, w = disparity.shape
    y = jnp.arange(h, dtype=disparity.dtype)[:, None] - disparity * offset[0]
    x = jnp.arange(w, dtype=disparity.dtype)[None, :] - disparity * offset[1]
    return y, x


def inside_view(disparity: Float[Array, "h w"], offset: Float[Array, "2"]) -> Bool[Array, "h w"]:
    """Whether the points of the centre view lie within the image of a view."""
    h, w = disparity.shape
    y, x = point_in_view(disparity, offset)
    return (y >= 0) & (y <= h - 1) & (x >= 0) & (x <= w - 1)


def warp_plane(
    image: Float[Array, "h w"], disparity: Float[Array, "h w"], offset: Float[Array, "2"]
) -> Float[Array, "h w"]:
    """:func:`warp` of a single channel, borders replicated.

    XLA fuses the bilinear taps of an ``[h, w]`` image into the arithmetic around them, which arrays
    with a short trailing axis prevent.
    """
    taps, down, right = _taps(image, disparity, offset)
    return _between(taps, down.astype(image.dtype), right.astype(image.dtype))


def as_pairs(images: Float16[Array, "*b h w 2"]) -> UInt32[Array, "*b h w"]:
    """Images of two channels of half precision, both in the bits of one number, for warp_pair."""
    return jax.lax.bitcast_convert_type(images, jnp.uint32)


def warp_pair(
    pairs: UInt32[Array, "h w"], disparity: Float[Array, "h w"], offset: Float[Array, "2"]
) -> tuple[Float[Array, "h w"], Float[Array, "h w"]]:
    """:func:`warp` of two channels in one, borders replicated.

    Reading at scattered places takes most of the time of a warp on a CPU; this reads half as often.
    Has a derivative in the disparity alone.

    Args:
        pairs: ``[h, w]`` of :func:`as_pairs`.
        disparity: ``[h, w]`` of the centre view, pixels per view step.
        offset: ``[2]`` offset ``(row, column)`` of the view from the centre view.

    Returns:
        ``[h, w]`` of either channel, in single precision.
    """
    taps, down, right = _taps(pairs, disparity, offset)

    def channel(shift):
        halves = [(tap >> jnp.uint32(shift)).astype(jnp.uint16) for tap in taps]
        values = [jax.lax.bitcast_convert_type(half, jnp.float16) for half in halves]
        return _between([value.astype(jnp.float32) for value in values], down, right)

    return channel(0), channel(16)


def _taps(image: Array, disparity: Array, offset: Array) -> tuple[list[Array], Array, Array]:
    """The four bilinear taps ``[h, w]`` of each point, row by row, and the fractions between them.

    They are read from the flat image: one index serves all four.
    """
    h, w = image.shape
    y, x = point_in_view(disparity, offset)
    row, down = base_and_fraction(y, h)
    column, right = base_and_fraction(x, w)
    # In an image one pixel high or wide both taps are that pixel.
    flat, base = image.reshape(-1), jnp.maximum(row, 0) * w + jnp.maximum(column, 0)
    below, beside = min(h - 1, 1) * w, min(w - 1, 1)
    steps = (0, beside, below, below + beside)
    return [flat.at[base + step].get(mode="promise_in_bounds") for step in steps], down, right


def _between(taps: list[Array], down: Array, right: Array) -> Array:
    """Bilinear interpolation."""
    upper, lower = (left * (1 - right) + beside * right for left, beside in (taps[:2], taps[2:]))
    return upper * (1 - down) + lower * down


def as_images(images: ArrayLike, axes: str, name: str = "views") -> Array:
    """Views or features as the operations need them: a JAX array of floating point.

    Integers would be sampled without an error but wrongly: a bilinear weight is zero or one in
    their type, and sums of 8 bits wrap around.

    Args:
        images: Views or features as the user gave them.
        axes: The axes they must have, for instance ``"v u h w c"``.
        name: What the user calls them.

    Returns:
        The same values, of the same floating type.

    Raises:
        InputError: If they are not floating point or have other axes.
    """
    images = jnp.asarray(images)
    if not jnp.issubdtype(images.dtype, jnp.floating):
        raise InputError(
            f"{name} must be floating point, not {images.dtype}; "
            "pass light_field.floating() or light_field.grey()"
        )
    if images.ndim != len(axes.split()):
        message = f"{name} must be [{', '.join(axes.split())}], not {list(images.shape)}"
        grey = axes.endswith("c") and images.ndim == len(axes.split()) - 1
        raise InputError(message + (f"; grey ones as {name}[..., None]" if grey else ""))
    return images


def as_coordinates(*values: ArrayLike) -> tuple[Array, ...]:
    """Disparities and offsets in one type of at least float32, whatever the promotion rules.

    Coordinates need more bits than bfloat16 has: at 512 pixels its steps are two pixels wide.
    """
    arrays = [jnp.asarray(value) for value in values]
    double = any(array.dtype == jnp.float64 for array in arrays)
    return tuple(array.astype(jnp.float64 if double else jnp.float32) for array in arrays)


def base_and_fraction(coordinate: Array, size: int) -> tuple[Array, Array]:
    """Lower bilinear tap in [0, size - 2] and the weight of the upper one, in [0, 1].

    In an image one pixel wide the taps are -1 and 0, the same pixel.
    """
    base = jax.lax.stop_gradient(jnp.clip(jnp.floor(coordinate), 0.0, size - 2.0))
    fraction = coordinate - base
    # Not jnp.clip: at a bound it halves the derivative, and 0 is every whole number of pixels.
    fraction = jnp.where(fraction < 0.0, 0.0, jnp.where(fraction >= 1.0, 1.0, fraction))
    return base.astype(jnp.int32), fraction
