"""Reductions over the leading axis of a stack of maps, ``[n, h, w] -> [h, w]``, and their type.

On a CPU, XLA reduces the leading axis one pixel at a time and jumps from map to map, which takes
twenty times as long as the arithmetic. These functions combine the two halves of the stack until
one map is left: elementwise operations that XLA fuses into one pass over memory. The tree of sums
also has a smaller rounding error. The references are ``x.sum(0)``, ``x.min(0)``, ``x.max(0)`` and
``jax.nn.softmax(x, axis=0)``.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Float


def accumulation_dtype(array: Array) -> DTypeLike:
    """Return the type in which values of an array are summed: float64 for float64, else float32."""
    return jnp.float64 if array.dtype == jnp.float64 else jnp.float32


def sum_leading(maps: Float[Array, "n ..."]) -> Float[Array, "..."]:
    """Return the sum over the leading axis, n at least 1."""
    return _reduce(maps, jnp.add)


def min_leading(maps: Float[Array, "n ..."]) -> Float[Array, "..."]:
    """Return the minimum over the leading axis, n at least 1."""
    return _reduce(maps, jnp.minimum)


def max_leading(maps: Float[Array, "n ..."]) -> Float[Array, "..."]:
    """Return the maximum over the leading axis, n at least 1."""
    return _reduce(maps, jnp.maximum)


def softmax_leading(maps: Float[Array, "n ..."]) -> Float[Array, "n ..."]:
    """Return the softmax over the leading axis, n at least 1."""
    exponentials = jnp.exp(maps - max_leading(maps)[None])
    return exponentials / sum_leading(exponentials)[None]


def _reduce(maps: Array, combine: Callable[[Array, Array], Array]) -> Array:
    odd = []  # the last map of each level of odd size
    while len(maps) > 1:
        half = len(maps) // 2
        odd += list(maps[2 * half :])
        maps = combine(maps[:half], maps[half : 2 * half])
    return functools.reduce(combine, odd, maps[0])
