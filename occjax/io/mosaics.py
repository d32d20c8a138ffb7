"""All views in one image: side by side (tiled), or one pixel of each view side by side (MacPI).

Tiled: the views are laid out like the grid. ``tiled[v * H + y, u * W + x] = views[v, u, y, x]``.
MacPI (macro-pixel, lenslet): each pixel is a little image of all views, as behind a microlens.
``macpi[y * V + v, x * U + u] = views[v, u, y, x]``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from occjax.errors import InputError
from occjax.io.images import read_image
from occjax.lightfield import SMALLEST

Mosaic = Literal["tiled", "macpi"]

SEAM = 1.3
"""How much larger than elsewhere brightness steps are at a seam, at least."""

DARK, FEWEST_LENSES = 0.6, 400
"""Brightness of a dark view relative to the brightest, and how many pixels a view needs to tell."""


def read_mosaic(path: Path, grid: tuple[int, int] | None, kind: Mosaic | None) -> np.ndarray:
    """Read one image of all views.

    Args:
        path: Image file.
        grid: ``(V, U)``.
        kind: How the views are arranged; None to find out.

    Returns:
        ``[V, U, H, W, C]`` views.

    Raises:
        InputError: If the grid is missing or does not divide the image, or the arrangement cannot
            be told.
    """
    if grid is None:
        raise InputError(f"{path}: one image of all views needs its grid; pass grid (--grid V U)")
    image = read_image(path)
    rows, columns = grid
    height, width = image.shape[:2]
    if height % rows or width % columns:
        raise InputError(
            f"{path}: {height}x{width} pixels are not a multiple of the {rows}x{columns} grid; "
            "pass the right grid (--grid V U) or crop the image"
        )
    if height // rows < SMALLEST or width // columns < SMALLEST:
        raise InputError(
            f"{path}: {height}x{width} pixels leave {height // rows}x{width // columns} for each "
            f"of {rows}x{columns} views; pass the right grid (--grid V U)"
        )
    kind = kind or detect_mosaic(image, grid)
    if kind is None:
        raise InputError(
            f"{path}: cannot tell tiled views from a MacPI image; "
            "pass layout (--layout tiled, or macpi)"
        )
    return split_tiles(image, grid) if kind == "tiled" else split_macpi(image, grid)


def detect_mosaic(image: np.ndarray, grid: tuple[int, int]) -> Mosaic | None:
    """Tell the two arrangements apart by where brightness jumps.

    Tiles have seams where one view meets the next, a MacPI image where one microlens does. The
    outer views of a plenoptic camera are often black, and then so are the seams of its MacPI, but
    also everything else at their places under the microlenses.

    Args:
        image: ``[V * H, U * W, C]``.
        grid: ``(V, U)``.

    Returns:
        The arrangement; None if there is no clear difference, as without texture.
    """
    if _dark_phases(image, grid):
        return "macpi"
    tiles, lenses, others = [], [], []
    for axis, count in enumerate(grid):
        size = image.shape[axis] // count
        if count == 1 or size == 1:
            continue
        steps = np.abs(np.diff(image.astype(np.float32), axis=axis))
        profile = steps.mean(axis=tuple(other for other in range(3) if other != axis))
        position = np.arange(1, count * size)
        at_tile, at_lens = position % size == 0, position % count == 0
        tiles.append(profile[at_tile])
        lenses.append(profile[at_lens & ~at_tile])
        others.append(profile[~at_lens & ~at_tile])
    if not tiles:
        return "tiled"  # one view, or views of one pixel: both arrangements are the same
    elsewhere = _mean(others)
    if _mean(lenses) > SEAM * elsewhere:
        return "macpi"
    return "tiled" if _mean(tiles) > SEAM * elsewhere else None


def _dark_phases(image: np.ndarray, grid: tuple[int, int]) -> bool:
    """Whether pixels are dark by their place under a microlens, as outer views of a MacPI may be.

    In tiled views the pixels of each such place are spread over all views and equally bright.
    """
    height, width = image.shape[0] // grid[0], image.shape[1] // grid[1]
    if height * width < FEWEST_LENSES:
        return False
    brightness = split_macpi(image, grid).mean((2, 3, 4), dtype=np.float64)
    return bool(brightness.min() < DARK * brightness.max())


def _mean(profiles: list[np.ndarray]) -> float:
    """Mean of all values; 0 if there are none."""
    values = np.concatenate(profiles)
    return float(values.mean()) if values.size else 0.0


def split_tiles(image: np.ndarray, grid: tuple[int, int]) -> np.ndarray:
    """``[V * H, U * W, C]`` tiled image to ``[V, U, H, W, C]`` views.

    Example:
        >>> split_tiles(np.arange(4).reshape(2, 2, 1), (2, 1))[:, :, 0, :, 0].tolist()
        [[[0, 1]], [[2, 3]]]
    """
    (rows, columns), (height, width, channels) = grid, image.shape
    split = image.reshape(rows, height // rows, columns, width // columns, channels)
    return np.ascontiguousarray(split.transpose(0, 2, 1, 3, 4))


def join_tiles(views: np.ndarray) -> np.ndarray:
    """``[V, U, H, W, C]`` views to ``[V * H, U * W, C]`` tiled image.

    Example:
        >>> join_tiles(np.arange(4).reshape(2, 1, 1, 2, 1))[..., 0].tolist()
        [[0, 1], [2, 3]]
    """
    v, u, h, w, c = views.shape
    return np.ascontiguousarray(views.transpose(0, 2, 1, 3, 4).reshape(v * h, u * w, c))


def split_macpi(image: np.ndarray, grid: tuple[int, int]) -> np.ndarray:
    """``[H * V, W * U, C]`` MacPI image to ``[V, U, H, W, C]`` views.

    Example:
        >>> split_macpi(np.arange(4).reshape(1, 4, 1), (1, 2))[0, :, 0, :, 0].tolist()
        [[0, 2], [1, 3]]
    """
    (rows, columns), (height, width, channels) = grid, image.shape
    split = image.reshape(height // rows, rows, width // columns, columns, channels)
    return np.ascontiguousarray(split.transpose(1, 3, 0, 2, 4))


def join_macpi(views: np.ndarray) -> np.ndarray:
    """``[V, U, H, W, C]`` views to ``[H * V, W * U, C]`` MacPI image.

    Example:
        >>> join_macpi(np.array([[0, 2], [1, 3]]).reshape(1, 2, 1, 2, 1))[..., 0].tolist()
        [[0, 1, 2, 3]]
    """
    v, u, h, w, c = views.shape
    return np.ascontiguousarray(views.transpose(2, 0, 3, 1, 4).reshape(h * v, w * u, c))
