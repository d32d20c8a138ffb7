"""ProposalNet and the training-free estimator."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from occjax.errors import InputError
from occjax.estimators.protocol import DisparityRange, Estimate, ModelInputs
from occjax.estimators.ranges import choose_range, estimate_from_maps
from occjax.lightfield import LightField, to_grey, view_offsets
from occjax.models.proposal import ProposalConfig, ProposalNet, ProposalOutput
from occjax.view_selection import is_grid, select_view_indices


@dataclass(frozen=True)
class ProposalEstimator:
    """Estimator of a :class:`occjax.models.ProposalNet`.

    Attributes:
        name: Name of the model.
        config: Configuration; with ``selector=None`` it needs no variables.
        variables: Variables of the network.
        weights: Name of the weights, or None.
        precision: Type of the selector's convolutions.
    """

    name: str
    config: ProposalConfig
    variables: dict = field(default_factory=dict, compare=False)
    weights: str | None = field(default=None, compare=False)
    precision: str = "float32"

    def prepare(
        self, light_field: LightField, disparity_range: DisparityRange | None
    ) -> ModelInputs:
        """Select views and convert them to grey; choose the candidates.

        Raises:
            InputError: If there is only one view, or the range is too wide.
        """
        (low, high), notes = choose_range(light_field, disparity_range)
        grid_offsets = view_offsets(*light_field.grid)
        positions = light_field.positions
        offsets = grid_offsets if positions is None else np.asarray(positions, np.float32)
        # The arrangement refers to the places of a grid; irregular views are all used.
        selected = select_view_indices(
            grid_offsets.reshape(-1, 2), self.config.views if is_grid(offsets) else "all"
        )
        largest_offset = float(np.abs(offsets).max())
        if largest_offset == 0:
            raise InputError(
                f"{light_field.name}: one view has no disparity; give a grid of at least 1x2 views"
            )
        interval = self.config.search.interval * self.config.reach / largest_offset
        max_range = self.config.max_candidates * interval
        if high - low > max_range:
            raise InputError(
                f"{light_field.name}: the disparity range [{low:g}, {high:g}] is too wide; the "
                f"model searches at most {max_range:g} pixels per view step"
            )
        # One more candidate on each side, so that the limits have neighbours; a multiple of four,
        # so that scenes of similar range share a compiled program.
        count = 4 * -(-(int(np.ceil((high - low) / interval)) + 3) // 4)
        candidates = (low + high) / 2 + interval * (np.arange(count) - (count - 1) / 2)
        # A requested range is binding. A measured one may be slightly too narrow.
        limits = (float(candidates[0]), float(candidates[-1]))
        if disparity_range is not None:
            limits = (low, high)
        # Only the selected views are converted: grey of all views takes time.
        images = light_field.views.reshape(-1, *light_field.views.shape[2:])[selected]
        grey = np.stack([to_grey(image) for image in images])[None]
        others = (
            candidates.astype(np.float32),
            offsets.reshape(1, -1, 2)[:, selected],
            np.array(limits, np.float32),
        )
        return ModelInputs(self.variables, grey, others, limits, notes, selected)

    def run(
        self,
        variables: dict,
        views: jax.Array,
        candidates: jax.Array,
        offsets: jax.Array,
        limits: jax.Array,
    ) -> dict[str, Any]:
        """Apply the network and clip the disparity to the searched range."""
        network = ProposalNet(self.config, dtype=jnp.dtype(self.precision))
        output = network.apply(variables, views, candidates=candidates, offsets=offsets)
        assert isinstance(output, ProposalOutput)
        disparity = jnp.clip(output.disparity, limits[0], limits[1])
        return {
            "disparity": disparity,
            "confidence": output.confidence,
            "standard_deviation": output.standard_deviation,
            "coarse": output.searched,
            "stages": (output.searched, disparity),
        }

    def finish(self, inputs: ModelInputs, outputs: dict[str, Any]) -> Estimate:
        """Add names and notes to the maps."""
        return estimate_from_maps(self.name, self.weights, inputs, outputs)
