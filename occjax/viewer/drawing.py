"""Pictures of one pixel for the panels: enlarged, with lines and frames drawn in."""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageDraw

from occjax.lightfield import centre_index
from occjax.viewer.pixel import EpipolarImage
from occjax.viz.pictures import view_picture

MARK = (255, 64, 160)
"""Colour of what belongs to the picked pixel: cross, slope line."""

OCCLUDED = (235, 60, 40)
"""Colour of the crosses through occluded views."""

CENTRE = (242, 182, 50)
"""Colour of the frame around the centre view."""


def css(colour: tuple[int, int, int]) -> str:
    """Return a colour as a web page writes it.

    Example:
        >>> css((255, 64, 160))
        '#ff40a0'
    """
    return "#" + bytes(colour).hex()


def enlarged(image: np.ndarray, *, width: int = 400) -> np.ndarray:
    """Return a small image enlarged by a whole factor to at least a given width.

    Args:
        image: ``[H, W, 3]`` uint8.
        width: Width of a panel, in pixels.

    Example:
        >>> enlarged(np.zeros((2, 3, 3), np.uint8), width=8).shape
        (6, 9, 3)
    """
    zoom = -(-width // image.shape[1])
    return np.repeat(np.repeat(image, zoom, axis=0), zoom, axis=1)


def with_cross(image: np.ndarray, y: float, x: float) -> np.ndarray:
    """Return an enlarged image with a cross around a pixel.

    Args:
        image: ``[H, W, 3]`` uint8.
        y: Row in the image, in pixels; the cross may lie outside the image.
        x: Column in the image, in pixels.

    Returns:
        ``[H * zoom, W * zoom, 3]`` uint8, see :func:`enlarged`.
    """
    large = enlarged(image)
    zoom = large.shape[1] // image.shape[1]
    y, x = (y + 0.5) * zoom, (x + 0.5) * zoom
    drawn = Image.fromarray(large)
    draw = ImageDraw.Draw(drawn)
    unit = max(1.0, large.shape[1] / 400)
    for colour, extra in (((0, 0, 0), 1.0), (MARK, 0.0)):
        for dy, dx in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            begin, end = (4 - extra) * unit, (14 + extra) * unit
            ends = (x + dx * begin, y + dy * begin, x + dx * end, y + dy * end)
            draw.line(ends, fill=colour, width=round((3 + 2 * extra) * unit))
    return np.asarray(drawn)


def brightened(pixels: np.ndarray, *, target: float = 0.7, most: float = 8.0) -> np.ndarray:
    """Return dark pixels brighter, all by the same factor.

    Args:
        pixels: ``[..., C]`` in [0, 1]; NaN outside the image.
        target: Value that the 99th percentile gets, unless it is larger already.
        most: Largest factor.

    Example:
        >>> brightened(np.array([0.05, 0.35, 0.35])).tolist()
        [0.1, 0.7, 0.7]
        >>> brightened(np.array([0.0, 0.035, 0.035])).round(3).tolist()
        [0.0, 0.28, 0.28]
    """
    bright = float(np.nanpercentile(pixels, 99.0))
    return pixels * np.float32(np.clip(target / max(bright, 1e-6), 1.0, most))


def epipolar_picture(
    epi: EpipolarImage, picked: int, disparity: float, *, width: int = 640
) -> np.ndarray:
    """Return an enlarged epipolar plane image with the slope of the disparity drawn in.

    Args:
        epi: The epipolar plane image.
        picked: Row or column of the picked pixel in the centre view.
        disparity: Its disparity, pixels per view step; NaN for no line.
        width: Approximate width of the picture, in pixels.

    Returns:
        ``[height, width, 3]`` uint8; one line of pixels per view, in the order of the views. Dark
        lines are brightened (:func:`brightened`).
    """
    count, length = epi.pixels.shape[:2]
    zoom = max(2, width // length)
    row = max(8, min(36, width // 3 // count))
    pixels = _with_grey(brightened(epi.pixels))
    picture = np.repeat(np.repeat(pixels, row, axis=0), zoom, axis=1)
    if not np.isfinite(disparity):
        return picture
    # The line continues to the upper and the lower edge of the picture.
    at = np.arange(count)
    steps = np.diff(epi.offsets) if count > 1 else np.zeros(1)
    ends = epi.offsets[[0, -1]] + 0.5 * steps[[0, -1]] * [-1.0, 1.0]
    offsets = np.concatenate([ends[:1], epi.offsets, ends[1:]])
    y = np.concatenate([[0.0], (at + 0.5) * row, [count * row]])
    x = (picked - disparity * offsets - epi.first + 0.5) * zoom
    # Drawn three times as large and reduced, so that the line is smooth.
    large = Image.fromarray(picture).resize(
        (3 * length * zoom, 3 * count * row), Image.Resampling.NEAREST
    )
    line = [(3.0 * float(px), 3.0 * float(py)) for px, py in zip(x, y, strict=True)]
    draw = ImageDraw.Draw(large)
    for colour, thickness in (((0, 0, 0), 22), (MARK, 14)):
        draw.line(line, fill=colour, width=thickness, joint="curve")
    return np.asarray(large.reduce(3))


def patch_picture(patch: np.ndarray, occluded: np.ndarray, *, width: int = 234) -> np.ndarray:
    """Return an enlarged angular patch: occluded views are crossed out, the centre view framed.

    Rows and columns at the edge of the grid in which all views are missing are left out.

    Args:
        patch: ``[V, U, C]`` float32 colour of the point in each view; NaN where it is missing.
        occluded: ``[V, U]`` booleans.
        width: Approximate length of the longer side, in pixels.

    Returns:
        ``[height, width, 3]`` uint8. A dark patch is brightened (:func:`brightened`).
    """
    known = np.isfinite(patch).all(axis=-1)
    centre = np.array(centre_index(known.shape))
    rows, columns = (np.flatnonzero(known.any(axis)) for axis in (1, 0))
    inner = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    v, u = centre - (rows[0], columns[0])
    patch, occluded = patch[inner], (occluded & known)[inner]
    tile = max(8, width // max(occluded.shape))
    colours = _with_grey(brightened(patch))
    drawn = Image.fromarray(np.repeat(np.repeat(colours, tile, axis=0), tile, axis=1))
    draw = ImageDraw.Draw(drawn)
    gap, line = tile // 6, max(2, tile // 10)
    for y, x in np.argwhere(occluded):
        box = [x * tile + gap, y * tile + gap, (x + 1) * tile - gap - 1, (y + 1) * tile - gap - 1]
        for ends in (box, [box[0], box[3], box[2], box[1]]):
            draw.line(ends, fill=(255, 255, 255), width=line + 2)
            draw.line(ends, fill=OCCLUDED, width=line)
    frame = (u * tile, v * tile, (u + 1) * tile - 1, (v + 1) * tile - 1)
    draw.rectangle(frame, outline=CENTRE, width=max(2, tile // 10))
    return np.asarray(drawn)


def _with_grey(pixels: np.ndarray) -> np.ndarray:
    """Return the picture of pixels; NaN, outside the image or in missing views, is grey."""
    return view_picture(np.where(np.isnan(pixels), 0.35, pixels))
