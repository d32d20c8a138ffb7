"""What a stage of the cascade returns, and its last step, the regression."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from occjax.ops import expected_disparity
from occjax.ops.planes import softmax_planes, sum_planes


class StageOutput(NamedTuple):
    """What one stage found.

    Attributes:
        disparity: ``[h, w]`` of the centre view, pixels per view step.
        probabilities: ``[d, h, w]`` of the candidates; None for a last median, which has no
            candidates.
        candidates: ``[d]``, or ``[d, h, w]`` where each pixel has its own; added to the disparity
            of the stage before, if there is one. None for a last median.
        attention: ``[v, u]`` weight of each view, if the stage has attention.
        occlusion: ``[v, u, h, w]`` occlusion maps in [0, 1], if the stage uses them.
    """

    disparity: Float[Array, "h w"]
    probabilities: Float[Array, "d h w"] | None
    candidates: Float[Array, " d"] | Float[Array, "d h w"] | None
    attention: Float[Array, "v u"] | None = None
    occlusion: Float[Array, "v u h w"] | None = None


def stage_output(
    scores: Float[Array, "d h w"],
    candidates: Float[Array, " d"] | Float[Array, "d h w"],
    before: Float[Array, "h w"] | None = None,
    attention: Float[Array, "v u"] | None = None,
    occlusion: Float[Array, "v u h w"] | None = None,
    *,
    window: Float[Array, ""] | float | None = None,
) -> StageOutput:
    """Regression (eqs. 9 and 10).

    The sign of the cost is learned: the published code takes softmax(C), not softmax(-C).

    Args:
        scores: ``[d, h, w]``; the higher, the likelier the candidate.
        candidates: ``[d]``, or ``[d, h, w]`` when each pixel has its own.
        before: ``[h, w]`` disparity of the stage before, to which the candidates are added.
        attention: Handed through.
        occlusion: Handed through.
        window: Average only over candidates this near to the likeliest one.
    """
    probabilities = softmax_planes(scores)
    averaged = probabilities
    if window is not None:
        values = candidates if candidates.ndim == 3 else candidates[:, None, None]
        likeliest = jnp.argmax(probabilities, axis=0, keepdims=True)
        likeliest = jnp.take_along_axis(jnp.broadcast_to(values, scores.shape), likeliest, axis=0)
        near = jnp.abs(values - likeliest) <= 1.001 * window  # whatever is lost to rounding
        averaged = jnp.where(near, probabilities, 0.0)
        averaged = averaged / sum_planes(averaged)[None]
    disparity = expected_disparity(averaged, candidates)
    if before is not None:
        disparity = before + disparity
    return StageOutput(disparity, probabilities, candidates, attention, occlusion)
