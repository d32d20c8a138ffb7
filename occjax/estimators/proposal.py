"""ProposalNet and the training-free estimator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from occjax.errors import InputError
from occjax.estimators.protocol import DisparityRange, ModelEstimator, ModelInputs
from occjax.estimators.ranges import choose_range
from occjax.estimators.strips import Strips, map_strips, plan_strips
from occjax.layout import check, view_brightness
from occjax.lightfield import (
    LightField,
    centre_index,
    to_unit_float,
    view_offsets,
    whole_grid,
)
from occjax.models.proposal.config import ProposalNetConfig
from occjax.models.proposal.exposure import white_level
from occjax.view_selection import is_grid, select_view_indices


@dataclass(frozen=True)
class ProposalEstimator(ModelEstimator):
    """Estimator of a :class:`occjax.models.ProposalNet`.

    With ``selector=None`` in the configuration it needs no variables.
    """

    config: ProposalNetConfig

    def prepare(
        self, light_field: LightField, disparity_range: DisparityRange | None
    ) -> ModelInputs:
        """Select views and convert them to grey, keep the centre view's colour, choose candidates.

        Raises:
            InputError: If there is only one view, or the range is too wide.
        """
        (low, high), notes = choose_range(light_field, disparity_range)
        brightness = view_brightness(light_field)
        grid_offsets = view_offsets(*light_field.grid)
        offsets = np.asarray(light_field.offsets, np.float32)
        usable, full_grid = brightness.usable, whole_grid(light_field.grid, light_field.view)
        if light_field.view is not None:
            # Around a view at the border all others are on one side, and from the furthest of them
            # most of what is behind depth edges is hidden.
            reach = max(self.config.reach, *centre_index(full_grid))
            usable = usable & (np.abs(grid_offsets).max(axis=-1) <= reach)
        indices = np.flatnonzero(usable)
        # The arrangement refers to the places of a grid; irregular views are all used.
        arrangement = self.config.views if is_grid(offsets) else "all"
        selected = indices[select_view_indices(grid_offsets.reshape(-1, 2)[indices], arrangement)]
        if light_field.view is not None:
            full_offsets = view_offsets(*full_grid).reshape(-1, 2)
            selected = _padded(selected, len(select_view_indices(full_offsets, arrangement)))
        offsets = offsets.reshape(1, -1, 2)[:, selected]
        largest_offset = float(np.abs(offsets).max())
        if largest_offset == 0:
            raise InputError(
                f"{light_field.name}: one usable view has no disparity; give a grid of at least "
                "1x2 views"
            )
        # The interval of the configuration is that at its reach.
        interval = self.config.search.interval * self.config.reach / largest_offset
        max_range = self.config.max_candidates * interval
        if high - low > max_range:
            raise InputError(
                f"{light_field.name}: the disparity range [{low:g}, {high:g}] is too wide; the "
                f"model searches at most {max_range:g} pixels per view step; pass a narrower "
                "disparity_range (--disparity-range) or smaller images"
            )
        # One more candidate on each side, so that the limits have neighbours; a multiple of four,
        # so that scenes of similar range share a compiled program.
        count = 4 * -(-(int(np.ceil((high - low) / interval)) + 3) // 4)
        candidates = (low + high) / 2 + interval * (np.arange(count) - (count - 1) / 2)
        # The result is limited to a requested range, or to the default range if nothing can be
        # measured. A range that was measured, or read from the scene's files, may be slightly too
        # narrow; then the outermost candidates are the limits.
        limits = (low, high)
        if disparity_range is None and (
            light_field.disparity_range is not None or check(light_field).measured_fraction
        ):
            limits = (float(candidates[0]), float(candidates[-1]))
        # Only the selected views are converted: grey of all views takes time.
        selected_views = [divmod(int(index), light_field.grid[1]) for index in selected]
        grey = np.stack([brightness.grey(light_field, *view) for view in selected_views])
        colour = None
        if self.config.support is not None and light_field.centre.shape[-1] == 3:
            colour = np.moveaxis(to_unit_float(light_field.centre), -1, 0)
        motion = max(-low, high) * float(np.abs(offsets[..., 0]).max())
        strips = plan_strips(
            light_field.image_size, len(selected), len(candidates), motion, self.config
        )
        arguments = (
            candidates.astype(np.float32),
            offsets,
            np.array(limits, np.float32),
            colour,
            strips,
        )
        notes = (*brightness.notes, *notes)
        if strips is not None:
            notes += (f"computed in {len(strips.rows)} strips of rows, to bound the memory",)
        return ModelInputs(self.variables, grey[None], arguments, limits, notes, selected)

    def run(
        self,
        variables: dict,
        views: jax.Array,
        candidates: jax.Array,
        offsets: jax.Array,
        limits: jax.Array,
        colour: jax.Array | None = None,
        strips: Strips | None = None,
    ) -> dict[str, Any]:
        """Apply the network and clip the disparity to the searched range."""
        # Imported when the network is traced: a kept program needs neither Flax nor the network.
        from occjax.models.proposal import ProposalNet, ProposalOutput

        network = ProposalNet(self.config, dtype=jnp.dtype(self.precision))
        white = None if strips is None else white_level(views)

        def maps(images: tuple[jax.Array, jax.Array | None]) -> dict[str, Any]:
            views, colour = images
            output = network.apply(
                variables,
                views,
                candidates=candidates,
                offsets=offsets,
                white=white,
                colour=colour,
            )
            assert isinstance(output, ProposalOutput)
            disparity = jnp.clip(output.disparity, limits[0], limits[1])
            return {
                "disparity": disparity,
                "confidence": output.confidence,
                "standard_deviation": output.standard_deviation,
                "coarse": output.coarse,
                "stages": (output.coarse, disparity),
            }

        images = views, colour
        return maps(images) if strips is None else map_strips(maps, images, strips)


def _padded(selected: np.ndarray, count: int) -> np.ndarray:
    """Repeat the centre view until there are ``count`` views.

    Around a view at the border of the grid, fewer views are selected than around the centre. Copies
    of the centre view have no effect. With equal numbers, all views of a light field share one
    compiled program.

    Args:
        selected: ``[k]`` indices of the selected views; the centre view is at ``k // 2``.
        count: Number of views.

    Returns:
        ``[max(k, count)]`` indices; the centre view is in the middle again.
    """
    missing = max(count - len(selected), 0)
    centre = centre_index((1, len(selected)))[1]
    before = centre_index((1, len(selected) + missing))[1] - centre
    return np.pad(selected, (before, missing - before), constant_values=selected[centre])
