"""Two disorders of the views that the cross of views around the centre view does not show.

In serpentine order every second row runs backwards; the row and the column of the centre view may
be consistent nevertheless, but not all views near it are. A centre view that is not in its place
makes all others look misplaced, until a neighbour is taken as the centre.
"""

from __future__ import annotations

import dataclasses
from typing import Literal

import numpy as np

from occjax.layout.config import ViewOrderConfig
from occjax.layout.hypotheses import best_hypothesis
from occjax.layout.orientation import Orientation, straightened
from occjax.lightfield import LightField, centre_index, view_offsets

Disorder = Literal["serpentine", "centre", "grid"]
"""Every second row runs backwards, the centre view is not in its place, or many views are not."""


def recentred(light_field: LightField, axis: int) -> tuple[LightField, tuple[slice, ...]] | None:
    """Return the views without an outer row or column, so that another view is the centre.

    Args:
        light_field: Any grid.
        axis: 0 to leave out a row, 1 to leave out a column.

    Returns:
        The other views, without ground truth and report, which belong to the old centre view, and
        the rows and columns of the grid that they fill; None if the new centre view is missing.

    Example:
        >>> import numpy as np
        >>> recentred(LightField(np.zeros((5, 5, 8, 8))), 0)[0].grid
        (4, 5)
    """
    kept = np.s_[1:] if light_field.grid[axis] % 2 else np.s_[:-1]
    rest = (kept, slice(None)) if axis == 0 else (slice(None), kept)
    usable = None if light_field.usable is None else light_field.usable[rest]
    if usable is not None and not usable[centre_index(usable.shape)]:
        return None
    part = light_field.rearranged(lambda grid: grid[rest])
    return dataclasses.replace(part, ground_truth=None), rest


def is_serpentine(light_field: LightField, best: Orientation, config: ViewOrderConfig) -> bool:
    """Return whether the views are clearly more consistent if every second row is reversed.

    Args:
        light_field: At least two rows and columns of views, without camera positions.
        best: The most consistent of the eight view orders.
        config: Settings.
    """
    regular = view_offsets(*light_field.grid)
    usable = light_field.usable
    orders = [regular]
    if best != Orientation():
        # If all rows run backwards, serpentine order is right for half of them: it must also be
        # better than the flipped grid.
        swapped = regular[..., ::-1] if best.swap else regular
        orders.append(np.where([best.flip_rows, best.flip_columns], -swapped, swapped))
    orders.append(straightened(regular))
    found = best_hypothesis(
        light_field.views.reshape(-1, *light_field.views.shape[2:]),
        [order.reshape(-1, 2) for order in orders],
        config,
        usable=None if usable is None else usable.reshape(-1),
    )
    return found.clear and found.number == len(orders) - 1
