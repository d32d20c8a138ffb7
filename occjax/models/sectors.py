"""The cascade over volumes of sectors: any arrangement of views, any range of disparities."""

from __future__ import annotations

import flax.linen as nn
import jax
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from occjax.models.config import NetworkConfig, Planar, StageConfig
from occjax.models.features import FeatureNetwork
from occjax.models.guide import Guide
from occjax.models.pyramids import HourglassAggregation, PlanarAggregation
from occjax.models.refinement import SectorRefinement
from occjax.models.stages import StageOutput, stage_output
from occjax.models.upsampling import ConvexUpsampling
from occjax.ops.filtering import central_differences
from occjax.ops.sectors import (
    SECTORS,
    SectorCosts,
    coarse_sector_costs,
    refined_sector_costs,
    sector_channels,
    sector_of,
    sector_steps,
)

FEATURE_FLOOR = 1e-4
GREY_FLOOR = 1e-5
"""Squared differences below which costs are no longer told apart: of features, and of grey views
(a difference of 0.3 %)."""


class SectorCascade(nn.Module):
    """Coarse volume of features at half resolution, refined volumes of grey views, last steps.

    Every stage starts from the disparity before it, without a gradient: the stages are trained side
    by side.

    Attributes:
        config: The cascade; ``views`` is None.
        dtype: Type of the convolutions.
    """

    config: NetworkConfig
    dtype: DTypeLike = jnp.float32

    @nn.compact
    def __call__(
        self,
        views: Float[Array, "v u h w"],
        offsets: Float[Array, "v u 2"],
        candidates: Float[Array, " d"] | None,
        *,
        train: bool,
    ) -> tuple[StageOutput, ...]:
        """Estimate disparity, stage by stage.

        Args:
            views: ``[v, u, h, w]`` grey views in [0, 1].
            offsets: ``[v, u, 2]`` of the views from the centre view, in view steps.
            candidates: ``[d]`` disparities of the first stage; the configured ones, scaled to the
                largest offset, if None.
            train: Normalise by batch statistics.

        Returns:
            One output per stage, and one of the last refinement.
        """
        # Views n times as far apart show the same scene with disparities n times as small.
        scale = jnp.max(jnp.abs(offsets)) / self.config.reach
        offsets = offsets / scale
        if candidates is None:
            candidates = jnp.asarray(self.config.stages[0].candidates, jnp.float32)
        else:
            candidates = candidates * scale
        height, width = views.shape[2:]
        views = _padded(views, self.config.multiple)
        first, *others = self.config.stages

        output, guide = self._coarse(first, views, offsets, candidates, train)
        outputs, features = [output], None
        for index, stage in enumerate(others, start=1):
            output, features = self._refined(
                index, stage, views, offsets, outputs[-1].disparity, guide, train
            )
            outputs.append(output)
        if self.config.refinement is not None:
            outputs.append(self._steps(views, offsets, outputs[-1].disparity, features, train))
        return tuple(_unscaled(output, scale, height, width) for output in outputs)

    def _coarse(self, stage: StageConfig, views, offsets, candidates, train):
        v, u, h, w = views.shape
        network = FeatureNetwork(self.config.features, dtype=self.dtype, name="features")
        features = network(views.reshape(v * u, h, w, 1), train=train)
        features = features.reshape(v, u, *features.shape[1:]).astype(jnp.float32)
        costs = coarse_sector_costs(features, candidates / 2, offsets=offsets)
        relative, level = _relative(sector_channels(costs), FEATURE_FLOOR)
        centre = views[v // 2, u // 2]
        guide = Guide(stage.aggregation.widths, dtype=self.dtype, name="guide")(
            centre, jnp.moveaxis(level, 0, -1), train=train
        )
        aggregate = HourglassAggregation(stage.aggregation, dtype=self.dtype, name="stage_0")
        scores = aggregate(jnp.moveaxis(relative, 0, -1), guide, train=train)
        output = stage_output(scores, candidates, window=stage.window)
        squares = jnp.square(candidates[:, None, None] - output.disparity[None])
        deviation = jnp.sqrt((output.probabilities * squares).sum(0) + 1e-6)
        upsample = ConvexUpsampling(dtype=self.dtype, name="upsampling")
        fine = upsample(output.disparity, deviation, guide[0], train=train)
        return output._replace(disparity=fine), guide

    def _refined(self, index, stage: StageConfig, views, offsets, before, guide, train):
        before = jax.lax.stop_gradient(before)
        residuals = jnp.asarray(stage.candidates, jnp.float32)
        costs = refined_sector_costs(
            views, before, residuals, tolerance=stage.tolerance, offsets=offsets
        )
        relative, level = _relative(sector_channels(costs), GREY_FLOOR)
        centre = views[views.shape[0] // 2, views.shape[1] // 2]
        known = [
            relative.reshape(-1, *before.shape),
            level,
            _seen(costs, offsets),
            (centre - 0.5)[None],
            jnp.stack(central_differences(before)),
        ]
        image = jnp.moveaxis(jnp.concatenate(known), 0, -1)
        assert isinstance(stage.aggregation, Planar)
        aggregate = PlanarAggregation(stage.aggregation, dtype=self.dtype, name=f"stage_{index}")
        features = aggregate(image, guide, train=train)
        score = nn.Conv(len(residuals), (3, 3), dtype=self.dtype, name=f"stage_{index}_score")
        scores = jnp.moveaxis(score(features)[0].astype(jnp.float32), -1, 0)
        return stage_output(scores, residuals, before, window=stage.window), features

    def _steps(self, views, offsets, before, features, train) -> StageOutput:
        before = jax.lax.stop_gradient(before)
        config = self.config.refinement
        steps = sector_steps(views, before, tolerance=config.tolerance, offsets=offsets)
        refine = SectorRefinement(config, dtype=self.dtype, name="refinement")
        disparity = refine(before, steps, features, train=train)
        return StageOutput(disparity, None, None, None, None)


def _relative(channels: Float[Array, "k d h w"], floor: float):
    """Costs relative to their mean over the candidates, and the logarithm of that mean.

    What the contrast of the texture is must not matter for where the cost is least.
    """
    level = channels.mean(1)
    relative = channels / (level + floor)[:, None] - 1.0
    return relative, 0.3 * jnp.log(level + floor)


def _seen(costs: SectorCosts, offsets) -> Float[Array, "8 h w"]:
    """Share of the views of each sector that are seen."""
    present = jnp.any(offsets != 0.0, axis=-1).astype(costs.weights.dtype)
    views = (jax.nn.one_hot(sector_of(offsets), SECTORS) * present[..., None]).sum((0, 1))
    return costs.weights[:, 0] / jnp.maximum(views, 1.0)[:, None, None]


def _padded(views: Float[Array, "v u h w"], multiple: int) -> Float[Array, "v u i j"]:
    """Views with their last row and column repeated up to a multiple of pixels."""
    below, right = (-size % multiple for size in views.shape[2:])
    return jnp.pad(views, ((0, 0), (0, 0), (0, below), (0, right)), mode="edge")


def _unscaled(output: StageOutput, scale, height: int, width: int) -> StageOutput:
    """An output in pixels per view step of the light field given, without the padding."""
    probabilities, candidates = output.probabilities, output.candidates
    if probabilities is not None:
        stride = output.disparity.shape[0] // probabilities.shape[1]
        probabilities = probabilities[:, : -(-height // stride), : -(-width // stride)]
        candidates = candidates / scale
    return StageOutput(
        output.disparity[:height, :width] / scale, probabilities, candidates, None, None
    )
