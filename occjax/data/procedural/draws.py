"""Random numbers for the generator, drawn in large blocks.

Each call of :mod:`jax.random` is compiled on its own, which takes longer than drawing a hundred
numbers. Numbers are therefore drawn in blocks and handed out in the order of the calls.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray, UInt32

Key = PRNGKeyArray | UInt32[Array, "2"]


class Draws:
    """Random numbers of one shape, handed out in the order of the calls.

    Example:
        >>> draws = Draws(jax.random.key(0)).with_shape((3,))
        >>> draws.uniform(2.0, 5.0).shape, draws.chance(0.0).tolist()
        ((3,), [False, False, False])
    """

    def __init__(self, key: Key) -> None:
        """Draw scalars; :meth:`with_shape` returns draws of arrays."""
        self._blocks = _Blocks(key)
        self._shape: tuple[int, ...] = ()

    def with_shape(self, shape: tuple[int, ...]) -> Draws:
        """Return draws of another shape that continue the same sequence of numbers."""
        other = copy.copy(self)
        other._shape = shape
        return other

    def unit(self) -> Float[Array, "*n"]:
        """Draw uniformly from [0, 1)."""
        return self._blocks.take(math.prod(self._shape)).reshape(self._shape)

    def uniform(self, low: ArrayLike, high: ArrayLike) -> Float[Array, "*n"]:
        """Draw uniformly between two values."""
        low = jnp.asarray(low, jnp.float32)
        return low + (jnp.asarray(high, jnp.float32) - low) * self.unit()

    def log_uniform(self, low: ArrayLike, high: ArrayLike) -> Float[Array, "*n"]:
        """Draw between two positive values, uniformly in the logarithm."""
        return jnp.exp(self.uniform(jnp.log(low), jnp.log(high)))

    def signed(self, low: float, high: float) -> Float[Array, "*n"]:
        """Draw a magnitude uniformly between two values, and a random sign."""
        number = self.unit()
        sign = jnp.where(number < 0.5, -1.0, 1.0)
        return sign * (low + (high - low) * jnp.abs(2.0 * number - 1.0))

    def angle(self) -> Float[Array, "*n"]:
        """Draw an angle, in radians."""
        return self.uniform(0.0, 2.0 * np.pi)

    def chance(self, probability: ArrayLike) -> Bool[Array, "*n"]:
        """Return true with the given probability."""
        return self.unit() < probability

    def choose(
        self, probability: ArrayLike, value: ArrayLike, otherwise: ArrayLike = 0.0
    ) -> Float[Array, "*n"]:
        """Return ``value`` with the given probability, else ``otherwise``."""
        return jnp.where(self.chance(probability), value, otherwise)

    def category(self, weights: Sequence[float]) -> Int[Array, "*n"]:
        """Draw an index with relative frequencies ``weights``."""
        shares = np.cumsum(weights) / max(sum(weights), 1e-9)
        number = self.unit()
        # The last share is left out: rounding must not give an index beyond the last category.
        last = max((i for i, weight in enumerate(weights) if weight > 0.0), default=0)
        index = sum((number >= share).astype(jnp.int32) for share in shares[:last].tolist())
        return jnp.zeros(number.shape, jnp.int32) + index


class _Blocks:
    """Uniform random numbers, drawn a block at a time."""

    SIZE = 4096

    def __init__(self, key: Key) -> None:
        self._key, self._count = key, 0
        self._block, self._used = jnp.zeros(0), 0

    def take(self, count: int) -> Float[Array, " count"]:
        """Return the next ``count`` numbers."""
        if self._used + count > self._block.size:
            key = jax.random.fold_in(self._key, self._count)
            self._block = jax.random.uniform(key, (max(count, self.SIZE),))
            self._count, self._used = self._count + 1, 0
        self._used += count
        return self._block[self._used - count : self._used]
