"""The cascade over volumes of sectors: any arrangement of views, any range of disparities.

It stands on what needs no learning, the steps of the photometric estimator: truncated costs
aggregated semi-globally, and planes through Lucas-Kanade steps. Convolutions are trained to correct
them, so that an untrained network already is a usable estimator, and training is spent on what
those cannot do: edges, occlusions, large surfaces without texture.
"""

from __future__ import annotations

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
from occjax.models.refinement import SectorRefinement, first_score
from occjax.models.stages import StageOutput, stage_output
from occjax.ops.brightness import WHITE, vignetted, white_level
from occjax.ops.filtering import box_filter, central_differences, neighbours
from occjax.ops.matching import best_part, sector_sums, semi_global
from occjax.ops.noise import noise_level
from occjax.ops.refinement import median_filter, refine_disparity
from occjax.ops.regression import cheapest
from occjax.ops.sectors import (
    SectorCosts,
    refined_sector_costs,
    sector_channels,
    sector_steps,
)

GREY_TOLERANCE = 0.03
"""Grey difference between views that costs half, in refined volumes."""

DETAIL_TOLERANCE = 0.01
"""The same of what is left of grey without the mean of its surroundings."""

PLANE_RADIUS = 12.0
"""Reach of the fitted planes in the absence of edges, pixels."""

DARKNESS = 0.01
"""Grey up to which the sides of the centre view count as vignetted."""


