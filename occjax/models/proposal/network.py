"""ProposalNet: search, slanted-plane refinement, proposals, selection, residual, planes, voting.

The network takes any arrangement of views and any range of disparities. Everything before the
selection has no weights and is the training-free estimator. The selection decides which surface a
pixel near a depth edge belongs to; a learned residual then makes its disparity more precise.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import flax.linen as nn
import jax
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from occjax.errors import InputError
from occjax.kernels.median import median_filter
from occjax.kernels.padding import pad_borders
from occjax.kernels.reductions import softmax_leading, sum_leading
from occjax.models.proposal.config import ProposalNetConfig
from occjax.models.proposal.exposure import white_level
from occjax.models.proposal.filters import surface_slopes
from occjax.models.proposal.planar import flatten_planar_surfaces
from occjax.models.proposal.planes import Refined, refine
from occjax.models.proposal.proposals import (
    COST_CHANNELS,
    ProposalCosts,
    Proposals,
    make_proposals,
    sample_half_resolution,
)
from occjax.models.proposal.residual import (
    STATISTICS,
    Residual,
    ResidualStage,
    ResidualVolume,
    residual_volume,
)
from occjax.models.proposal.resolution import upsample2x
from occjax.models.proposal.search import GreyViews, SearchResult, search
from occjax.models.proposal.selector import ProposalSelector
from occjax.models.proposal.support import proposal_support
from occjax.models.proposal.voting import election_scores, region_votes, replace_outvoted
from occjax.ops import confidence, expected_disparity
from occjax.ops.sampling import as_coordinates, as_images, as_offsets


class Selection(NamedTuple):
    """Selection among the proposals.

    Attributes:
        disparity: ``[h, w]`` disparity of the most likely proposals.
        proposed: ``[k, h, w]`` proposed disparities.
        probabilities: ``[k, h, w]`` probability of each proposal.
    """

    disparity: Float[Array, "h w"]
    proposed: Float[Array, "k h w"]
    probabilities: Float[Array, "k h w"]


class ProposalOutput(NamedTuple):
    """Output of ProposalNet, in pixels per view step of the given light field.

    Attributes:
        disparity: ``[h, w]`` disparity of the centre view.
        coarse: ``[h, w]`` disparity of the semi-global search, median-filtered, at full resolution.
        refined: ``[h, w]`` disparity after the refinement by planes.
        confidence: ``[h, w]`` in [0, 1]; 1 is certain.
        standard_deviation: ``[h, w]`` standard deviation of the probabilities of the selection, or
            of the search without a selector.
        selection: Selection before the median filter, residual and planes; None without a selector.
    """

    disparity: Float[Array, "h w"]
    coarse: Float[Array, "h w"]
    refined: Float[Array, "h w"]
    confidence: Float[Array, "h w"]
    standard_deviation: Float[Array, "h w"]
    selection: Selection | None


class _Selected(NamedTuple):
    """Result before the residual; see :class:`ProposalOutput`.

    ``unsupported`` is the selection before :meth:`ProposalNet._support`.
    """

    disparity: Float[Array, "h w"]
    certainty: Float[Array, "h w"]
    standard_deviation: Float[Array, "h w"]
    information: Float[Array, "h w"]
    selection: Selection | None
    unsupported: Selection | None


class ProposalNet(nn.Module):
    """Disparity of the centre view from any arrangement of grey views.

    The network takes one light field without a batch axis.

    Attributes:
        config: All settings; with ``selector=None`` the training-free estimator, which has no
            variables.
        dtype: Type of the convolutions (float32 or bfloat16).

    Example:
        >>> network = ProposalNet(ProposalNetConfig(selector=None))
        >>> texture = jax.random.uniform(jax.random.key(0), (16, 24))
        >>> views = jnp.stack([jnp.roll(texture, -k, axis=1) for k in (-1, 0, 1)])[None]
        >>> output = jax.jit(network.apply)({}, views, candidates=jnp.linspace(-2.0, 2.0, 9))
        >>> round(float(output.disparity[8, 12]), 1)
        1.0
    """

    config: ProposalNetConfig
    dtype: DTypeLike = jnp.float32

    def setup(self) -> None:
        """Create the learned parts."""
        if self.config.selector is not None:
            self.selector = ProposalSelector(
                self.config.selector, self.config.proposals.offsets, dtype=self.dtype
            )
        if self.config.residual is not None:
            self.residual = ResidualStage(self.config.residual, dtype=self.dtype)

    def __call__(
        self,
        views: Float[Array, "v u h w"],
        *,
        candidates: Float[Array, " d"] | None = None,
        offsets: Float[Array, "v u 2"] | None = None,
        white: Float[Array, ""] | None = None,
        colour: Float[Array, "c h w"] | None = None,
    ) -> ProposalOutput:
        """Estimate the disparity of the centre view.

        Args:
            views: ``[v, u, h, w]`` grey views in [0, 1], at least 3x3 pixels.
            candidates: ``[d]`` disparities to search, at least 3, evenly spaced and ascending, in
                pixels per view step. By default the configured range and interval, at the
                configured reach.
            offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view; a
                regular grid by default.
            white: Grey level that counts as white, for a part of a larger image; by default that of
                the centre view.
            colour: ``[c, h, w]`` channels of the centre view in [0, 1], which tell surfaces of
                equal grey apart; by default its grey.

        Returns:
            Disparity, the results of the steps before it, and the confidence.

        Raises:
            InputError: For a single view, integer views, or fewer than three candidates.
        """
        height, width = views.shape[2:]
        grey, candidates, scale = self.normalise(
            views,
            candidates,
            offsets,
            multiple=self.config.size_multiple,
            white=white,
            colour=colour,
        )
        searched, coarse, refined = self.search_and_refine(grey, candidates)
        selected = self._select_disparity(grey, candidates, searched, refined)
        disparity, certainty = selected.disparity, selected.certainty
        if self.config.residual is not None:
            residual = self.residual(self._volume(grey, selected))
            disparity = disparity + residual.disparity
            # On scenes unlike those of the training, the product orders the pixels better than the
            # learned probability alone. It is zero where nothing was found.
            certainty = certainty * residual.confidence
        if self.config.planar is not None:
            disparity = flatten_planar_surfaces(disparity, selected.information, self.config.planar)
        if self.config.voting is not None and selected.unsupported is not None:
            disparity = self._vote(
                disparity, certainty, selected.unsupported, searched, candidates, grey
            )
        output = ProposalOutput(
            disparity,
            coarse,
            refined.disparity,
            certainty,
            selected.standard_deviation,
            selected.selection,
        )
        return _in_original_units(output, scale, height, width)

    def _select_disparity(
        self,
        grey: GreyViews,
        candidates: Float[Array, " d"],
        searched: SearchResult,
        refined: Refined,
    ) -> _Selected:
        """Select a disparity for each pixel, or keep the refined one; compute its confidence."""
        spread = confidence(searched.probabilities, candidates)
        certainty = spread.certainty(len(candidates))
        deviation = spread.standard_deviation
        if self.config.search.downsampling == 2:
            certainty, deviation = upsample2x(certainty), upsample2x(deviation)
        selection, unsupported, disparity = None, None, refined.disparity
        if self.config.selector is None:
            certainty = certainty * _smoothness(disparity, self.config.confidence.edge_step)
        else:
            selection = self.select(
                make_proposals(grey, searched, refined.disparity, candidates, self.config)
            )
            unsupported = selection
            if self.config.support is not None:
                selection = self._support(selection, certainty, grey.appearance)
            # A single pixel that differs from all its neighbours is more often wrong than correct.
            disparity = median_filter(selection.disparity)
            certainty = selection_confidence(selection, certainty, self.config)
            difference = selection.proposed - selection.disparity[None]
            deviation = confidence(selection.probabilities, difference).standard_deviation
        information = refined.information * jnp.square(certainty)
        return _Selected(disparity, certainty, deviation, information, selection, unsupported)

    def _support(
        self,
        selection: Selection,
        certainty: Float[Array, "h w"],
        appearance: Float[Array, "c h w"],
    ) -> Selection:
        """Select again, by the product of probability and support of each proposal.

        The probabilities of the result, and with them the confidence, are the product with the root
        of the support: those of the full product are too close to 0 and 1.

        Args:
            selection: Selection by the selector.
            certainty: ``[h, w]`` certainty of the search.
            appearance: ``[c, h, w]`` colour or grey of the centre view.

        Returns:
            The new selection.
        """
        settings = self.config.support
        assert settings is not None
        disparity = median_filter(selection.disparity)
        support = proposal_support(
            selection.proposed,
            disparity,
            surface_slopes(disparity, self.config.proposals.slope_step_px),
            selection_confidence(selection, certainty, self.config),
            appearance,
            settings,
        )
        factor = (support + settings.floor) ** (settings.exponent / 2)
        probabilities = _normalised(selection.probabilities * factor)
        supported = self._most_likely(selection.proposed, _normalised(probabilities * factor))
        return supported._replace(probabilities=probabilities)

    def _vote(
        self,
        disparity: Float[Array, "h w"],
        certainty: Float[Array, "h w"],
        selection: Selection,
        searched: SearchResult,
        candidates: Float[Array, " d"],
        grey: GreyViews,
    ) -> Float[Array, "h w"]:
        """Replace disparities by those for which the pixels around vote.

        Args:
            disparity: ``[h, w]`` disparity.
            certainty: ``[h, w]`` its confidence in [0, 1].
            selection: Selection among the proposals, without their support.
            searched: Result of the search.
            candidates: ``[d]`` candidates of the search.
            grey: Views.

        Returns:
            ``[h, w]`` disparity.
        """
        settings = self.config.voting
        assert settings is not None
        # The residual can leave the range of the candidates, outside of which nothing is known.
        within = jnp.clip(disparity, candidates[0], candidates[-1])
        slopes = surface_slopes(within, self.config.proposals.slope_step_px)
        votes = region_votes(within, slopes, certainty, grey.appearance, candidates, settings)

        def cost(of: Float[Array, "h w"]) -> Float[Array, "h w"]:
            return sample_half_resolution(searched.costs, candidates, of)

        costs = jax.lax.map(cost, jnp.concatenate([votes.elected, within[None]]))
        scores = election_scores(
            votes, costs[:2] - costs[2:], selection.proposed, selection.probabilities, settings
        )
        return replace_outvoted(disparity, votes.elected, scores, settings)

    def _volume(self, grey: GreyViews, selected: _Selected) -> ResidualVolume:
        """Compute the volume around the disparity that was selected."""
        assert self.config.residual is not None
        return residual_volume(
            grey,
            selected.disparity,
            selected.certainty,
            selected.information,
            self.config.residual,
        )

    def normalise(
        self,
        views: Float[Array, "v u h w"],
        candidates: Float[Array, " d"] | None,
        offsets: Float[Array, "v u 2"] | None,
        *,
        multiple: int,
        white: Float[Array, ""] | None = None,
        colour: Float[Array, "c h w"] | None = None,
    ) -> tuple[GreyViews, Float[Array, " d"], Float[Array, ""]]:
        """Scale brightness to the configured white and offsets to the configured reach.

        Views at n times the distance show the same scene with disparities n times as large.

        Args:
            views: ``[v, u, h, w]`` grey views in [0, 1].
            candidates: ``[d]`` disparities, or None for the default range.
            offsets: ``[v, u, 2]`` offset of each view, or None for a regular grid.
            multiple: Number of pixels that height and width are padded to a multiple of.
            white: Grey level that counts as white; None for that of the centre view.
            colour: ``[c, h, w]`` channels of the centre view, or None.

        Returns:
            Padded views, candidates at the configured reach, and the factor of the disparities.
        """
        views = as_images(views, "v u h w")
        v, u, h, w = views.shape
        if min(h, w) < 3:
            raise InputError(f"views must be at least 3x3 pixels, not {h}x{w}")
        offsets = as_offsets(offsets, (v, u))
        if v * u < 2:
            raise InputError("one view has no disparity; give a grid of at least 1x2 views")
        scale = jnp.max(jnp.abs(offsets)) / self.config.reach
        if candidates is None:
            interval = self.config.search.interval
            steps = round(self.config.search.default_limit / interval)
            candidates = interval * jnp.arange(-steps, steps + 1.0)
        else:
            if len(candidates) < 3:
                raise InputError(f"candidates must be at least 3, not {len(candidates)}")
            candidates = as_coordinates(candidates)[0] * scale
        white = white_level(views) if white is None else white
        below, right = (-size % multiple for size in (h, w))

        def scaled(images: Float[Array, "*n h w"]) -> Float[Array, "*n _ _"]:
            images = images * (self.config.exposure.white / white)
            return pad_borders(images, (0, below), (0, right))

        if colour is not None:
            colour = as_images(colour, "c h w", "colour")
            if not colour.shape[0] or colour.shape[1:] != (h, w):
                raise InputError(f"colour must be [c, {h}, {w}], not {list(colour.shape)}")
            colour = scaled(colour)
        return GreyViews(scaled(views), offsets / scale, colour), candidates, scale

    def search_and_refine(
        self, grey: GreyViews, candidates: Float[Array, " d"]
    ) -> tuple[SearchResult, Float[Array, "h w"], Refined]:
        """Run the training-free steps.

        Args:
            grey: Normalised views.
            candidates: ``[d]`` disparities to search at the configured reach.

        Returns:
            Result of the search, ``[h, w]`` its disparity at full resolution, and the refined
            disparity.
        """
        searched = search(grey, candidates, self.config)
        coarse, refined = refine(grey, searched, candidates, self.config)
        return searched, coarse, refined

    def select(self, proposals: Proposals) -> Selection:
        """Select among proposals; the first learned step.

        Args:
            proposals: Proposals; height and width must be multiples of ``config.size_multiple``.

        Returns:
            The selection: expectation over the proposals close to the most likely one.
        """
        assert self.config.selector is not None
        return self._most_likely(proposals.proposed, softmax_leading(self.selector(proposals)))

    def _most_likely(
        self, proposed: Float[Array, "k h w"], probabilities: Float[Array, "k h w"]
    ) -> Selection:
        """Select the expectation over the proposals close to the most likely one."""
        assert self.config.selector is not None
        # The first proposal is the refined disparity; differences from it lose fewer digits.
        difference = proposed - proposed[:1]
        index = jnp.argmax(probabilities, axis=0, keepdims=True)
        likeliest = jnp.take_along_axis(difference, index, axis=0)
        # The factor keeps proposals at exactly this distance despite rounding.
        near = jnp.abs(difference - likeliest) <= 1.001 * self.config.selector.window
        averaged = _normalised(jnp.where(near, probabilities, 0.0))
        disparity = proposed[0] + expected_disparity(averaged, difference)
        return Selection(disparity, proposed, probabilities)

    def compute_residual(self, volume: ResidualVolume) -> Residual:
        """Compute the residual of a disparity from the volume around it.

        Args:
            volume: Volume; height and width must be multiples of ``config.size_multiple``.

        Returns:
            Residual at the configured reach, and confidence.
        """
        return self.residual(volume)

    def propose(self, views: Float[Array, "v u h w"], offsets: Float[Array, "v u 2"]) -> Proposals:
        """Compute the proposals of the default range, which depend on no weights.

        Args:
            views: ``[v, u, h, w]`` grey views in [0, 1].
            offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view, in
                view steps.

        Returns:
            Proposals of the size of the views; disparities are those at the configured reach.
        """
        height, width = views.shape[2:]
        grey, candidates, _ = self.normalise(views, None, offsets, multiple=2)
        searched, _, refined = self.search_and_refine(grey, candidates)
        proposals = make_proposals(grey, searched, refined.disparity, candidates, self.config)
        return jax.tree.map(lambda maps: maps[..., :height, :width], proposals)

    def compute_volume(
        self, views: Float[Array, "v u h w"], offsets: Float[Array, "v u 2"]
    ) -> ResidualVolume:
        """Compute the volume around the selected disparity, in the default range.

        Args:
            views: ``[v, u, h, w]`` grey views in [0, 1].
            offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view, in
                view steps.

        Returns:
            Volume of the size of the views; disparities are those at the configured reach.
        """
        assert self.config.residual is not None
        height, width = views.shape[2:]
        grey, candidates, _ = self.normalise(
            views, None, offsets, multiple=self.config.size_multiple
        )
        searched, _, refined = self.search_and_refine(grey, candidates)
        selected = self._select_disparity(grey, candidates, searched, refined)
        volume = self._volume(grey, selected)
        return jax.tree.map(lambda maps: maps[..., :height, :width], volume)


def random_variables(config: ProposalNetConfig, key: Array) -> dict:
    """Return random variables, without computing or tracing the steps that have none.

    Args:
        config: The network.
        key: Random key.
    """
    network = ProposalNet(config)
    size = (config.size_multiple,) * 2
    maps = jnp.zeros(size)
    params: dict[str, Any] = {}
    if config.selector is not None:
        count = len(config.proposals.offsets) + 2
        costs = ProposalCosts(jnp.zeros((count, COST_CHANNELS, *size), jnp.float16))
        proposals = Proposals(maps, maps, jnp.zeros((count, *size)), costs, maps, maps)
        params |= network.init(key, proposals, method="select")["params"]
    if config.residual is not None:
        relative = jnp.zeros((STATISTICS, len(config.residual.candidates), *size), jnp.float16)
        volume = ResidualVolume(maps, maps, relative[:, 0], relative, maps, maps)
        params |= network.init(key, volume, method="compute_residual")["params"]
    return {"params": params} if params else {}


def variable_shapes(config: ProposalNetConfig) -> dict:
    """Return shapes and types of the network's variables without computing any.

    Args:
        config: The network.

    Returns:
        ``variables`` with a ``jax.ShapeDtypeStruct`` for each array.
    """
    return dict(jax.eval_shape(partial(random_variables, config), jax.random.key(0)))


def _normalised(weights: Float[Array, "k h w"]) -> Float[Array, "k h w"]:
    """Return probabilities proportional to the weights."""
    return weights / sum_leading(weights)[None]


def _smoothness(disparity: Float[Array, "h w"], edge_step: float) -> Float[Array, "h w"]:
    """Return 1 where 3x3 disparities are equal, 1/2 where they differ by ``edge_step``."""

    def extreme(initial: float, combine: Callable[[Array, Array], Array]) -> Array:
        return jax.lax.reduce_window(disparity, initial, combine, (3, 3), (1, 1), "SAME")

    extent = extreme(-jnp.inf, jax.lax.max) - extreme(jnp.inf, jax.lax.min)
    return edge_step / (edge_step + extent)


def selection_confidence(
    selection: Selection, certainty: Float[Array, "h w"], config: ProposalNetConfig
) -> Float[Array, "h w"]:
    """Return the probability of all proposals close to the selected disparity.

    Equal proposals are counted together, which the entropy of the proposals would not do. Where the
    search found nothing (``certainty`` near 0), all proposals may share one wrong disparity;
    therefore the probability is reduced there.
    """
    assert config.selector is not None
    distance = jnp.abs(selection.proposed - selection.disparity[None])
    near = distance <= config.selector.window
    # Rounding can make the sum larger than 1.
    probability = jnp.minimum(sum_leading(jnp.where(near, selection.probabilities, 0.0)), 1.0)
    return probability * jnp.minimum(certainty / config.confidence.sufficient_certainty, 1.0)


def _in_original_units(output: ProposalOutput, scale, height: int, width: int) -> ProposalOutput:
    """Remove the padding and convert to pixels per view step of the given light field."""
    output = jax.tree.map(lambda maps: maps[..., :height, :width], output)
    selection = output.selection
    if selection is not None:
        selection = selection._replace(
            disparity=selection.disparity / scale, proposed=selection.proposed / scale
        )
    return output._replace(
        disparity=output.disparity / scale,
        coarse=output.coarse / scale,
        refined=output.refined / scale,
        standard_deviation=output.standard_deviation / scale,
        selection=selection,
    )
