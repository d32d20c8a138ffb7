"""The learned residual: the refined stage of the paper around the selected disparity.

After the selection a pixel has the disparity of some surface, and that surface may be off by a
fraction of a pixel. As in the refined stage of OccCasNet (Chao et al. 2023, section 3.4), a cost
volume of a few finer candidates around the disparity of each pixel is aggregated to probabilities,
and the result is their expectation.

The volume consists of statistics over the views instead of their features, so that the arrangement
of the views is free.
"""

from __future__ import annotations

from typing import NamedTuple

import flax.linen as nn
import jax
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Float, Float16

from occjax.kernels.reductions import softmax_leading
from occjax.models.proposal.config import ResidualConfig
from occjax.models.proposal.filters import box_filter, central_differences
from occjax.models.proposal.multi_scale import multi_scale_features
from occjax.models.proposal.resolution import depth_to_space, space_to_depth
from occjax.models.proposal.search import GreyViews
from occjax.models.proposal.sector_costs import geman_mcclure, refined_costs
from occjax.ops import expected_disparity


class ViewStatistics(NamedTuple):
    """Statistics over the views, in the order in which a :class:`ResidualVolume` stacks them.

    Logarithms are scaled by 0.3.

    Attributes:
        log_square: Logarithm of the mean squared difference of grey from the centre view.
        log_derivative: The same of the derivatives of grey.
        robust: Mean robust cost of the derivatives.
        log_variance: Logarithm of the variance of grey over the views.
    """

    log_square: Float[Array, "*shape"]
    log_derivative: Float[Array, "*shape"]
    robust: Float[Array, "*shape"]
    log_variance: Float[Array, "*shape"]


STATISTICS = len(ViewStatistics._fields)


class ResidualVolume(NamedTuple):
    """Cost volume around a disparity map, and the maps that guide its aggregation.

    Attributes:
        centre: ``[h, w]`` grey centre view.
        disparity: ``[h, w]`` disparity that the candidates surround.
        reference: ``[s, h, w]`` :class:`ViewStatistics` at this disparity.
        relative: ``[s, d, h, w]`` statistics at the candidates, minus those at this disparity.
        certainty: ``[h, w]`` confidence of the disparity in [0, 1].
        log_information: ``[h, w]`` scaled logarithm of the information of each pixel.
    """

    centre: Float[Array, "*b h w"]
    disparity: Float[Array, "*b h w"]
    reference: Float16[Array, f"*b {STATISTICS} h w"]
    relative: Float16[Array, f"*b {STATISTICS} d h w"]
    certainty: Float[Array, "*b h w"]
    log_information: Float[Array, "*b h w"]


