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
        ``(row, column)`` relative to the centre view. Missing views have the position of a regular
        grid. The unit of both axes is the mean spacing of neighbouring cameras, as disparity has
        one unit for both.

    Raises:
        InputError: If neighbouring cameras have the same position.
    """
    # Names without the last underscore (``tail``) have Y upwards.
    measured = np.array(
        [
            ((1.0 if match["tail"] else -1.0) * float(match["y"]), float(match["x"]))
            for match in named.matches.values()
        ]
    )
    indices = np.array(list(named.matches))
    # Missing views have their places in the regular grid that is closest to the measured positions.
    coefficients = np.linalg.lstsq(np.column_stack([indices, np.ones(len(indices))]), measured)[0]
    positions = np.stack([*np.indices(named.grid), np.ones(named.grid)], axis=-1) @ coefficients
    positions[tuple(indices.T)] = measured
    named, positions = arranged(folder, named, positions)
    steps = [step for step in spacing(positions) if step]
    return named, relative_to_centre(positions, float(np.mean(steps)) if steps else 1.0)
