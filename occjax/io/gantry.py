"""Camera positions of the Stanford light field archive, which was taken with a gantry.

Files are named ``out_ROW_COLUMN_Y_X_.png``. The gantry moved back and forth, so row and column only
count the exposures; ``Y`` and ``X`` give the camera position. The archive does not document the
directions of these axes. Other readers take ``X`` to the right and ``Y`` downwards, except in the
scenes whose names lack the underscore before the suffix (beans, knights, tarot), where ``Y`` points
upwards. If a scene differs, ``occjax check`` shows it and ``flip`` corrects it.
"""

from __future__ import annotations

import numpy as np

from occjax.io.naming import NamedViews
from occjax.io.positions import arranged, relative_to_centre, spacing


def gantry_grid(folder: str, named: NamedViews) -> tuple[NamedViews, np.ndarray]:
    """Order gantry views top to bottom and left to right, and return their positions.

    Args:
        folder: Name of the folder, for messages.
        named: Views whose names match with ``y``, ``x`` and ``tail``.

    Returns:
        The views in the order of the library, and their positions ``[V, U, 2]`` float32
        ``(row, column)`` relative to the centre view. The unit of both axes is the mean spacing of
        neighbouring cameras, as disparity has one unit for both.

    Raises:
        InputError: If neighbouring cameras have the same position.
    """
    rows, columns = named.grid
    positions = np.empty((rows, columns, 2))
    for index, match in named.matches.items():
        down = 1.0 if match["tail"] else -1.0
        positions[index] = down * float(match["y"]), float(match["x"])
    named, positions = arranged(folder, named, positions)
    present = [step for step in spacing(positions) if step]
    return named, relative_to_centre(positions, float(np.mean(present)) if present else 1.0)
