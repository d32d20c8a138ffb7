"""The light network: any arrangement of views, any range of disparities.

It stands on what needs no learning, the steps of the photometric estimator, which are right away
from depth edges. What is learned is which surface a pixel near an edge belongs to.
"""

from __future__ import annotations

import flax.linen as nn
import jax
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from occjax.models.choice import ProposalChoice
from occjax.models.config import Choice, NetworkConfig, of_kind
from occjax.models.proposals import GreyViews, Proposals, Search, propose, refine, search
from occjax.models.stages import StageOutput, stage_output
from occjax.ops.brightness import WHITE, white_level
from occjax.ops.refinement import median_filter
from occjax.ops.resolution import double


class SectorCascade(nn.Module):
    """A search of the whole range, a choice among proposals, a median.

    Attributes:
        config: The cascade; ``views`` is None.
        dtype: Type of the convolutions.
    """

    config: NetworkConfig
    dtype: DTypeLike = jnp.float32

    def setup(self) -> None:
        """Build the learned part."""
        stage = self.config.stages[1]
        self.choice = ProposalChoice(
            of_kind(stage.aggregation, Choice), stage.neighbours, dtype=self.dtype
        )

    def __call__(
        self,
        views: Float[Array, "v u h w"],
        offsets: Float[Array, "v u 2"],
        candidates: Float[Array, " d"] | None,
    ) -> tuple[StageOutput, ...]:
        """Estimate disparity, stage by stage.

        Args:
            views: ``[v, u, h, w]`` grey views in [0, 1].
            offsets: ``[v, u, 2]`` of the views from the centre view, in view steps.
            candidates: ``[d]`` disparities of the first stage; the configured ones, scaled to the
                largest offset, if None.

        Returns:
            One output per stage, and the last one's 3x3 median.
        """
        height, width = views.shape[2:]
        grey, candidates, scale = self._scaled(views, offsets, candidates, self.config.multiple)
        found, proposals = self._proposed(grey, candidates)
        first = StageOutput(double(found.disparity), double(found.probabilities), candidates)
        chosen = self.choose(proposals)
        from_first = proposals.proposed - first.disparity[None]
        outputs = [first, chosen._replace(candidates=from_first)]
        # Single pixels that chose differently from all around them are more often wrong than right.
        outputs.append(StageOutput(median_filter(chosen.disparity), None, None))
        return tuple(_unscaled(output, scale, height, width) for output in outputs)

    def propose(self, views: Float[Array, "v u h w"], offsets: Float[Array, "v u 2"]) -> Proposals:
        """What the network chooses from, which depends on no weights.

        Args:
            views: ``[v, u, h, w]`` grey views in [0, 1].
            offsets: ``[v, u, 2]`` of the views from the centre view, in view steps.

        Returns:
            The proposals, disparities scaled to the network's reach.
        """
        height, width = views.shape[2:]
        grey, candidates, _ = self._scaled(views, offsets, None, multiple=2)
        _, proposals = self._proposed(grey, candidates)
        return jax.tree.map(lambda maps: maps[..., :height, :width], proposals)

    def choose(self, proposals: Proposals) -> StageOutput:
        """The second stage: the disparity of the best proposals.

        Args:
            proposals: Of images whose height and width are multiples of ``config.multiple``.

        Returns:
            Its output, candidates relative to ``proposals.disparity``.
        """
        relative = proposals.proposed - proposals.disparity[None]
        window = self.config.stages[1].window
        return stage_output(self.choice(proposals), relative, proposals.disparity, window=window)

    def _proposed(self, grey: GreyViews, candidates: Array) -> tuple[Search, Proposals]:
        """What the search found, and what is proposed after the planes."""
        found = search(grey, candidates, self.config)
        disparity = refine(grey, found, candidates, self.config)
        return found, propose(grey, found, disparity, candidates, self.config)

    def _scaled(self, views, offsets, candidates, multiple) -> tuple[GreyViews, Array, Array]:
        """Padded views at their white, offsets within the network's reach, candidates, the scale.

        Views n times as far apart show the same scene with disparities n times as small.
        """
        scale = jnp.max(jnp.abs(offsets)) / self.config.reach
        if candidates is None:
            candidates = jnp.asarray(self.config.stages[0].candidates, jnp.float32)
        else:
            candidates = candidates * scale
        white = white_level(views[views.shape[0] // 2, views.shape[1] // 2])
        grey = _padded(views * (WHITE / white), multiple)
        return GreyViews(grey, offsets / scale), candidates, scale


def _padded(views: Float[Array, "v u h w"], multiple: int) -> Float[Array, "v u i j"]:
    """Views with their last row and column repeated up to a multiple of pixels."""
    below, right = (-size % multiple for size in views.shape[2:])
    return jnp.pad(views, ((0, 0), (0, 0), (0, below), (0, right)), mode="edge")


def _unscaled(output: StageOutput, scale, height: int, width: int) -> StageOutput:
    """An output in pixels per view step of the light field given, without the padding."""
    disparity, probabilities, candidates = (
        part if part is None or part.ndim < 2 else part[..., :height, :width] for part in output[:3]
    )
    if candidates is not None:
        candidates = candidates / scale
    return StageOutput(disparity / scale, probabilities, candidates)