def residual_volume(
    grey: GreyViews,
    disparity: Float[Array, "h w"],
    certainty: Float[Array, "h w"],
    information: Float[Array, "h w"],
    config: ResidualConfig,
) -> ResidualVolume:
    """Compute the cost volume around a disparity map.

    Args:
        grey: Views.
        disparity: ``[h, w]`` disparity of the centre view, pixels per view step.
        certainty: ``[h, w]`` its confidence in [0, 1].
        information: ``[h, w]`` information of the refinement, times the squared certainty.
        config: Candidates and tolerance.

    Returns:
        The volume.
    """
    v, u, h, w = grey.views.shape
    derivatives = central_differences(grey.views.reshape(v * u, h, w))
    # Derivatives are small, so that half precision keeps them exact enough, and are read in pairs.
    pairs = jnp.stack(derivatives, axis=-1).reshape(v, u, h, w, 2).astype(jnp.float16)

    def penalties(differences):
        difference, down, right = differences
        square = down * down + right * right
        robust = geman_mcclure(jnp.sqrt(square), config.derivative_tolerance)
        return difference, difference * difference, square, robust

    def statistics_at(candidate: Float[Array, ""]) -> Float[Array, f"{STATISTICS} h w"]:
        sums, count = refined_costs(
            [grey.views[..., None], pairs],
            (disparity + candidate)[None],
            penalties=penalties,
            offsets=grey.offsets,
        )
        mean, square, derivative, robust = sums[:, 0] / (count + 1e-3)
        variance = jnp.maximum(square - mean * mean, 0.0)
        return jnp.stack(
            ViewStatistics(
                log_square=_log(square),
                log_derivative=_log(derivative),
                robust=robust,
                log_variance=_log(variance),
            )
        )

    # One candidate at a time: less memory in the same time.
    candidates = jnp.array(config.candidates, disparity.dtype)
    statistics = jnp.moveaxis(jax.lax.map(statistics_at, candidates), 0, 1)
    reference = statistics[:, len(config.candidates) // 2]
    return ResidualVolume(
        centre=grey.centre,
        disparity=disparity,
        reference=reference.astype(jnp.float16),
        relative=(statistics - reference[:, None]).astype(jnp.float16),
        certainty=certainty,
        log_information=0.3 * jnp.log(information + 1.0),
    )


class Residual(NamedTuple):
    """Result of the residual stage.

    Attributes:
        disparity: ``[h, w]`` residual, to be added to the disparity, pixels per view step.
        confidence: ``[h, w]`` probability that the sum is off by at most 0.07 pixels per view step
            at the configured reach.
    """

    disparity: Float[Array, "h w"]
    confidence: Float[Array, "h w"]


class ResidualStage(nn.Module):
    """Residual disparity of each pixel, from the volume around its disparity, and its confidence.

    All convolutions work at half resolution, with the four pixels of a block as channels. Before
    training the residual is zero and the confidence is that of the volume.

    Attributes:
        config: Candidates and widths.
        dtype: Type of the convolutions.
    """

    config: ResidualConfig
    dtype: DTypeLike = jnp.float32

    @nn.compact
    def __call__(self, volume: ResidualVolume) -> Residual:
        """Compute the residual and the confidence of its sum with the disparity.

        Args:
            volume: Volume; height and width must be multiples of ``2 ** len(config.widths)``.
        """
        candidates = jnp.array(self.config.candidates)
        volume = jax.tree.map(lambda field: field.astype(jnp.float32), volume)
        features = jnp.concatenate(
            [
                volume.relative.reshape(-1, *volume.disparity.shape),
                0.3 * volume.reference,
                _guides(volume),
            ]
        )
        blocks = space_to_depth(jnp.moveaxis(features, 0, -1)[None]).astype(self.dtype)
        context = multi_scale_features(blocks, self.config.widths, self.dtype)
        outputs = 4 * (len(candidates) + 1)
        score = nn.Dense(outputs, kernel_init=nn.initializers.zeros, dtype=self.dtype, name="score")
        scores = jnp.moveaxis(depth_to_space(score(context))[0].astype(jnp.float32), -1, 0)
        candidate_scores, log_odds = scores[:-1], scores[-1]
        probabilities = softmax_leading(candidate_scores)
        certainty = jnp.clip(volume.certainty, 1e-4, 1.0 - 1e-3)
        confidence = nn.sigmoid(jnp.log(certainty / (1.0 - certainty)) + log_odds)
        return Residual(expected_disparity(probabilities, candidates), confidence)


def _guides(volume: ResidualVolume) -> Float[Array, "n h w"]:
    """Return grey, certainty and information, and the shape of surface and image around a pixel."""
    disparity, centre = volume.disparity, volume.centre
    down, right = central_differences(disparity)
    differences = [box_filter(disparity, radius) - disparity for radius in (1, 3, 8)]
    maps = [
        centre - 0.5,
        volume.certainty,
        volume.log_information,
        *(jnp.clip(10.0 * each, -2.0, 2.0) for each in (*differences, down, right)),
        *(5.0 * each for each in central_differences(centre)),
    ]
    return jnp.stack(maps)


def _log(square: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """Return the scaled logarithm of a square; 1e-7 bounds it where the square is 0."""
    return 0.3 * jnp.log(square + 1e-7)
