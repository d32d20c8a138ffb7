"""3x3x3 convolution with half of the multiplications, four rows at a time.

Four neighbouring results of a filter of three taps need six multiplications, not twelve, if input
and filter are first combined linearly (Winograd, Arithmetic Complexity of Computations, 1980;
Lavin and Gray, Fast Algorithms for Convolutional Neural Networks, CVPR 2016). Here that is done
across rows: six combinations of six neighbouring rows are convolved in two dimensions, over
candidates and columns, and four combinations of the results are the rows. One dimension suffices:
what is combined is read but once while it is in the processor's cache, and the rounding error is
that of a direct convolution times three.

The combinations are evaluations of polynomials at 0, 3/4, -3/4, 4/3, -4/3 and infinity. The nearer
to one and the further apart the points, the smaller the rounding error; with the customary 0, 1,
-1, 2, -2 it is a third larger.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from occjax.ops.convolution import kernel_gradient, plain_convolution

ROWS = 4
"""Rows of the result that are computed together."""

READ = ROWS + 2
"""Rows of the volume that they depend on."""

_POINTS = (Fraction(0), Fraction(3, 4), Fraction(-3, 4), Fraction(4, 3), Fraction(-4, 3))


def _matrices() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Combinations of the filter ``[6, 3]``, the input ``[6, 6]`` and the products ``[4, 6]``.

    A product of polynomials of degree three and two is interpolated from its values at six points.
    What is computed is its transpose, which correlates.
    """

    def evaluated(size: int) -> np.ndarray:
        finite = [[float(point**power) for power in range(size)] for point in _POINTS]
        return np.array([*finite, [0.0] * (size - 1) + [1.0]])

    of_filter, of_input = evaluated(3), np.linalg.inv(evaluated(READ)).T
    # Powers of two change no digit.
    scale = 2.0 ** np.round(np.log2(np.abs(of_filter).sum(1, keepdims=True)))
    return of_filter / scale, of_input * scale, evaluated(ROWS).T


_OF_FILTER, _OF_INPUT, _OF_PRODUCTS = _matrices()


def row_kernels(kernel: Float[Array, "3 3 3 c k"]) -> Float[Array, "6 3 3 c k"]:
    """What :func:`convolve_rows` takes for a kernel over candidates, rows and columns."""
    return jnp.einsum("pi,dijck->pdjck", jnp.asarray(_OF_FILTER, kernel.dtype), kernel)


def convolve_rows(
    read: Callable[[Int[Array, ""]], Float[Array, "6 d w c"]],
    height: int,
    kernels: Float[Array, "6 3 3 c k"],
    finish: Callable[[Float[Array, "4 d w k"], Int[Array, ""]], Float[Array, "4 d w k"]],
) -> Float[Array, "n d w k"]:
    """Convolution of a volume that is read in parts, zero padding.

    Args:
        read: The rows of the volume from a first one, -1 to ``height - 5``, on; the rows -1 and
            ``height`` as zeros, or as what the volume is a part of has there.
        height: Number of rows h, four or more.
        kernels: ``[6, 3, 3, c, k]`` of :func:`row_kernels`.
        finish: What becomes of rows of the result, the first of which has this number.

    Returns:
        ``[h + 2, d, w, k]`` the finished rows between two of zeros, as :func:`rows_between_zeros`
        takes them.
    """
    starts = np.minimum(np.arange(0, height, ROWS), height - ROWS)  # the last one overlaps

    def four_rows(start):
        rows = read(start - 1)
        products = [
            plain_convolution(_combined(factors, rows)[None], kernel)[0]
            for factors, kernel in zip(_OF_INPUT, kernels, strict=True)
        ]
        results = [_combined(factors, products) for factors in _OF_PRODUCTS]
        return finish(jnp.stack(results), start)

    def add_rows(result, start):
        return jax.lax.dynamic_update_slice_in_dim(result, four_rows(start), start + 1, 0), None

    rows = jax.eval_shape(four_rows, jax.ShapeDtypeStruct((), jnp.int32))
    # Zeros that do not depend on the volume would be made for all layers in advance, and take
    # their memory.
    value = jax.lax.stop_gradient(read(jnp.int32(-1))[0, 0, 0, 0])
    zero = jnp.minimum(jnp.abs(jnp.nan_to_num(value)), 0.0).astype(rows.dtype)
    result = jnp.full((height + 2, *rows.shape[1:]), zero)
    return jax.lax.scan(add_rows, result, jnp.asarray(starts, jnp.int32))[0]


def kernel_gradient_of_rows(
    volume: Float[Array, "h d w c"], gradient: Float[Array, "h d w k"]
) -> Float[Array, "3 3 3 c k"]:
    """Gradient of a kernel from that of the convolution, with half of the multiplications as well.

    The transpose of the same algorithm: combinations of the rows of the volume and of the gradient
    give those of the kernel's.

    Args:
        volume: ``[h, d, w, c]``, without the rows of zeros.
        gradient: ``[h, d, w, k]`` of a function of the convolution.

    Returns:
        ``[3, 3, 3, c, k]`` over candidates, rows and columns.
    """
    rest = -len(volume) % ROWS
    volume = jnp.pad(volume, ((1, 1 + rest), (0, 0), (0, 0), (0, 0)))
    gradient = jnp.pad(gradient, ((0, rest), (0, 0), (0, 0), (0, 0)))

    def add_rows(total, start):
        rows = jax.lax.dynamic_slice_in_dim(volume, start, READ)
        results = jax.lax.dynamic_slice_in_dim(gradient, start, ROWS)
        products = [
            kernel_gradient(_combined(of_input, rows), _combined(of_products, results), (3, 3))
            for of_input, of_products in zip(_OF_INPUT, _OF_PRODUCTS.T, strict=True)
        ]
        return total + jnp.stack(products), None

    shape = (READ, 3, 3, volume.shape[-1], gradient.shape[-1])
    starts = jnp.arange(0, len(gradient), ROWS)
    total, _ = jax.lax.scan(add_rows, jnp.zeros(shape, gradient.dtype), starts)
    return jnp.einsum("pi,pdjck->dijck", jnp.asarray(_OF_FILTER, gradient.dtype), total)


def rows_between_zeros(
    volume: Float[Array, "n d w c"],
) -> Callable[[Int[Array, ""]], Float[Array, "6 d w c"]]:
    """What :func:`convolve_rows` reads from a volume whose first and last row are zero."""
    return lambda first: jax.lax.dynamic_slice_in_dim(volume, first + 1, READ)


def _combined(factors: np.ndarray, arrays) -> Array:
    return sum(
        float(factor) * array for factor, array in zip(factors, arrays, strict=True) if factor
    )
