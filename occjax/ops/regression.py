"""Disparity and confidence from a volume of costs or probabilities.

Results are at least float32, whatever the type of the volume: in bfloat16 a disparity of 3 has
steps of 1/64 pixel, coarser than the accuracy of the method.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from occjax.errors import InputError
from occjax.kernels.reductions import softmax_leading, sum_leading
from occjax.ops.sampling import as_coordinates


def soft_argmin(
    costs: Float[Array, "d h w"], candidates: Float[Array, " d"] | Float[Array, "d h w"]
) -> Float[Array, "h w"]:
    """Compute the differentiable sub-pixel position of the lowest cost (eq. 9).

    ``sum_k candidate_k * softmax(-cost)_k``. The published network returns scores, of which the
    highest is the best: pass their negative. The gradient of cost k is
    ``-p_k * (candidate_k - disparity)``, with p the softmax; it vanishes where one candidate has
    all of the probability.

    Args:
        costs: ``[d, h, w]`` cost of each candidate.
        candidates: ``[d]`` disparities, or ``[d, h, w]`` if each pixel has its own.

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
    return sum_leading(softmax_leading(-costs) * candidates)


def expected_disparity(
    probabilities: Float[Array, "d h w"],
    candidates: Float[Array, " d"] | Float[Array, "d h w"],
) -> Float[Array, "h w"]:
    """Compute the expectation of the candidates under their probabilities (the sum in eq. 9).

    The function is linear in the probabilities and in the candidates.

    Args:
        probabilities: ``[d, h, w]``, summing to one over d.
        candidates: ``[d]`` disparities, or ``[d, h, w]`` if each pixel has its own.

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
    return sum_leading(probabilities * candidates)


def winner_takes_all(
    costs: Float[Array, "d h w"], candidates: Float[Array, " d"]
) -> Float[Array, "h w"]:
    """Compute the disparity of lowest cost, with sub-pixel interpolation by a parabola.

    The parabola goes through the costs of the best candidate and its two neighbours. The gradient
    is that of its vertex, with the choice of the candidate held fixed; it is zero where the three
    costs have no curvature or the vertex is clipped. Ties go to the first candidate.

    Args:
        costs: ``[d, h, w]`` costs, d at least 3.
        candidates: ``[d]`` evenly spaced disparities.

    Returns:
        ``[h, w]`` disparity: at most half a spacing from the best candidate, or one spacing where
        that is the first or last one and the three costs are not convex.

    Raises:
        InputError: If there are fewer than 3 candidates or they do not fit the costs.

    Example:
        >>> costs = jnp.array([2.25, 0.25, 0.25, 2.25])[:, None, None]  # (x - 1.5)^2
        >>> winner_takes_all(costs, jnp.arange(4.0)).tolist()
        [[1.5]]
    """
    costs, candidates = as_coordinates(costs, candidates)
    if costs.ndim != 3 or candidates.shape != costs.shape[:1] or len(candidates) < 3:
        raise InputError(
            "costs must be [d, h, w] and candidates [d], with d at least 3, "
            f"not {list(costs.shape)} and {list(candidates.shape)}"
        )
    best = costs.argmin(0)
    index = jnp.clip(best, 1, len(candidates) - 2)
    before, here, after = (
        jnp.take_along_axis(costs, (index + step)[None], axis=0)[0] for step in (-1, 0, 1)
    )
    curvature = before - 2 * here + after
    curved = curvature > 1e-9
    vertex = jnp.where(curved, (before - after) / (2 * jnp.where(curved, curvature, 1.0)), 0.0)
    spacing = (candidates[-1] - candidates[0]) / (len(candidates) - 1)
    # At an end of the range the best candidate is one step away from the middle of the three.
    limit = jnp.where(best != index, 1.0, 0.5)
    return candidates[index] + jnp.clip(vertex, -limit, limit) * spacing


class Confidence(NamedTuple):
    """Spread and entropy of a probability volume.

    Attributes:
        standard_deviation: ``[h, w]`` spread of the candidates, in the unit of disparity.
        entropy: ``[h, w]`` nats, from 0 (one candidate is certain) to log(d) (all are equal).
    """

    standard_deviation: Float[Array, "h w"]
    entropy: Float[Array, "h w"]

    def certainty(self, number_of_candidates: int) -> Float[Array, "h w"]:
        """Return ``1 - entropy / log(d)``, clipped to [0, 1]: 1 is certain, 0 is uniform."""
        return jnp.clip(1.0 - self.entropy / math.log(max(number_of_candidates, 2)), 0.0, 1.0)


def confidence(
    probabilities: Float[Array, "d h w"],
    candidates: Float[Array, " d"] | Float[Array, "d h w"],
) -> Confidence:
    """Compute the standard deviation and the entropy of a probability volume.

    Values and gradients are finite where a probability is exactly 0 or 1: the gradient of the
    standard deviation is zero where there is no spread, that of the entropy where p is 0.

    Args:
        probabilities: ``[d, h, w]``, summing to one over d.
        candidates: ``[d]`` disparities, or ``[d, h, w]`` if each pixel has its own.

    Returns:
        The :class:`Confidence`: standard deviation and entropy, each ``[h, w]``.

    Raises:
        InputError: If the candidates do not fit the probabilities.

    Example:
        >>> halves = jnp.full((2, 1, 1), 0.5)
        >>> confidence(halves, jnp.array([1.0, 2.0])).standard_deviation.tolist()
        [[0.5]]
    """
    probabilities, candidates = _volume_and_candidates(probabilities, candidates, "probabilities")
    mean = sum_leading(probabilities * candidates)
    variance = sum_leading(probabilities * jnp.square(candidates - mean[None]))
    spread = variance > 0
    deviation = jnp.where(spread, jnp.sqrt(jnp.where(spread, variance, 1.0)), 0.0)
    possible = probabilities > 0
    logarithm = jnp.log(jnp.where(possible, probabilities, 1.0))
    return Confidence(deviation, -sum_leading(probabilities * logarithm))


def _volume_and_candidates(
    volume: ArrayLike, candidates: ArrayLike, name: str
) -> tuple[Float[Array, "d h w"], Float[Array, "d ..."]]:
    """Check both and return them in one type, the candidates as ``[d, 1, 1]`` or ``[d, h, w]``."""
    volume, candidates = as_coordinates(volume, candidates)
    if volume.ndim != 3:
        raise InputError(f"{name} must be [d, h, w], not {list(volume.shape)}")
    if candidates.shape not in (volume.shape[:1], volume.shape):
        raise InputError(
            f"candidates must be {list(volume.shape[:1])} or {list(volume.shape)} like the {name}, "
            f"not {list(candidates.shape)}"
        )
    return volume, candidates.reshape(-1, 1, 1) if candidates.ndim == 1 else candidates
