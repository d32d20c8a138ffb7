"""Disparities that are proposed for each pixel, and their costs.

Away from depth edges the refined disparity is correct, or nothing in the light field shows the
correct one. At a depth edge the costs of a pixel are mixed with those of the other surface, and the
correct disparity is that of a pixel a few pixels away. Therefore each pixel is proposed the refined
disparity, the disparities of some neighbours, and the second-best disparity of the search.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float16

from occjax.kernels.reductions import max_leading
from occjax.models.proposal.aperture import SECTORS
from occjax.models.proposal.config import ProposalNetConfig
from occjax.models.proposal.filters import box_filter, sample_at_offsets, surface_slopes
from occjax.models.proposal.resolution import depth_to_space, space_to_depth, upsample2x
from occjax.models.proposal.search import GreyViews, SearchResult, interpolate_volume
from occjax.models.proposal.sector_costs import (
    SectorCosts,
    geman_mcclure,
    refined_sector_costs,
    sector_means,
)
from occjax.ops import confidence, winner_takes_all

COST_CHANNELS = SECTORS + 5
"""Number of costs of a proposal, see :meth:`ProposalCosts.stack`."""


class ProposalCosts(NamedTuple):
    """Costs of each proposal in [0, 1], in half precision.

    Attributes:
        channels: ``[k, COST_CHANNELS, h, w]`` costs; the properties name the channels.
    """

    channels: Float16[Array, f"*b {COST_CHANNELS} h w"]

    @classmethod
    def stack(
        cls,
        *,
        sectors: Float[Array, "8 h w"],
        aperture: Float[Array, "h w"],
        best_half: Float[Array, "h w"],
        absolute: Float[Array, "h w"],
        detail: Float[Array, "h w"],
        aggregated: Float[Array, "h w"],
    ) -> ProposalCosts:
        """Store the costs of one proposal, clipped to [0, 1].

        Args:
            sectors: ``[8, h, w]`` robust cost of grey in each sector of the aperture.
            aperture: ``[h, w]`` the same over the whole aperture.
            best_half: ``[h, w]`` the same over the half of the aperture that agrees best, see
                :func:`occjax.models.proposal.sector_costs.sector_means`.
            absolute: ``[h, w]`` mean absolute difference of grey over the best half.
            detail: ``[h, w]`` robust cost of grey minus its local mean, over the best half.
            aggregated: ``[h, w]`` aggregated cost of the search, scaled.
        """
        single = [aperture, best_half, absolute, detail, aggregated]
        channels = jnp.concatenate([sectors, jnp.stack(single)])
        return cls(jnp.clip(channels, 0.0, 1.0).astype(jnp.float16))

    @property
    def best_half(self) -> Float16[Array, "*b h w"]:
        """Robust cost of grey over the best half of the aperture."""
        return self.channels[..., SECTORS + 1, :, :]

    def permute_sectors(self, order: np.ndarray) -> ProposalCosts:
        """Return the costs with the sectors in another order.

        Args:
            order: ``[8]`` for each sector, the index of the sector that takes its place.
        """
        others = np.arange(SECTORS, self.channels.shape[-3])
        return ProposalCosts(self.channels[..., np.concatenate([order, others]), :, :])


class Proposals(NamedTuple):
    """Disparities to select from, and their features.

    Attributes:
        centre: ``[h, w]`` grey centre view.
        disparity: ``[h, w]`` refined disparity.
        proposed: ``[k, h, w]`` proposed disparities: the refined one, those of the neighbours, the
            second-best of the search.
        costs: Costs of each proposal.
        log_variance: ``[h, w]`` scaled logarithm of the variance of the search's candidates.
        peak_probability: ``[h, w]`` probability of the search's most likely candidate.
    """

    centre: Float[Array, "h w"]
    disparity: Float[Array, "h w"]
    proposed: Float[Array, "k h w"]
    costs: ProposalCosts
    log_variance: Float[Array, "h w"]
    peak_probability: Float[Array, "h w"]


def make_proposals(
    grey: GreyViews,
    searched: SearchResult,
    refined: Float[Array, "h w"],
    candidates: Float[Array, " d"],
    config: ProposalNetConfig,
) -> Proposals:
    """Propose disparities for each pixel and compute their costs.

    Args:
        grey: Views of even height and width.
        searched: Result of the search at half resolution.
        refined: ``[h, w]`` refined disparity.
        candidates: ``[d]`` candidates of the search, pixels per view step.
        config: All settings.

    Returns:
        The proposals.
    """
    settings = config.proposals
    second = second_best(searched, candidates, settings.min_second_distance)
    proposed = jnp.concatenate(
        [
            refined[None],
            continued_surfaces(refined, settings.offsets, settings.slope_step_px),
            upsample2x(second)[None],
        ]
    )
    detail = grey.views - box_filter(grey.views, 1)
    # Half-precision pairs are read together; the step of float16 is an eighth of an 8-bit step.
    features = jnp.stack([grey.views, detail], axis=-1).astype(jnp.float16)

    def penalties(differences):
        grey_difference, detail_difference = differences
        return (
            geman_mcclure(grey_difference, settings.grey_tolerance),
            jnp.abs(grey_difference),
            geman_mcclure(detail_difference, settings.detail_tolerance),
        )

    def costs_of(disparity: Float[Array, "h w"]) -> ProposalCosts:
        costs = refined_sector_costs(
            features, disparity[None], penalties=penalties, offsets=grey.offsets
        )
        means = jax.vmap(lambda sums: sector_means(SectorCosts(sums, costs.weights)))(costs.sums)
        robust, absolute, detail = means.best_half[:, 0]
        aggregated = sample_half_resolution(searched.aggregated, candidates, disparity)
        return ProposalCosts.stack(
            sectors=means.sectors[0, :, 0],
            aperture=means.aperture[0, 0],
            best_half=robust,
            absolute=absolute,
            detail=detail,
            aggregated=aggregated / settings.max_aggregated_cost,
        )

    # One proposal at a time: a quarter of the memory in the same time.
    costs = jax.lax.map(costs_of, proposed)
    deviation = confidence(searched.probabilities, candidates).standard_deviation
    log_variance = 0.3 * jnp.log(jnp.square(deviation) + 1e-3)
    peak = max_leading(searched.probabilities)
    return Proposals(
        grey.centre, refined, proposed, costs, upsample2x(log_variance), upsample2x(peak)
    )


def continued_surfaces(
    disparity: Float[Array, "h w"], offsets: tuple[tuple[int, int], ...], step: int
) -> Float[Array, "n h w"]:
    """Continue the surfaces of the neighbours at the offsets to each pixel.

    Each surface is continued by its slope, so that on one surface all neighbours propose the same
    disparity, however slanted it is.
    """
    continued = sample_at_offsets(disparity, offsets)
    for axis, slope in enumerate(surface_slopes(disparity, step)):
        distance = jnp.array([offset[axis] for offset in offsets], disparity.dtype)
        continued = continued - distance[:, None, None] * sample_at_offsets(slope, offsets)
    return continued


def second_best(
    searched: SearchResult, candidates: Float[Array, " d"], min_distance: float
) -> Float[Array, "i j"]:
    """Return the disparity of least cost at the given distance or more from the best one."""
    far = jnp.abs(candidates[:, None, None] - searched.disparity[None]) > min_distance
    # A large number instead of infinity keeps the parabola through the neighbours finite.
    return winner_takes_all(jnp.where(far, searched.aggregated, 1e3), candidates)


def sample_half_resolution(
    volume: Float[Array, "d i j"], candidates: Float[Array, " d"], disparity: Float[Array, "h w"]
) -> Float[Array, "h w"]:
    """Interpolate a volume of half resolution at the disparity of each pixel.

    Args:
        volume: ``[d, h / 2, w / 2]`` values at the candidates.
        candidates: ``[d]`` evenly spaced disparities.
        disparity: ``[h, w]`` disparity map.
    """
    blocks = space_to_depth(disparity[None, ..., None])[0]
    values = interpolate_volume(volume, candidates, jnp.moveaxis(blocks, -1, 0))
    return depth_to_space(jnp.moveaxis(values, 0, -1)[None])[0, ..., 0]
