"""Colours for maps: what stands for a value, and what for no value.

All maps use perceptually uniform colours, so that equal steps of a value look equally large.
"""

from __future__ import annotations

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import Colormap, LinearSegmentedColormap, Normalize

NO_VALUE = "#8a8a8a"
"""Colour of pixels without a finite value."""

MISSING = "#000000"
"""Colour, in an error map, of pixels that have ground truth but no estimate."""


def disparity_colours() -> Colormap:
    """Dark blue is far, yellow is near."""
    return colormaps["viridis"].with_extremes(bad=NO_VALUE)


def confidence_colours() -> Colormap:
    """Dark is uncertain, light is certain."""
    return colormaps["magma"].with_extremes(bad=NO_VALUE)


def error_colours(threshold: float, limit: float) -> Colormap:
    """Blue is too far, red is too near; tints within the threshold, full colours beyond.

    The step at the threshold makes a bad pixel stand out from one that is just good enough.

    Args:
        threshold: Error above which a pixel is bad.
        limit: Error at which the colours end; the map is for values from ``-limit`` to ``limit``.
    """
    diverging = colormaps["RdBu_r"]
    error = np.linspace(-limit, limit, 1001)
    size = np.abs(error)
    tint = 0.16 * size / threshold
    full = 0.30 + 0.17 * (size - threshold) / max(limit - threshold, 1e-12)
    away_from_white = np.where(size <= threshold, tint, full)
    colours = diverging(0.5 + np.sign(error) * away_from_white)
    return LinearSegmentedColormap.from_list("error", colours, N=1001).with_extremes(bad=NO_VALUE)


def limits(*maps: np.ndarray) -> Normalize:
    """The common range of the finite values of all maps.

    A range without extent is widened, so that a constant map has the middle colour.

    Example:
        >>> shared = limits(np.array([[0.0, np.nan]]), np.array([[2.0]]))
        >>> shared.vmin, shared.vmax
        (0.0, 2.0)
    """
    values = np.concatenate([np.asarray(one, np.float64)[np.isfinite(one)] for one in maps])
    lowest, highest = (values.min(), values.max()) if values.size else (0.0, 0.0)
    if highest - lowest < 1e-6 * max(1.0, abs(highest)):
        lowest, highest = lowest - 0.5, highest + 0.5
    return Normalize(float(lowest), float(highest))