class _LightField(NamedTuple):
    """What all stages look at.

    Attributes:
        grey: ``[v, u, h, w]`` views, the white of the centre view at 0.8.
        offsets: ``[v, u, 2]`` of the views, scaled to the network's reach.
    """

    grey: Float[Array, "v u h w"]
    offsets: Float[Array, "v u 2"]

    @property
    def centre(self) -> Float[Array, "h w"]:
        v, u = self.grey.shape[:2]
        return self.grey[v // 2, u // 2]

    @property
    def derivatives(self) -> Float[Array, "v u h w 2"]:
        """They do not see vignetting and the broad part of highlights."""
        return jnp.stack(central_differences(self.grey), axis=-1)

    @property
    def detail(self) -> Float[Array, "v u h w"]:
        """Grey without the mean of its surroundings; resists highlights, but not noise."""
        return self.grey - box_filter(self.grey, 1)


class SectorCascade(nn.Module):
    """A coarse volume of the whole range, refined volumes around its disparity, last steps.

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
        if candidates is None:
            candidates = jnp.asarray(self.config.stages[0].candidates, jnp.float32)
        else:
            candidates = candidates * scale
        height, width = views.shape[2:]
        white = white_level(views[views.shape[0] // 2, views.shape[1] // 2])
        grey = _padded(views * (WHITE / white), self.config.multiple)
        light_field = _LightField(grey, offsets / scale)

        first, *others = self.config.stages
        output, guide = self._coarse(first, light_field, candidates)
        outputs, features = [output], None
        for index, stage in enumerate(others, start=1):
            output, features = self._refined(index, stage, light_field, outputs[-1], guide)
            outputs.append(output)
        if self.config.refinement is not None:
            before = jax.lax.stop_gradient(outputs[-1].disparity)
            steps = [
                sector_steps(images, before, tolerance=tolerance, offsets=light_field.offsets)
                for images, tolerance in (
                    (light_field.grey, GREY_TOLERANCE),
                    (light_field.detail, DETAIL_TOLERANCE),
                )
            ]
            planes = _planes(light_field, before, 1, self.config.refinement.largest_step)
            refine = SectorRefinement(self.config.refinement, dtype=self.dtype, name="refinement")
            disparity = refine(before, steps, planes, of_kind(features, jax.Array))
            outputs.append(StageOutput(disparity, None, None))
        return tuple(_unscaled(output, scale, height, width) for output in outputs)

    def _spacing(self) -> float:
        candidates = self.config.stages[0].candidates
        return candidates[1] - candidates[0]

    def _coarse(self, stage: StageConfig, light_field: _LightField, candidates):
        prior = of_kind(stage.semi_global, SemiGlobalConfig)
        compared = of_kind(self.config.features, DerivativeFeatures)
        centre = light_field.centre
        costs, channels = _coarse_costs(light_field, candidates, compared)
        costs = jnp.where(vignetted(centre, DARKNESS), 0.0, costs)
        spacing = (candidates[-1] - candidates[0]) / (len(candidates) - 1)
        smooth = semi_global(
            costs,
            centre,
            small_penalty=prior.smoothness * spacing,
            large_penalty=prior.jump,
            guide_scale=prior.edge,
        )
        smooth = smooth - smooth.min(0, keepdims=True)
        ranking, level = _relative(channels, 0.02)
        guide = Guide(self.config.guide_widths, dtype=self.dtype, name="guide")(
            centre, jnp.moveaxis(level, 0, -1)
        )
        scores = -smooth / prior.temperature
        if not isinstance(stage.aggregation, Hourglass):
            disparity = cheapest(smooth, candidates)
            return StageOutput(disparity, jax.nn.softmax(scores, axis=0), candidates), guide
        volume = jnp.concatenate([ranking, jnp.minimum(_quartered(smooth), 2.0)[None]])
        aggregate = HourglassAggregation(stage.aggregation, dtype=self.dtype, name="stage_0")
        learned = aggregate(jnp.moveaxis(volume, 0, -1), guide[1:])
        scores += jax.image.resize(learned, smooth.shape, "bilinear", antialias=False)
        window = None if stage.window is None else stage.window * spacing
        return stage_output(scores, candidates, window=window), guide

    def _refined(self, index, stage: StageConfig, light_field, last: StageOutput, guide):
        last = jax.lax.stop_gradient(last)
        before = median_filter(last.disparity)
        before = _planes(light_field, before, stage.plane_steps, self._spacing())
        residuals = jnp.asarray(stage.candidates, jnp.float32)
        there = neighbours(before, stage.neighbours)
        disparities = jnp.concatenate([before[None] + residuals[:, None, None], there])
        costs = refined_sector_costs(
            jnp.stack([light_field.grey, light_field.detail], axis=-1),
            disparities,
            tolerance=jnp.array([GREY_TOLERANCE, DETAIL_TOLERANCE]),
            offsets=light_field.offsets,
        )
        ranking, level = _relative(sector_channels(costs), 0.003)
        moves = there - before[None]
        known = [
            (light_field.centre - 0.5)[None],
            jnp.stack(central_differences(before)),
            _spread(last),
            moves / (jnp.abs(moves) + 0.2),
            ranking.reshape(-1, *before.shape),
            level,
        ]
        volume = jnp.moveaxis(jnp.concatenate(known), 0, -1)
        aggregate = PlanarAggregation(
            of_kind(stage.aggregation, Planar), dtype=self.dtype, name=f"stage_{index}"
        )
        features = aggregate(volume, guide)
        nearest = min(range(len(stage.candidates)), key=lambda k: abs(stage.candidates[k]))
        score = nn.Conv(
            len(disparities),
            (3, 3),
            dtype=self.dtype,
            kernel_init=nn.initializers.zeros,
            bias_init=first_score(nearest),
            name=f"stage_{index}_score",
        )
        scores = jnp.moveaxis(score(features)[0].astype(jnp.float32), -1, 0)
        window = None
        if stage.window is not None:
            window = stage.window * (stage.candidates[1] - stage.candidates[0])
        relative = disparities - last.disparity[None]
        return stage_output(scores, relative, last.disparity, window=window), features


def _quartered(images: Float[Array, "*n h w"]) -> Float[Array, "*n i j"]:
    """Mean of each 4x4 pixels."""
    h, w = images.shape[-2:]
    return images.reshape(*images.shape[:-2], h // 4, 4, w // 4, 4).mean((-3, -1))


def _coarse_costs(
    light_field: _LightField, candidates: Float[Array, " d"], config: DerivativeFeatures
) -> tuple[Float[Array, "d h w"], Float[Array, "10 d i j"]]:
    """Costs over the best part of the aperture, and a quarter as finely those of all sectors."""
    features = jnp.concatenate([light_field.grey[..., None], light_field.derivatives], axis=-1)
    derivative = config.derivative_truncation
    noise = noise_level(light_field.grey, candidates, offsets=light_field.offsets)

    def keep(sums, numbers):
        coarser = SectorCosts(_quartered(sums)[:, None], numbers[:, None, None, None])
        return best_part(box_filter(sums, 1), numbers), sector_channels(coarser)[:, 0]

    costs, channels = sector_sums(
        features,
        candidates,
        truncation=jnp.array([config.grey_truncation, derivative, derivative]),
        # A central difference, half of that of two pixels, has half the variance.
        noise=noise * jnp.sqrt(jnp.array([1.0, 0.5, 0.5])),
        offsets=light_field.offsets,
        combine=keep,
    )
    return costs, jnp.moveaxis(channels, 0, 1)


def _planes(light_field: _LightField, disparity, steps: int, largest_step: float):
    """Planes through the common step of all views."""
    return refine_disparity(
        light_field.derivatives,
        disparity,
        light_field.centre,
        offsets=light_field.offsets,
        steps=steps,
        largest_step=largest_step,
        radius=PLANE_RADIUS,
    )


def _spread(output: StageOutput) -> Float[Array, "2 h w"]:
    """How sure a stage is: the spread of its candidates, and the probability of the likeliest."""
    probabilities = of_kind(output.probabilities, jax.Array)
    candidates = of_kind(output.candidates, jax.Array)
    if candidates.ndim == 1:
        candidates = candidates[:, None, None]
    mean = (probabilities * candidates).sum(0)
    squares = (probabilities * jnp.square(candidates)).sum(0) - jnp.square(mean)
    return jnp.stack([0.3 * jnp.log(jnp.maximum(squares, 0.0) + 1e-3), probabilities.max(0)])


def _relative(channels: Float[Array, "k d h w"], floor: float):
    """Costs relative to their mean over the candidates, and the logarithm of that mean.

    What the contrast of the texture is must not matter for where the cost is least.
    """
    level = channels.mean(1)
    relative = channels / (level + floor)[:, None] - 1.0
    return relative, 0.3 * jnp.log(level + floor)


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
