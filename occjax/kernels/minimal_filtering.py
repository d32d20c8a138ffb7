"""3x3x3 convolution by Winograd's minimal filtering: half of the multiplications.

Four neighbouring results of a filter of three taps need six multiplications instead of twelve, if
input and filter are first combined linearly (Winograd, Arithmetic Complexity of Computations, 1980;
Lavin and Gray, Fast Algorithms for Convolutional Neural Networks, CVPR 2016). This module applies
the algorithm across rows: six linear combinations of six neighbouring rows are convolved in two
dimensions, over candidates and columns, and four linear combinations of the results are the rows.
One dimension is enough: the combined rows are read once, from the processor's cache, and the
rounding error is only three times that of a direct convolution.

The algorithm evaluates polynomials at the points 0, 3/4, -3/4, 4/3, -4/3 and infinity. The rounding
error is small if the points have a magnitude near one and are far apart. With the usual points
0, 1, -1, 2, -2 it is a third larger.

A volume is ``[h, d, w, c]``, rows first. The reference of :func:`convolve_rows` is a convolution by
XLA, that of :func:`kernel_gradient_of_rows` the gradient of this convolution.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from occjax.kernels.convolution import kernel_gradient, plain_convolution

OUTPUT_ROWS = 4
"""Rows of the result that are computed together."""

INPUT_ROWS = OUTPUT_ROWS + 2
"""Rows of the volume that :data:`OUTPUT_ROWS` rows of the result depend on."""

ReadRows = Callable[[Int[Array, ""]], Float[Array, "6 d w c"]]
"""Function that returns :data:`INPUT_ROWS` rows of a volume, given the index of the first one."""

_POINTS = (Fraction(0), Fraction(3, 4), Fraction(-3, 4), Fraction(4, 3), Fraction(-4, 3))


def _combinations() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the matrices that combine filter ``[6, 3]``, input ``[6, 6]``, products ``[4, 6]``.

    The product of two polynomials, of degrees three and two, can be interpolated from its values at
    six points. This computes the convolution of their coefficients (Toom and Cook). The transpose
    of the algorithm computes the correlation of six rows with three taps.
    """

    def values(size: int) -> np.ndarray:
        finite = [[float(point**power) for power in range(size)] for point in _POINTS]
        return np.array([*finite, [0.0] * (size - 1) + [1.0]])

    filters, inputs = values(3), np.linalg.inv(values(INPUT_ROWS)).T
    # Scaling by powers of two adds no rounding error.
    scale = 2.0 ** np.round(np.log2(np.abs(filters).sum(1, keepdims=True)))
    return filters / scale, inputs * scale, values(OUTPUT_ROWS).T


_FILTERS, _INPUTS, _PRODUCTS = _combinations()


def convolve_rows(
    read: ReadRows,
    height: int,
    kernel: Float[Array, "3 3 3 c k"],
    finish: Callable[[Float[Array, "4 d w k"], Int[Array, ""]], Float[Array, "4 d w k"]],
) -> Float[Array, "n d w k"]:
    """Convolve a volume that is read in parts, with zero padding.

    Args:
        read: Function that returns rows of the volume, given the index of the first one, which is
            from -1 to ``height - 5``. Rows -1 and ``height`` are zero; if the volume is a strip of
            a larger volume, they are the neighbouring rows of that volume.
        height: Number of rows h, at least 4.
        kernel: ``[3, 3, 3, c, k]`` over candidates, rows and columns.
        finish: Function applied to four rows of the result and the index of the first one.

    Returns:
        ``[h + 2, d, w, k]`` results of ``finish`` between two rows of zeros: the input of
        :func:`rows_between_zeros`.
    """
    # The last group of rows overlaps the one before.
    starts = np.minimum(np.arange(0, height, OUTPUT_ROWS), height - OUTPUT_ROWS)
    kernels = jnp.einsum("pi,dijck->pdjck", jnp.asarray(_FILTERS, kernel.dtype), kernel)

    def four_rows(start):
        rows = read(start - 1)
        products = [
            plain_convolution(_combine(factors, rows)[None], combined)[0]
            for factors, combined in zip(_INPUTS, kernels, strict=True)
        ]
        results = [_combine(factors, products) for factors in _PRODUCTS]
        return finish(jnp.stack(results), start)

    def add_rows(result, start):
        return jax.lax.dynamic_update_slice_in_dim(result, four_rows(start), start + 1, 0), None

    rows = jax.eval_shape(four_rows, jax.ShapeDtypeStruct((), jnp.int32))
    # XLA would allocate constant zeros for all layers in advance; zeros that depend on the volume
    # are made when they are needed.
    value = jax.lax.stop_gradient(read(jnp.int32(-1))[0, 0, 0, 0])
    zero = jnp.minimum(jnp.abs(jnp.nan_to_num(value)), 0.0).astype(rows.dtype)
    result = jnp.full((height + 2, *rows.shape[1:]), zero)
    return jax.lax.scan(add_rows, result, jnp.asarray(starts, jnp.int32))[0]


def kernel_gradient_of_rows(
    volume: Float[Array, "h d w c"], gradient: Float[Array, "h d w k"]
) -> Float[Array, "3 3 3 c k"]:
    """Return the gradient with respect to the kernel, given that with respect to the result.

    The transpose of the same algorithm computes it, also with half of the multiplications.

    Args:
        volume: ``[h, d, w, c]`` volume, without rows of zeros.
        gradient: ``[h, d, w, k]`` gradient with respect to the result of the convolution.

    Returns:
        ``[3, 3, 3, c, k]`` gradient over candidates, rows and columns.
    """
    padding = -len(volume) % OUTPUT_ROWS
    volume = jnp.pad(volume, ((1, 1 + padding), (0, 0), (0, 0), (0, 0)))
    gradient = jnp.pad(gradient, ((0, padding), (0, 0), (0, 0), (0, 0)))

    def add_rows(total, start):
        rows = jax.lax.dynamic_slice_in_dim(volume, start, INPUT_ROWS)
        results = jax.lax.dynamic_slice_in_dim(gradient, start, OUTPUT_ROWS)
        products = [
            kernel_gradient(_combine(inputs, rows), _combine(outputs, results), (3, 3))
            for inputs, outputs in zip(_INPUTS, _PRODUCTS.T, strict=True)
        ]
        return total + jnp.stack(products), None

    shape = (INPUT_ROWS, 3, 3, volume.shape[-1], gradient.shape[-1])
    starts = jnp.arange(0, len(gradient), OUTPUT_ROWS)
    total, _ = jax.lax.scan(add_rows, jnp.zeros(shape, gradient.dtype), starts)
    return jnp.einsum("pi,pdjck->dijck", jnp.asarray(_FILTERS, gradient.dtype), total)


def rows_between_zeros(volume: Float[Array, "n d w c"]) -> ReadRows:
    """Return the reader for a volume whose first and last row are zero."""
    return lambda first: jax.lax.dynamic_slice_in_dim(volume, first + 1, INPUT_ROWS)


def _combine(factors: np.ndarray, arrays) -> Array:
    return sum(
        float(factor) * array for factor, array in zip(factors, arrays, strict=True) if factor
    )
