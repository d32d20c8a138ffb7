"""What a stage of the cascade returns, and its last step, the regression."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from occjax.ops import expected_disparity


class StageOutput(NamedTuple):
    """What one stage found.

    Attributes:
        disparity: ``[h, w]`` of the centre view, pixels per view step.
        probabilities: ``[d, h, w]`` of the candidates; ``[d, h / 2, w / 2]`` where the volume has
            half the resolution; None for a last refinement, which has no candidates.
        candidates: ``[d]``; added to the disparity of the stage before, if there is one. None for a
            last refinement.
        attention: ``[v, u]`` weight of each view, if the stage has attention.
        occlusion: ``[v, u, h, w]`` occlusion maps in [0, 1], if the stage uses them.
    """

    disparity: Float[Array, "h w"]
    probabilities: Float[Array, "d i j"] | None
    candidates: Float[Array, " d"] | None
    attention: Float[Array, "v u"] | None = None
    occlusion: Float[Array, "v u h w"] | None = None


def stage_output(
    scores: Float[Array, "d h w"],
    candidates: Float[Array, " d"],
    before: Float[Array, "h w"] | None = None,
    attention: Float[Array, "v u"] | None = None,
    occlusion: Float[Array, "v u h w"] | None = None,
    *,
    window: int | None = None,
) -> StageOutput:
    """Regression (eqs. 9 and 10).

    The sign of the cost is learned: the published code takes softmax(C), not softmax(-C).

    Args:
        scores: ``[d, h, w]``; the higher, the likelier the candidate.
        candidates: ``[d]``.
        before: ``[h, w]`` disparity of the stage before, to which the candidates are added.
        attention: Handed through.
        occlusion: Handed through.
        window: Average only over this many candidates on each side of the likeliest one.
    """
    probabilities = jax.nn.softmax(scores, axis=0)
    averaged = probabilities
    if window is not None:
        index = jnp.arange(len(candidates))[:, None, None]
        apart = jnp.abs(index - jnp.argmax(probabilities, axis=0, keepdims=True))
        averaged = jnp.where(apart <= window, probabilities, 0.0)
        averaged = averaged / averaged.sum(0, keepdims=True)
    disparity = expected_disparity(averaged, candidates)
    if before is not None:
        disparity = before + disparity
    return StageOutput(disparity, probabilities, candidates, attention, occlusion)
