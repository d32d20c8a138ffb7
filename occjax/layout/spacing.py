"""Spacing of the view columns, relative to that of the view rows.

The views on the grid row of the centre view show one disparity of each pixel, those on its grid
column another one. If columns are spaced differently from rows, the two differ by one factor.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Array, Float

from occjax.layout.consistency import CostVolumes
from occjax.layout.filters import box_mean
from occjax.layout.orientation import Orientation
from occjax.programs import kept


def column_spacing(volumes: CostVolumes, orientation: Orientation) -> float | None:
    """Measure the spacing of the view columns in steps of the view rows.

    The ratio is the slope of the line through the origin that halves the pixels
    ``(disparity from the column, disparity from the row)``, weighted by their distance from the
    origin: small disparities say little about the ratio.

    Args:
        volumes: Cost volumes of all view orders, computed for equal spacing.
        orientation: The view order that is assumed.

    Returns:
        The ratio, positive; None if it cannot be told from 1: few pixels have two clear
        disparities, the pixels disagree, or the ratio is within their spread.
    """
    config = volumes.config.registration
    on_row, on_column = (volumes.along(on_row, orientation) for on_row in (True, False))
    if on_row is None or on_column is None:
        return None
    across, clear_across = _disparity(on_row, volumes)
    down, clear_down = _disparity(on_column, volumes)
    counted = clear_across & clear_down
    if counted.mean() < config.min_spacing_fraction:
        return None
    across, down = across[counted], down[counted]
    distance = np.hypot(across, down)
    angle = np.arctan2(np.where(down < 0, -across, across), np.abs(down))
    order = np.argsort(angle)
    total = np.cumsum(distance[order])
    if total[-1] == 0.0:
        return None
    quartiles = angle[order][np.searchsorted(total, total[-1] * np.array([0.25, 0.5, 0.75]))]
    if not 0.0 < quartiles[0] <= quartiles[2] < np.pi / 2:
        return None
    low, ratio, high = np.log(np.tan(quartiles))
    clear = abs(ratio) > max(config.min_spacing_change, high - low)
    return float(np.exp(ratio)) if clear and high - low < config.max_spacing_spread else None


def _disparity(volume: np.ndarray, volumes: CostVolumes) -> tuple[np.ndarray, np.ndarray]:
    """Return the ``[h, w]`` sub-pixel disparity of lowest cost, and whether it is clear."""
    config, candidates = volumes.config.registration, volumes.candidates
    costs = np.stack([box_mean(cost, config.spacing_radius_px) for cost in volume])
    best = costs.argmin(0)
    inside = (best > 0) & (best < len(candidates) - 1)
    clear = inside & (costs.min(0) < config.clear_minimum * costs.mean(0))
    return np.asarray(_winner(costs, candidates.astype(np.float32))), clear


@kept
def _winner(costs: Float[Array, "d h w"], candidates: Float[Array, " d"]) -> Float[Array, "h w"]:
    """Return the disparity of lowest cost."""
    from occjax.ops import winner_takes_all  # a cached program does not need it

    return winner_takes_all(costs, candidates)
