"""From a volume of costs or probabilities to a disparity map, and how far to trust it.

Answers are at least float32, whatever the type of the volume: a disparity of 3 has steps of 1/64
pixel in bfloat16, coarser than the method is exact.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from occjax.errors import InputError
from occjax.ops.planes import softmax_planes, sum_planes
from occjax.ops.sampling import as_coordinates


def soft_argmin(
    costs: Float[Array, "d h w"], candidates: Float[Array, " d"] | Float[Array, "d h w"]
) -> Float[Array, "h w"]:
    """Differentiable sub-pixel position of the lowest cost (eq. 9).

    ``sum_k candidate_k * softmax(-cost)_k``. A network whose output is a score (high is good), as
    the published one in effect is, passes its negative or uses :func:`expected_disparity`.

    Args:
        costs: ``[d, h, w]`` cost of each candidate.
        candidates: ``[d]`` disparities, or ``[d, h, w]`` when each pixel has its own.

    Returns:
        ``[h, w]`` disparity, in the unit of the candidates.

    Raises:
        InputError: If the candidates do not fit the costs.

    Example:
        >>> costs = jnp.array([9.0, 0.0, 9.0])[:, None, None]
        >>> round(float(soft_argmin(costs, jnp.array([-1.0, 0.5, 2.0]))[0, 0]), 3)
        0.5
    """
    costs, candidates = _volume_and_candidates(costs, candidates, "costs")
    return sum_planes(softmax_planes(-costs) * candidates)


def expected_disparity(
    probabilities: Float[Array, "d h w"],
    candidates: Float[Array, " d"] | Float[Array, "d h w"],
) -> Float[Array, "h w"]:
    """Expectation of the candidates under their probabilities (the sum in eq. 9).

    Args:
        probabilities: ``[d, h, w]``, summing to one over d.
        candidates: ``[d]`` disparities, or ``[d, h, w]`` when each pixel has its own.

    Returns:
        ``[h, w]`` disparity, in the unit of the candidates.

    Raises:
        InputError: If the candidates do not fit the probabilities.

    Example:
        >>> halves = jnp.full((2, 1, 1), 0.5)
        >>> expected_disparity(halves, jnp.array([1.0, 2.0])).tolist()
        [[1.5]]
    """
    probabilities, candidates = _volume_and_candidates(probabilities, candidates, "probabilities")
    return sum_planes(probabilities * candidates)


def cheapest(costs: Float[Array, "d h w"], candidates: Float[Array, " d"]) -> Float[Array, "h w"]:
    """Disparity of least cost, between the candidates by a parabola through the three around it.

    Args:
        costs: ``[d, h, w]`` costs, d at least 3.
        candidates: ``[d]`` evenly spaced disparities.

    Returns:
        ``[h, w]`` disparity; at most half a spacing from the cheapest candidate.

    Example:
        >>> costs = jnp.array([2.25, 0.25, 0.25, 2.25])[:, None, None]  # (x - 1.5)^2
        >>> cheapest(costs, jnp.arange(4.0)).tolist()
        [[1.5]]
    """
    least = costs.argmin(0)
    index = jnp.clip(least, 1, len(candidates) - 2)
    before, here, after = (
        jnp.take_along_axis(costs, (index + step)[None], axis=0)[0] for step in (-1, 0, 1)
    )
    curvature = before - 2 * here + after
    curved = curvature > 1e-9
    vertex = jnp.where(curved, (before - after) / (2 * jnp.where(curved, curvature, 1.0)), 0.0)
    spacing = (candidates[-1] - candidates[0]) / (len(candidates) - 1)
    # At the ends of the range the cheapest candidate is not the middle one: up to one step away.
    at_end = least != index
    limit = jnp.where(at_end, 1.0, 0.5)
    return candidates[index] + jnp.clip(vertex, -limit, limit) * spacing


class Confidence(NamedTuple):
    """Two readings of a probability volume.

    Attributes:
        standard_deviation: ``[h, w]`` spread of the candidates, in the unit of disparity.
        entropy: ``[h, w]`` in nats, from 0 (one candidate is certain) to log(d) (all are alike).
    """

    standard_deviation: Float[Array, "h w"]
    entropy: Float[Array, "h w"]

    def certainty(self, number_of_candidates: int) -> Float[Array, "h w"]:
        """``1 - entropy / log(d)``, rounded into [0, 1]: 1 is certain, 0 knows nothing."""
        return jnp.clip(1.0 - self.entropy / math.log(max(number_of_candidates, 2)), 0.0, 1.0)


def confidence(
    probabilities: Float[Array, "d h w"],
    candidates: Float[Array, " d"] | Float[Array, "d h w"],
) -> Confidence:
    """Spread and entropy of a probability volume.

    Both are free of NaN in value and gradient where a probability is exactly 0 or 1.

    Args:
        probabilities: ``[d, h, w]``, summing to one over d.
        candidates: ``[d]`` disparities, or ``[d, h, w]`` when each pixel has its own.

    Returns:
        Standard deviation and entropy, each ``[h, w]``.

    Raises:
        InputError: If the candidates do not fit the probabilities.

    Example:
        >>> halves = jnp.full((2, 1, 1), 0.5)
        >>> confidence(halves, jnp.array([1.0, 2.0])).standard_deviation.tolist()
        [[0.5]]
    """
    probabilities, candidates = _volume_and_candidates(probabilities, candidates, "probabilities")
    mean = sum_planes(probabilities * candidates)
    variance = sum_planes(probabilities * jnp.square(candidates - mean[None]))
    spread = variance > 0
    deviation = jnp.where(spread, jnp.sqrt(jnp.where(spread, variance, 1.0)), 0.0)
    possible = probabilities > 0
    logarithm = jnp.log(jnp.where(possible, probabilities, 1.0))
    return Confidence(deviation, -sum_planes(probabilities * logarithm))


def probability_near(
    probabilities: Float[Array, "d h w"],
    candidates: Float[Array, " d"] | Float[Array, "d h w"],
    disparity: Float[Array, "h w"],
    distance: float,
) -> Float[Array, "h w"]:
    """Probability of all candidates about a disparity: how sure a volume is of it.

    Where several candidates of a pixel are about the same, their entropy says nothing.

    Args:
        probabilities: ``[d, h, w]``, summing to one over d.
        candidates: ``[d]`` disparities, or ``[d, h, w]`` when each pixel has its own.
        disparity: ``[h, w]`` in the same terms.
        distance: Farthest candidate that counts.

    Returns:
        ``[h, w]`` in [0, 1].

    Raises:
        InputError: If the candidates do not fit the probabilities.

    Example:
        >>> volume = jnp.array([0.5, 0.3, 0.2]).reshape(3, 1, 1)
        >>> candidates = jnp.array([1.0, 1.1, 2.0])
        >>> round(float(probability_near(volume, candidates, jnp.ones((1, 1)), 0.2)[0, 0]), 2)
        0.8
    """
    probabilities, candidates = _volume_and_candidates(probabilities, candidates, "probabilities")
    near = jnp.abs(candidates - disparity[None]) <= distance
    return sum_planes(jnp.where(near, probabilities, 0.0))


def _volume_and_candidates(
    volume: ArrayLike, candidates: ArrayLike, name: str
) -> tuple[Float[Array, "d h w"], Float[Array, "d ..."]]:
    """Both in one type, the candidates ``[d, 1, 1]`` or ``[d, h, w]``."""
    volume, candidates = as_coordinates(volume, candidates)
    if volume.ndim != 3:
        raise InputError(f"{name} must be [d, h, w], not {list(volume.shape)}")
    if candidates.shape not in (volume.shape[:1], volume.shape):
        raise InputError(
            f"candidates must be {list(volume.shape[:1])} or {list(volume.shape)} as the {name}, "
            f"not {list(candidates.shape)}"
        )
    return volume, candidates.reshape(-1, 1, 1) if candidates.ndim == 1 else candidates
