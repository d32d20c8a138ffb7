"""Output of one stage of the cascade, and its last step, the regression."""

from __future__ import annotations

from typing import NamedTuple

from jaxtyping import Array, Float

from occjax.kernels.reductions import softmax_leading
from occjax.ops import expected_disparity


class StageOutput(NamedTuple):
    """Output of one stage.

    Attributes:
        disparity: ``[h, w]`` disparity of the centre view, pixels per view step.
        probabilities: ``[d, h, w]`` probability of each candidate.
        candidates: ``[d]`` disparities of the first stage, or residuals added to the disparity of
            the stage before.
        attention: ``[v, u]`` weight of each view, if the stage has attention.
        occlusion: ``[v, u, h, w]`` occlusion maps in [0, 1], if the stage uses them.
    """

    disparity: Float[Array, "h w"]
    probabilities: Float[Array, "d h w"]
    candidates: Float[Array, " d"]
    attention: Float[Array, "v u"] | None = None
    occlusion: Float[Array, "v u h w"] | None = None


def regress_stage(
    scores: Float[Array, "d h w"],
    candidates: Float[Array, " d"],
    before: Float[Array, "h w"] | None = None,
    attention: Float[Array, "v u"] | None = None,
    occlusion: Float[Array, "v u h w"] | None = None,
) -> StageOutput:
    """Compute the expected disparity from the scores of the candidates (eqs. 9 and 10).

    The network learns the sign of the cost: the published code computes softmax(C), the paper
    writes softmax(-C).

    Args:
        scores: ``[d, h, w]``; a higher score means a more likely candidate.
        candidates: ``[d]`` disparities or residuals, pixels per view step.
        before: ``[h, w]`` disparity of the stage before, to which the candidates are added.
        attention: ``[v, u]`` stored in the output.
        occlusion: ``[v, u, h, w]`` stored in the output.
    """
    probabilities = softmax_leading(scores)
    disparity = expected_disparity(probabilities, candidates)
    if before is not None:
        disparity = before + disparity
    return StageOutput(disparity, probabilities, candidates, attention, occlusion)
