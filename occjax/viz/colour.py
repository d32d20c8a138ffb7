"""Colour maps, and the ranges of values that they cover, as Matplotlib norms.

All colour maps are perceptually uniform: equal steps of a value look equally large.
"""

from __future__ import annotations

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import Colormap, LinearSegmentedColormap, Normalize

from occjax.errors import InputError

NO_VALUE_COLOUR = "#8a8a8a"
"""Colour of pixels without a finite value."""

MISSING_COLOUR = "#000000"
"""Colour of pixels with ground truth but without an estimate, in an error map."""


def check_map(name: str, values: np.ndarray, size: tuple[int, ...] | None = None) -> None:
    """Check that an array is one map, of the size of the disparity that is drawn with it.

    Args:
        name: Name of the map, for the message.
        values: The map.
        size: ``(H, W)`` of the disparity; None if the map may have any size.

    Raises:
        InputError: If the array is not ``[H, W]``, or has another size.

    Example:
        >>> check_map("confidence", np.ones((8, 10)), (8, 10))
    """
    shape = np.shape(values)
    if len(shape) != 2 or size not in (None, shape):
        needed = "[H, W]" if size is None else f"{list(size)} like the disparity"
        raise InputError(f"{name} must be {needed}, not {list(shape)}")


def disparity_colours() -> Colormap:
    """Return the colours of disparity: dark blue is far, yellow is near."""
    return colormaps["viridis"].with_extremes(bad=NO_VALUE_COLOUR)


def confidence_colours() -> Colormap:
    """Return the colours of confidence: dark is uncertain, light is certain."""
    return colormaps["magma"].with_extremes(bad=NO_VALUE_COLOUR)


def occlusion_colours() -> Colormap:
    """Return the colours of occlusion maps: black is visible, light is occluded."""
    return colormaps["gray"].with_extremes(bad=NO_VALUE_COLOUR)


def error_colours(threshold: float, limit: float) -> Colormap:
    """Return the colours of errors: blue is too far, red is too near.

    Colours are pale up to the threshold and strong above it. The step between them makes bad pixels
    stand out.

    Args:
        threshold: Error above which a pixel is bad, in pixels per view step.
        limit: Error at which the colours end; they cover ``-limit`` to ``limit``.
    """
    diverging = colormaps["RdBu_r"]  # from blue at 0 through white at 0.5 to red at 1
    error = np.linspace(-limit, limit, 1001)
    magnitude = np.abs(error)
    pale = 0.16 * magnitude / threshold
    strong = 0.30 + 0.17 * (magnitude - threshold) / max(limit - threshold, 1e-12)
    from_white = np.where(magnitude <= threshold, pale, strong)
    colours = diverging(0.5 + np.sign(error) * from_white)
    return LinearSegmentedColormap.from_list("error", colours, N=1001).with_extremes(
        bad=NO_VALUE_COLOUR
    )


def common_norm(*maps: np.ndarray) -> Normalize:
    """Return the common range of the finite values of several maps.

    An empty range is widened, so that a constant map has the middle colour.

    Args:
        maps: Arrays of any shape.

    Example:
        >>> shared = common_norm(np.array([[0.0, np.nan]]), np.array([[2.0]]))
        >>> shared.vmin, shared.vmax
        (0.0, 2.0)
    """
    values = np.concatenate([_finite(one) for one in maps])
    lowest, highest = (values.min(), values.max()) if values.size else (0.0, 0.0)
    return _norm(lowest, highest)


def disparity_norm(
    disparity: np.ndarray,
    confidence: np.ndarray | None = None,
    ground_truth: np.ndarray | None = None,
) -> Normalize:
    """Return the range of a scene's disparities, excluding outliers of uncertain pixels.

    The range covers the ground truth, and the 0.1st to the 99.9th percentile of the more confident
    half of the pixels. An end is extended to the extreme value of the estimate if that is less
    than a tenth of the range away.

    Args:
        disparity: ``[H, W]`` estimate, pixels per view step.
        confidence: ``[H, W]`` in [0, 1]. Without it the range is that of the ground truth, or
            without ground truth that of all finite values.
        ground_truth: ``[H, W]`` pixels per view step.

    Raises:
        InputError: If the disparity is not one map, or the confidence has another size.

    Example:
        >>> wild = np.array([[0.0, 1.0, 50.0]])
        >>> round(disparity_norm(wild, np.array([[0.9, 0.9, 0.1]])).vmax, 2)
        1.0
    """
    check_map("disparity", disparity)
    if confidence is not None:
        check_map("confidence", confidence, disparity.shape)
    truth = np.empty(0) if ground_truth is None else _finite(ground_truth)
    finite = np.isfinite(disparity)
    if confidence is not None:
        finite &= np.isfinite(confidence)
    if confidence is None or not finite.any():
        return common_norm(truth if truth.size else disparity)
    confident = disparity[finite & (confidence >= np.median(confidence[finite]))]
    ends = np.percentile(confident.astype(np.float64), (0.1, 99.9))
    low, high = truth.min(initial=ends[0]), truth.max(initial=ends[1])
    slack = 0.1 * (high - low)
    lowest, highest = _finite(disparity).min(), _finite(disparity).max()
    return _norm(
        min(low, lowest) if low - lowest < slack else low,
        max(high, highest) if highest - high < slack else high,
    )


def colourbar_extend(norm: Normalize, *maps: np.ndarray) -> str:
    """Return ``extend`` for a matplotlib colour bar: the ends of the range that values exceed.

    Args:
        norm: The range.
        maps: Arrays of any shape.

    Returns:
        ``"neither"``, ``"min"``, ``"max"`` or ``"both"``.

    Example:
        >>> colourbar_extend(Normalize(0.0, 1.0), np.array([0.5, 2.0]), np.array([np.nan]))
        'max'
    """
    values = np.concatenate([_finite(one) for one in maps])
    below, above = bool((values < norm.vmin).any()), bool((values > norm.vmax).any())
    if below and above:
        return "both"
    return "min" if below else "max" if above else "neither"


def _finite(values: np.ndarray) -> np.ndarray:
    """Return the ``[N]`` finite values in float64."""
    return np.asarray(values, np.float64)[np.isfinite(values)]


def _norm(lowest: float, highest: float) -> Normalize:
    """Return a range, which is widened if it is empty."""
    if highest - lowest < 1e-6 * max(1.0, abs(highest)):
        lowest, highest = lowest - 0.5, highest + 0.5
    return Normalize(float(lowest), float(highest))
