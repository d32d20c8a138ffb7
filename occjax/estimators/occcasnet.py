"""OccCasNet and the paper's variants."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from occjax.errors import InputError
from occjax.estimators.protocol import DisparityRange, ModelEstimator, ModelInputs
from occjax.estimators.ranges import check_range
from occjax.layout import view_brightness
from occjax.lightfield import LightField
from occjax.models.occcasnet.config import OccCasNetConfig


@dataclass(frozen=True)
class OccCasNetEstimator(ModelEstimator):
    """Estimator of an :class:`occjax.models.OccCasNet`."""

    config: OccCasNetConfig

    def prepare(
        self, light_field: LightField, disparity_range: DisparityRange | None
    ) -> ModelInputs:
        """Crop the grid, convert the views to grey and shift the candidates to the range.

        Raises:
            InputError: If the light field has too few views, the requested range is wider than that
                of the network, or the network needs a ground truth that is missing.
        """
        notes = []
        if self.config.warp == "transposed":
            notes.append(
                "warp: transposed, as in the published code (rows move with u); pass --warp "
                "correct to override"
            )
        grid, views = light_field.grid, self.config.views
        if grid[0] < views[0] or grid[1] < views[1]:
            raise InputError(
                f"{light_field.name}: has {grid[0]}x{grid[1]} views, the network takes "
                f"{views[0]}x{views[1]}; use the model proposal or photometric, which take any grid"
            )
        if grid != views:
            light_field = light_field.central(*views)
            notes.append(f"the central {views[0]}x{views[1]} of {grid[0]}x{grid[1]} views are used")
        brightness = view_brightness(light_field)
        if not brightness.usable.all():
            raise InputError(
                f"{light_field.name}: {(~brightness.usable).sum()} of its {views[0]}x{views[1]} "
                "views are missing or dark, but the network takes all of them; use the model "
                "proposal"
            )
        notes += brightness.notes
        if light_field.positions is not None:
            notes.append(
                "the camera positions are ignored, so the map may be wrong: the network assumes a "
                "square grid; use the model proposal"
            )
        candidates = np.asarray(self.config.stages[0].candidates, np.float32)
        search_range = light_field.disparity_range
        if disparity_range is not None:
            search_range = check_range(disparity_range)
        low, high = float(candidates[0]), float(candidates[-1])
        if search_range is not None and not (low <= search_range[0] and search_range[1] <= high):
            candidates = candidates + np.float32((sum(search_range) - (low + high)) / 2)
            low, high = float(candidates[0]), float(candidates[-1])
            notes.append(f"the searched disparities are [{low:.2f}, {high:.2f}]")
        if search_range is not None and search_range[1] - search_range[0] > high - low + 1e-6:
            message = (
                f"the network covers {high - low:g} pixels of disparity, less than the range "
                f"[{search_range[0]:g}, {search_range[1]:g}]"
            )
            if disparity_range is not None:
                raise InputError(
                    f"{light_field.name}: {message}; use the model proposal, which takes any range"
                )
            notes.append(f"{message}; disparities outside of it are wrong")
        if self.config.needs_visibility:
            raise InputError(
                f"{light_field.name}: the network takes the exact visibility of every view, which "
                "light fields do not have; use another model"
            )
        truth = light_field.ground_truth if self.config.needs_ground_truth else None
        if truth is not None:  # a missing value would spread through the convolutions
            truth = np.where(np.isfinite(truth), truth, np.float32(0.0))
        elif self.config.needs_ground_truth:
            raise InputError(
                f"{light_field.name}: the network computes occlusion maps from the ground truth, "
                "which is missing; use another model"
            )
        grey = np.empty(light_field.views.shape[:-1], np.float32)
        for v, u in np.ndindex(*light_field.grid):
            grey[v, u] = brightness.grey(light_field, v, u)
        return ModelInputs(self.variables, grey, (candidates, truth), (low, high), tuple(notes))

    def run(
        self,
        variables: dict,
        views: jax.Array,
        candidates: jax.Array,
        ground_truth: jax.Array | None,
    ) -> dict[str, Any]:
        """Apply the network in strips."""
        # Imported when the network is traced: a kept program needs neither Flax nor the network.
        from occjax.models.occcasnet import StageOutput, predict
        from occjax.ops import confidence

        stages: tuple[StageOutput, ...] = predict(
            variables,
            views,
            self.config,
            candidates=candidates,
            ground_truth=ground_truth,
            dtype=jnp.dtype(self.precision),
        )
        spreads = [confidence(stage.probabilities, stage.candidates) for stage in stages]
        # A refined stage cannot know that the stage before missed the surface. So the confidence is
        # that of the least certain stage.
        certainty = [
            spread.certainty(len(stage.candidates))
            for spread, stage in zip(spreads, stages, strict=True)
        ]
        return {
            "disparity": stages[-1].disparity,
            "confidence": jnp.stack(certainty).min(0),
            "standard_deviation": spreads[-1].standard_deviation,
            "coarse": stages[0].disparity if len(stages) > 1 else None,
            "stages": tuple(stage.disparity for stage in stages),
            "occlusion": stages[-1].occlusion,
        }
