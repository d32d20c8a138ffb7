"""The cascade over volumes of sectors: any arrangement of views, any range of disparities.

It stands on what needs no learning: truncated costs aggregated semi-globally, and planes through
Gauss-Newton steps. Convolutions are trained to correct them, so that an untrained network already
is a usable estimator, and training is spent on what those cannot do: edges, occlusions, large
surfaces without texture.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import flax.linen as nn
import jax
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from occjax.models.config import (
    DerivativeFeatures,
    Hourglass,
    NetworkConfig,
    Planar,
    SemiGlobalConfig,
    StageConfig,
    of_kind,
)
from occjax.models.guide import Guide
from occjax.models.pyramids import HourglassAggregation, PlanarAggregation
from occjax.models.refinement import LEAST_INFORMATION, SectorRefinement
from occjax.models.stages import StageOutput, stage_output
from occjax.models.upsampling import ConvexUpsampling
from occjax.ops.filtering import box_filter, central_differences, fit_planes
from occjax.ops.matching import semi_global
from occjax.ops.sectors import (
    SECTORS,
    SectorCosts,
    SectorSteps,
    coarse_sector_costs,
    refined_sector_costs,
    sector_channels,
    sector_of,
    sector_steps,
)

LARGEST_STEP = 0.2
"""Bound of a Gauss-Newton step, pixels per view step."""

PLANE_RADIUS = 12.0
"""Reach of the fitted planes in the absence of edges, pixels."""

GUIDE_EDGE = 0.03
"""Grey difference that bounds a plane, as far as its radius does."""

DISPARITY_EDGE = 0.15
"""Difference of disparity that bounds a plane likewise."""


class _Image(NamedTuple):
    """A kind of image that views are compared by.

    Attributes:
        views: ``[v, u, h, w]``.
        tolerance: Difference at which a view counts half.
        floor: Squared difference below which costs are no longer told apart.
    """

    views: Float[Array, "v u h w"]
    tolerance: float
    floor: float


class SectorCascade(nn.Module):
    """Coarse volume at half resolution, refined volumes at the full one, last steps.

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
    ) -> tuple[StageOutput, ...]:
        """Estimate disparity, stage by stage.

        Args:
            views: ``[v, u, h, w]`` grey views in [0, 1].
            offsets: ``[v, u, 2]`` of the views from the centre view, in view steps.
            candidates: ``[d]`` disparities of the first stage; the configured ones, scaled to the
                largest offset, if None.

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
        # Grey values resist noise; what is left without their surroundings resists highlights.
        images = [_Image(views, 0.03, 1e-5), _Image(views - box_filter(views, 1), 0.01, 1e-6)]
        centre = views[views.shape[0] // 2, views.shape[1] // 2]

        first, *others = self.config.stages
        output, guide = self._coarse(first, views, centre, offsets, candidates)
        outputs = [output]
        for index, stage in enumerate(others, start=1):
            before = jax.lax.stop_gradient(outputs[-1].disparity)
            for _ in range(stage.plane_steps):
                before = _planes(_steps(images, before, offsets), images, before, centre)
            output, features = self._refined(index, stage, images, centre, offsets, before, guide)
            outputs.append(output)
        if self.config.refinement is not None:
            before = jax.lax.stop_gradient(outputs[-1].disparity)
            steps = _steps(images, before, offsets)
            planes = _planes(steps, images, before, centre)
            refine = SectorRefinement(self.config.refinement, dtype=self.dtype, name="refinement")
            disparity = refine(before, steps, planes, features)
            outputs.append(StageOutput(disparity, None, None))
        return tuple(_unscaled(output, scale, height, width) for output in outputs)

    def _coarse(self, stage: StageConfig, views, centre, offsets, candidates):
        hourglass = of_kind(stage.aggregation, Hourglass)
        prior = of_kind(stage.semi_global, SemiGlobalConfig)
        compared = of_kind(self.config.features, DerivativeFeatures)
        costs = _truncated_costs(_halved(views), candidates / 2, offsets, compared)
        channels = sector_channels(costs)
        relative, level = _relative(channels, 0.02)
        smooth = _semi_globally(channels[-1], candidates, _halved(centre), prior)
        smooth = smooth - smooth.min(0, keepdims=True)
        volume = jnp.concatenate([relative, jnp.minimum(smooth, 2.0)[None]])
        guide = Guide(hourglass.widths, dtype=self.dtype, name="guide")(
            centre, jnp.moveaxis(level, 0, -1)
        )
        aggregate = HourglassAggregation(hourglass, dtype=self.dtype, name="stage_0")
        learned = aggregate(jnp.moveaxis(volume, 0, -1), guide)
        start = nn.initializers.constant(-math.log(prior.temperature))
        sharpness = jnp.exp(self.param("semi_global_sharpness", start, ()))
        output = stage_output(learned - sharpness * smooth, candidates, window=stage.window)
        squares = jnp.square(candidates[:, None, None] - output.disparity[None])
        probabilities = of_kind(output.probabilities, jax.Array)
        deviation = jnp.sqrt((probabilities * squares).sum(0) + 1e-6)
        upsample = ConvexUpsampling(dtype=self.dtype, name="upsampling")
        fine = upsample(output.disparity, deviation, guide[0])
        return output._replace(disparity=fine), guide

    def _refined(self, index, stage: StageConfig, images, centre, offsets, before, guide):
        residuals = jnp.asarray(stage.candidates, jnp.float32)
        known = [(centre - 0.5)[None], jnp.stack(central_differences(before))]
        for image in images:
            costs = refined_sector_costs(
                image.views, before, residuals, tolerance=image.tolerance, offsets=offsets
            )
            relative, level = _relative(sector_channels(costs), image.floor)
            known += [relative.reshape(-1, *before.shape), level, _seen(costs, offsets)]
        volume = jnp.moveaxis(jnp.concatenate(known), 0, -1)
        aggregate = PlanarAggregation(
            of_kind(stage.aggregation, Planar), dtype=self.dtype, name=f"stage_{index}"
        )
        features = aggregate(volume, guide)
        score = nn.Conv(
            len(residuals),
            (3, 3),
            dtype=self.dtype,
            kernel_init=nn.initializers.zeros,
            name=f"stage_{index}_score",
        )
        scores = jnp.moveaxis(score(features)[0].astype(jnp.float32), -1, 0)
        return stage_output(scores, residuals, before, window=stage.window), features


def _halved(images: Float[Array, "*n h w"]) -> Float[Array, "*n i j"]:
    """Mean of each 2x2 pixels."""
    rows = images[..., ::2, :] + images[..., 1::2, :]
    return (rows[..., ::2] + rows[..., 1::2]) / 4


def _truncated_costs(views, candidates, offsets, config: DerivativeFeatures) -> SectorCosts:
    """Of grey and its derivatives, which do not see vignetting and the broad part of highlights."""
    features = jnp.stack([views, *central_differences(views)], axis=-1)
    derivative = config.derivative_truncation
    truncation = jnp.array([config.grey_truncation, derivative, derivative])
    return coarse_sector_costs(features, candidates, truncation=truncation, offsets=offsets)


def _semi_globally(costs, candidates, guide, config: SemiGlobalConfig) -> Float[Array, "d h w"]:
    spacing = (candidates[-1] - candidates[0]) / (len(candidates) - 1)
    return semi_global(
        costs,
        guide,
        small_penalty=config.smoothness * spacing,
        large_penalty=config.jump,
        guide_scale=config.edge,
    )


def _steps(images: list[_Image], before, offsets) -> list[SectorSteps]:
    """Steps of all sectors, by each kind of image."""
    return [
        sector_steps(image.views, before, tolerance=image.tolerance, offsets=offsets)
        for image in images
    ]


def _planes(steps: list[SectorSteps], images: list[_Image], before, centre):
    """Planes through the common step of all sectors and kinds, weighted by what they know.

    Kinds of image count by the inverse variance of their differences.
    """
    weights = [(images[0].tolerance / image.tolerance) ** 2 for image in images]
    pairs = list(zip(weights, steps, strict=True))
    nothing = jnp.zeros_like(before)
    information = sum((weight * kind.information.sum(0) for weight, kind in pairs), nothing)
    push = sum((weight * kind.push.sum(0) for weight, kind in pairs), nothing)
    step = jnp.clip(push / (information + LEAST_INFORMATION), -LARGEST_STEP, LARGEST_STEP)
    edges = jnp.stack([box_filter(centre, 1) / GUIDE_EDGE, before / DISPARITY_EDGE])
    information = information + 0.01 * LEAST_INFORMATION
    return fit_planes(before + step, information, edges, radius=PLANE_RADIUS)


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
    return StageOutput(output.disparity[:height, :width] / scale, probabilities, candidates)
