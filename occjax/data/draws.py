"""Random numbers for the generators, many at a time.

Every call of :mod:`jax.random` is compiled on its own, which takes longer than drawing a hundred
numbers; so numbers are drawn in one block and handed out one after the other.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray, UInt32

Key = PRNGKeyArray | UInt32[Array, "2"]


BLOCK = 24
"""Numbers drawn at a time."""


def _numbers(key: Key, shape: tuple[int, ...]) -> Iterator[Array]:
    """Uniform random numbers without end."""
    for block in itertools.count():
        yield from jax.random.uniform(jax.random.fold_in(key, block), (BLOCK, *shape))


class Draws:
    """A block of uniform random numbers, handed out in order of the calls.

    Example:
        >>> draws = Draws(jax.random.key(0), (3,))
        >>> draws.uniform(2.0, 5.0).shape, draws.chance(0.0).tolist()
        ((3,), [False, False, False])
    """

    def __init__(self, key: Key, shape: tuple[int, ...] = ()) -> None:
        """Prepare numbers of a shape."""
        self._numbers = _numbers(key, shape)

    def uniform(self, low: ArrayLike = 0.0, high: ArrayLike = 1.0) -> Float[Array, "*n"]:
        """Evenly between two values."""
        return low + (high - low) * next(self._numbers)  # type: ignore[operator]

    def log_uniform(self, low: ArrayLike, high: ArrayLike) -> Float[Array, "*n"]:
        """Between two positive values, evenly in the logarithm."""
        return jnp.exp(self.uniform(jnp.log(low), jnp.log(high)))

    def signed(self, low: float, high: float) -> Float[Array, "*n"]:
        """Of magnitude between two values, and of either sign."""
        number = next(self._numbers)
        sign = jnp.where(number < 0.5, -1.0, 1.0)
        return sign * (low + (high - low) * jnp.abs(2.0 * number - 1.0))

    def angle(self) -> Float[Array, "*n"]:
        """An angle, in radians."""
        return self.uniform(0.0, 2.0 * np.pi)

    def chance(self, probability: ArrayLike) -> Bool[Array, "*n"]:
        """True with a probability."""
        return next(self._numbers) < probability

    def sometimes(
        self, probability: ArrayLike, value: ArrayLike, otherwise: ArrayLike = 0.0
    ) -> Float[Array, "*n"]:
        """One value with a probability, another one else."""
        return jnp.where(self.chance(probability), value, otherwise)

    def kind(self, weights: Sequence[float]) -> Int[Array, "*n"]:
        """An index, as often as its weight says."""
        shares = np.cumsum(weights) / max(sum(weights), 1e-9)
        number = next(self._numbers)
        # The last share is not compared with: rounding must not lead beyond the last kind.
        last = max((i for i, weight in enumerate(weights) if weight > 0.0), default=0)
        kinds = sum((number >= share).astype(jnp.int32) for share in shares[:last].tolist())
        return jnp.zeros(number.shape, jnp.int32) + kinds
