"""Pictures of maps: one pixel for each value, without axes.

No Matplotlib figure is drawn, so a picture takes a few milliseconds. :mod:`occjax.viz.figures`
draws the same maps with colour bars.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.colors import Colormap, Normalize, to_rgb
from PIL import Image

from occjax.errors import InputError
from occjax.evaluation.metrics import BAD_PIXEL_THRESHOLD
from occjax.io.atomic import atomic_path
from occjax.lightfield import to_unit_float
from occjax.viz.colour import (
    MISSING_COLOUR,
    check_map,
    confidence_colours,
    disparity_colours,
    disparity_norm,
    error_colours,
)


def view_picture(view: np.ndarray) -> np.ndarray:
    """Return a view in 8 bits and three channels.

    Args:
        view: ``[H, W, C]`` as stored in a light field.

    Returns:
        ``[H, W, 3]`` uint8 RGB.

    Raises:
        InputError: If the view is not ``[H, W, C]`` with C of 1 or 3.

    Example:
        >>> view_picture(np.array([[[0.0], [1.0]]])).tolist()
        [[[0, 0, 0], [255, 255, 255]]]
    """
    if np.ndim(view) != 3 or view.shape[2] not in (1, 3):
        raise InputError(f"view must be [H, W, C] with C of 1 or 3, not {list(np.shape(view))}")
    levels = np.floor(np.clip(to_unit_float(view), 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
    return np.ascontiguousarray(np.broadcast_to(levels, (*view.shape[:2], 3)))


def disparity_picture(
    disparity: np.ndarray,
    *,
    confidence: np.ndarray | None = None,
    ground_truth: np.ndarray | None = None,
    limits: tuple[float, float] | None = None,
) -> np.ndarray:
    """Return a disparity map in the colours of :func:`occjax.viz.disparity_figure`.

    Args:
        disparity: ``[H, W]`` pixels per view step; pixels without a value are grey.
        confidence: ``[H, W]`` in [0, 1], which excludes outliers from the range of the colours.
        ground_truth: ``[H, W]`` pixels per view step, which the range of the colours covers.
        limits: Disparities of the first and the last colour, for pictures that are compared; by
            default those of :func:`occjax.viz.colour.disparity_norm`.

    Returns:
        ``[H, W, 3]`` uint8 RGB.

    Raises:
        InputError: If the disparity is not one map, or the confidence has another size.

    Example:
        >>> disparity_picture(np.array([[0.0, 1.0, np.nan]])).tolist()
        [[[68, 1, 84], [253, 231, 36], [138, 138, 138]]]
    """
    check_map("disparity", disparity)
    norm = (
        disparity_norm(disparity, confidence, ground_truth)
        if limits is None
        else Normalize(*limits, clip=True)
    )
    return coloured(disparity, norm, disparity_colours())


def confidence_picture(confidence: np.ndarray) -> np.ndarray:
    """Return a confidence map in colours: 0 is black, 1 is light yellow.

    Args:
        confidence: ``[H, W]`` in [0, 1]; pixels without a value are grey.

    Returns:
        ``[H, W, 3]`` uint8 RGB.

    Raises:
        InputError: If the confidence is not one map.

    Example:
        >>> confidence_picture(np.array([[0.0, 1.0]])).tolist()
        [[[0, 0, 3], [251, 252, 191]]]
    """
    check_map("confidence", confidence)
    return coloured(confidence, Normalize(0.0, 1.0), confidence_colours())


def error_picture(
    disparity: np.ndarray, ground_truth: np.ndarray, *, bad: float = BAD_PIXEL_THRESHOLD
) -> np.ndarray:
    """Return the signed error in the colours of :func:`occjax.viz.error_figure`.

    Args:
        disparity: ``[H, W]`` estimate, pixels per view step.
        ground_truth: ``[H, W]`` pixels per view step.
        bad: Error above which a pixel has full colours, in pixels per view step.

    Returns:
        ``[H, W, 3]`` uint8 RGB; pixels without ground truth are grey, without an estimate black.

    Raises:
        InputError: If the arrays are not two maps of one size.

    Example:
        >>> error_picture(np.array([[0.0, np.nan]]), np.zeros((1, 2))).tolist()
        [[[247, 246, 246], [0, 0, 0]]]
    """
    check_map("disparity", disparity)
    check_map("ground truth", ground_truth, disparity.shape)
    norm, colours, _ = error_scale(bad)
    known = np.isfinite(disparity) & np.isfinite(ground_truth)
    error = np.full(disparity.shape, np.nan)
    error[known] = disparity[known] - ground_truth[known]
    picture = coloured(error, norm, colours)
    missing = np.isfinite(ground_truth) & ~np.isfinite(disparity)
    picture[missing] = np.multiply(255, to_rgb(MISSING_COLOUR)).astype(np.uint8)
    return picture


def error_scale(
    bad: float = BAD_PIXEL_THRESHOLD,
) -> tuple[Normalize, Colormap, list[float]]:
    """Return range, colours and ticks of an error map, which covers three times ``bad``.

    Args:
        bad: Error above which a pixel is bad, in pixels per view step.
    """
    limit = 3.0 * bad
    ticks = [-limit, -bad, 0.0, bad, limit]
    return Normalize(-limit, limit), error_colours(bad, limit), ticks


def save_picture(picture: np.ndarray, path: str | Path) -> None:
    """Write a picture as PNG, atomically.

    Args:
        picture: ``[H, W, 3]`` uint8 RGB.
        path: File to write; an existing file is replaced.

    Raises:
        InputError: If the picture is not uint8 RGB, or the file cannot be written.

    Example:
        >>> import tempfile
        >>> path = Path(tempfile.mkdtemp()) / "disparity.png"
        >>> save_picture(disparity_picture(np.eye(8)), path)
        >>> path.exists()
        True
    """
    if picture.dtype != np.uint8 or picture.ndim != 3 or picture.shape[-1] != 3:
        raise InputError(
            f"picture must be [H, W, 3] uint8, not {list(picture.shape)} {picture.dtype}; make it "
            "with disparity_picture, view_picture or np.uint8(255 * picture)"
        )
    with atomic_path(path) as temporary:
        # The lowest compression takes a third of the time for files that are little larger.
        Image.fromarray(picture).save(temporary, format="PNG", compress_level=1)


def coloured(values: np.ndarray, norm: Normalize, colours: Colormap) -> np.ndarray:
    """Return a map in colours.

    Args:
        values: ``[H, W]`` map; values that are not finite get the colour for bad values.
        norm: Range of the colours.
        colours: The colours.

    Returns:
        ``[H, W, 3]`` uint8 RGB.
    """
    return colours(norm(np.ma.masked_invalid(values)), bytes=True)[..., :3]
