"""The coarse volume and the convolution after it in one, without making the volume.

A bilinear shift and a convolution are both linear, and neither looks at where in the image it is:
they commute. Each view's features are convolved once, not once for every candidate, and what is
shifted and summed are the results: first the rows over the views of a column of the grid, then the
columns over the columns of the grid. For F features of V x U views, K results and D candidates, a
voxel costs ``27 K F V U / D + 6 K U (V + 1)`` multiply-adds in place of ``27 K F V U``.

They commute except at the border of the volume. The convolution pads the volume with zeros, but a
shifted view goes on beyond the volume: what it holds in the frame of one pixel around the volume
is convolved too and taken off again. In depth nothing is shifted; the sums leave out what the
volume does not have.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from occjax.errors import InputError
from occjax.ops.geometry import view_offsets
from occjax.ops.sampling import Rows, as_coordinates, as_images
from occjax.ops.volume import coarse_volume, concatenate


def convolved_coarse_volume(
    features: Float[Array, "v u h w c"],
    candidates: Float[Array, " d"],
    kernel: Float[Array, "3 3 3 n k"],
    *,
    rows: Rows | None = None,
    span: float | None = None,
    streamed: bool = False,
) -> Float[Array, "d r w k"]:
    """Convolution (3x3x3, zero padding) of :func:`occjax.ops.coarse_volume` of a regular grid.

    The same sums in another order, see the module. A weight for each view is a factor of the
    kernel; weights for each pixel do not commute with a shift.

    Args:
        features: ``[v, u, h, w, c]`` features of the views.
        candidates: ``[d]`` disparity candidates, pixels per view step.
        kernel: ``[3, 3, 3, v * u * c, k]`` over candidates, rows and columns; the channels as
            :func:`occjax.ops.concatenate` has them.
        rows: First row and number of rows r of the centre view to compute; all by default. As of a
            volume of those rows: zeros around them.
        span: How far apart the candidates are at most. With it, of each view only the rows that the
            candidates of a strip can read are convolved; without it, all. Candidates that turn out
            to be further apart are computed on the volume.
        streamed: One column of the grid and one candidate after the other (little memory) instead
            of all at once.

    Returns:
        ``[d, r, w, k]``, of the type of the features; summed in at least float32.

    Raises:
        InputError: If the features are not floating point or the kernel does not fit them.

    Example:
        >>> features, kernel = jnp.zeros((3, 3, 8, 8, 4)), jnp.zeros((3, 3, 3, 36, 5))
        >>> convolved_coarse_volume(features, jnp.linspace(-1, 1, 5), kernel).shape
        (5, 8, 8, 5)
    """
    features = as_images(features, "v u h w c", "features")
    given, (candidates,) = candidates, as_coordinates(candidates)
    kernel = as_images(kernel, "depth row column n k", "kernel").astype(features.dtype)
    v, u, h, _, c = features.shape
    if candidates.ndim != 1:
        raise InputError(f"candidates must be a list [d], not {list(candidates.shape)}")
    if kernel.shape[:4] != (3, 3, 3, v * u * c):
        raise InputError(f"kernel must be [3, 3, 3, {v * u * c}, k], not {list(kernel.shape)}")
    rows = (0, h) if rows is None else rows
    start, count = _rows_read(candidates, view_offsets(v, u)[:, 0, 0], rows, h, span)

    def commuted(candidates, depth):
        inner = _convolved_beyond_border(
            features, candidates, kernel[depth], rows, (start, count), streamed
        )
        return _without_frame(inner, features, candidates, kernel[depth], rows, streamed)

    def materialised(candidates, depth):
        return _convolved_volume(features, candidates, kernel[depth], rows, streamed)

    # The whole views serve any candidates.
    fits = span is None or count == h + 2 or _fit(given, span)

    def planes(candidates, depth):
        if isinstance(fits, bool):
            return (commuted if fits else materialised)(candidates, depth)
        return jax.lax.cond(
            fits, lambda: commuted(candidates, depth), lambda: materialised(candidates, depth)
        )

    result = planes(candidates, 1)
    if len(candidates) > 1:
        result = result.at[1:].add(planes(candidates[:-1], 0))
        result = result.at[:-1].add(planes(candidates[1:], 2))
    return result.astype(features.dtype)


def _fit(candidates: Float[Array, " d"], span: float) -> bool | Bool[Array, ""]:
    """Whether no two candidates differ by more than the span, but for rounding."""
    known = not isinstance(candidates, jax.core.Tracer)
    values = np.asarray(candidates) if known else candidates
    fit = values.max() - values.min() <= span + 1e-3
    return bool(fit) if known else fit


def _rows_read(
    candidates: Float[Array, " d"],
    offsets: Float[Array, " v"],
    rows: Rows,
    height: int,
    span: float | None,
) -> tuple[Int[Array, " v"], int]:
    """First row of each view of which the convolution is needed, and how many rows.

    The rows -1 to height are all in which it is not zero.
    """
    first, count = rows
    if span is not None:
        # The lower tap of the last row, the upper one, and what the span is allowed to lack.
        count += math.ceil(span * (len(offsets) // 2)) + 2
        if count < height + 2:
            lowest = jnp.floor(-candidates[:, None] * offsets[None]).min(0)
            beyond = height + count  # as good as any place where there is nothing to read
            lowest = jnp.clip(lowest, -beyond, beyond).astype(jnp.int32)
            return jax.lax.stop_gradient(lowest) + first, count
    return jnp.full(len(offsets), -1, jnp.int32), height + 2


def _convolved_beyond_border(
    features: Float[Array, "v u h w c"],
    candidates: Float[Array, " d"],
    kernel: Float[Array, "3 3 n k"],
    rows: Rows,
    rows_read: tuple[Int[Array, " v"], int],
    streamed: bool,
) -> Float[Array, "d r w k"]:
    """Convolution of each plane of the volume as if that went on beyond its border."""
    v, u, h, w, c = features.shape
    first, count = rows
    start, height = rows_read
    offsets = view_offsets(v, u)
    kernels = kernel.reshape(3, 3, v, u, c, -1).transpose(3, 2, 0, 1, 4, 5)
    # One row of zeros on each side stands for all that lies outside.
    read = jnp.clip(start[:, None] - 1 + jnp.arange(height + 2)[None], -1, h) + 1

    def convolve(view, kernel, read):
        rows = jnp.pad(view, ((1, 1), (0, 0), (0, 0)))[read]
        return _convolve(rows[None], kernel, ((0, 0), (2, 2)))[0]

    def column(column):
        """Sum over a column of the grid, at every candidate."""
        features, kernels, right = column
        convolved = [convolve(*each) for each in zip(features, kernels, read, strict=True)]

        def at(candidate):
            summed = sum(
                _shifted(view, -candidate * down, first - begin, count)
                for view, down, begin in zip(convolved, offsets[:, 0, 0], start, strict=True)
            )
            # Its first column lies left of the image.
            across = _shifted(summed.swapaxes(0, 1), -candidate * right, 1, w)
            return across.swapaxes(0, 1)

        return jax.lax.map(at, candidates) if streamed else jax.vmap(at)(candidates)

    columns = (features.swapaxes(0, 1), kernels, offsets[0, :, 1])
    shape = (len(candidates), count, w, kernel.shape[-1])
    return _total(column, columns, shape, _sum_type(features), streamed)


def _convolved_volume(
    features: Float[Array, "v u h w c"],
    candidates: Float[Array, " d"],
    kernel: Float[Array, "3 3 n k"],
    rows: Rows,
    streamed: bool,
) -> Float[Array, "d r w k"]:
    """Convolution of each plane of the volume, made and dropped again."""

    def at(candidate):
        volume = coarse_volume(features, candidate[None], rows=rows)
        return _convolve(volume, kernel, ((1, 1), (1, 1)))[0]

    return jax.lax.map(at, candidates) if streamed else jax.vmap(at)(candidates)


def _convolve(
    images: Float[Array, "n i j c"], kernel: Float[Array, "p q c k"], padding
) -> Float[Array, "n r w k"]:
    return jax.lax.conv_general_dilated(
        images,
        kernel,
        (1, 1),
        padding,
        dimension_numbers=("NHWC", "HWIO", "NHWC"),
        preferred_element_type=_sum_type(images),
    )


def _sum_type(images: Array) -> jnp.dtype:
    """At least single precision."""
    return jnp.dtype(jnp.float64 if images.dtype == jnp.float64 else jnp.float32)


def _total(function: Callable, arrays, shape: tuple[int, ...], dtype, streamed: bool) -> Array:
    """Sum of a function over the leading axis of arrays."""
    if not streamed:
        return jax.vmap(function)(arrays).sum(0)

    def add(total, each):
        return total + function(each), None

    return jax.lax.scan(add, jnp.zeros(shape, dtype), arrays)[0]


def _shifted(
    image: Float[Array, "n m k"],
    displacement: Float[Array, ""],
    first: int | Int[Array, ""],
    count: int,
) -> Float[Array, "i m k"]:
    """``image(first + i + displacement)`` along the first axis, linear, zero outside."""
    size = image.shape[0]
    whole = jnp.floor(displacement)
    fraction = (displacement - whole).astype(image.dtype)
    beyond = float(2 * (size + count))  # keeps it within integers
    base = jnp.clip(jax.lax.stop_gradient(whole), -beyond, beyond).astype(jnp.int32)
    lower = base + jnp.asarray(first, jnp.int32) + jnp.arange(count, dtype=jnp.int32)

    def tap(index, weight):
        inside = (index >= 0) & (index < size)
        weights = jnp.where(inside, weight, jnp.zeros((), image.dtype))
        read = image.at[jnp.clip(index, 0, size - 1)].get(mode="promise_in_bounds")
        return read * weights[:, None, None]

    return tap(lower, jnp.ones((), image.dtype) - fraction) + tap(lower + 1, fraction)


def _without_frame(
    inner: Float[Array, "d r w k"],
    features: Float[Array, "v u h w c"],
    candidates: Float[Array, " d"],
    kernel: Float[Array, "3 3 n k"],
    rows: Rows,
    streamed: bool,
) -> Float[Array, "d r w k"]:
    """Take off what the frame of one pixel around the volume adds to its outermost pixels.

    The rows of the frame have its corners, its columns have not.
    """
    first, count = rows
    wider = jnp.pad(features, ((0, 0), (0, 0), (0, 0), (1, 1), (0, 0)))

    def frame_row(row):
        return coarse_volume(wider, candidates, rows=(row, 1), streamed=streamed)

    def outer_columns(views, weights):
        return concatenate(views[:, :, :, :: views.shape[3] - 1], weights)

    columns = coarse_volume(wider, candidates, rows=rows, combine=outer_columns, streamed=streamed)
    above = _convolve(frame_row(first - 1), kernel[:1], ((0, 0), (0, 0)))
    below = _convolve(frame_row(first + count), kernel[2:], ((0, 0), (0, 0)))
    left = _convolve(columns[:, :, :1], kernel[:, :1], ((1, 1), (0, 0)))
    right = _convolve(columns[:, :, 1:], kernel[:, 2:], ((1, 1), (0, 0)))
    inner = inner.at[:, :1].add(-above).at[:, -1:].add(-below)
    return inner.at[:, :, :1].add(-left).at[:, :, -1:].add(-right)
