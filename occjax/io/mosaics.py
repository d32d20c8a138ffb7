"""All views in one image: as tiles, or as a macro-pixel image (MacPI).

Tiled: the views are arranged as in the grid. ``tiled[v * H + y, u * W + x] = views[v, u, y, x]``.
MacPI (macro-pixel, lenslet): each pixel becomes a small image of all views, as behind a microlens.
``macpi[y * V + v, x * U + u] = views[v, u, y, x]``.
Quilt (holographic displays): one row of views in several rows of tiles, from the bottom left to the
top right one. A file name with ``qs8x6`` states 8 columns and 6 rows of tiles.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from occjax.errors import InputError, check_whole_pair, warn
from occjax.io.config import ReadingConfig
from occjax.io.images import read_image
from occjax.io.layouts import Mosaic
from occjax.io.naming import GridWarning
from occjax.layout.hypotheses import best_hypothesis, row_major_offsets
from occjax.lightfield import MIN_VIEW_SIZE_PX, to_grey


def read_mosaic(path: Path, grid: tuple[int, int] | None, kind: Mosaic | None) -> np.ndarray:
    """Read one image of all views.

    Args:
        path: Image file.
        grid: ``(V, U)``, number of view rows and columns; of a quilt, rows and columns of tiles.
        kind: Arrangement of the views; None to detect it.

    Returns:
        ``[V, U, H, W, C]`` views.

    Raises:
        InputError: If the grid is missing or does not divide the image, or the arrangement cannot
            be detected.

    Warns:
        GridWarning: If tiles are read as a quilt because of their photo-consistency, the content of
            a quilt repeats at other distances than those of its tiles, or the image looks like a
            MacPI image of another grid.
    """
    image = read_image(path)
    named = re.search(r"(?<![A-Za-z])qs(\d+)x(\d+)", path.stem, re.IGNORECASE)
    if kind == "quilt" or (kind is None and named):
        tiles = (int(named[2]), int(named[1])) if named and grid is None else grid
        if tiles is None or min(tiles) < 1:
            raise InputError(f"{path}: a quilt needs its tiles; pass grid (--grid ROWS COLUMNS)")
        _warn_of_other_tiles(path, image, tiles)
        return split_quilt(image, tiles)
    if grid is None:
        raise InputError(
            f"{path}: one image of all views needs the grid; pass grid (--grid V U), of a quilt "
            "with layout (--layout quilt --grid ROWS COLUMNS)"
        )
    remedy = "" if kind else "; if it is a quilt, pass layout (--layout quilt)"
    height, width = _view_size(image, grid, f"{path}: ", remedy)
    if min(height, width) < MIN_VIEW_SIZE_PX:
        raise InputError(
            f"{path}: {image.shape[0]}x{image.shape[1]} pixels leave {height}x{width} for each of "
            f"{grid[0]}x{grid[1]} views; pass the right grid (--grid V U)"
        )
    detected = kind or detect_mosaic(image, grid)
    if detected is None:
        raise InputError(
            f"{path}: cannot tell tiled views from a MacPI image; "
            "pass layout (--layout tiled, or macpi)"
        )
    period = lens_period(image, grid)
    if period is not None and (detected != "macpi" or period != tuple(grid)):
        warn(
            f"{path}: read as {grid[0]}x{grid[1]} views, {detected}, but its brightness steps are "
            f"those of a MacPI image of {period[0]}x{period[1]} views; if so, pass grid and layout "
            f"(--grid {period[0]} {period[1]} --layout macpi)",
            GridWarning,
        )
    if detected == "macpi":
        return split_macpi(image, grid)
    views = split_tiles(image, grid)
    if kind is None and min(grid) > 1 and _is_quilt(views):
        warn(
            f"{path}: read as a quilt of {grid[0]}x{grid[1]} tiles, a row of {grid[0] * grid[1]} "
            "views, by photo-consistency; pass layout (--layout tiled) if that is wrong",
            GridWarning,
        )
        return split_quilt(image, grid)
    return views


def _is_quilt(views: np.ndarray) -> bool:
    """Return whether tiles are one row of views, from the bottom left one, rather than a grid."""
    rows, columns = views.shape[:2]
    line = row_major_offsets((1, rows * columns)).reshape(rows, columns, 2)[::-1].reshape(-1, 2)
    tiles = views.reshape(-1, *views.shape[2:])
    best = best_hypothesis(tiles, [row_major_offsets((rows, columns)), line])
    return best.number == 1 and best.clear


def detect_mosaic(image: np.ndarray, grid: tuple[int, int]) -> Mosaic | None:
    """Detect the arrangement of a mosaic by the positions of brightness steps.

    Tiles have seams between neighbouring views, a MacPI image has seams between microlenses. The
    outer views of a plenoptic camera may be black. A MacPI image then has no visible seams, but the
    pixels of these views are dark under every microlens.

    Args:
        image: ``[V * H, U * W, C]``.
        grid: ``(V, U)``.

    Returns:
        The arrangement; None if there is no clear difference, for instance without texture.
    """
    if _has_dark_views(image, grid):
        return "macpi"
    profiles, tiles, lenses = [], [], []
    for axis, count in enumerate(grid):
        size = image.shape[axis] // count
        if count == 1 or size == 1:
            continue
        position = np.arange(1, count * size)
        profiles.append(_brightness_steps(image, axis))
        tiles.append(position % size == 0)
        lenses.append(position % count == 0)
    if not profiles:
        return "tiled"  # one view, or views of one pixel: both arrangements are the same
    profile, tile, lens = map(np.concatenate, (profiles, tiles, lenses))
    threshold = ReadingConfig().min_seam_ratio * _mean(profile[~lens & ~tile])
    if _mean(profile[lens & ~tile]) > threshold:
        return "macpi"
    return "tiled" if _mean(profile[tile]) > threshold else None


def _brightness_steps(image: np.ndarray, axis: int) -> np.ndarray:
    """Return the mean difference of each row of pixels (axis 0), or column (1), from the next."""
    steps = np.abs(np.diff(image.astype(np.float32), axis=axis))
    return steps.mean(axis=(1 - axis, 2))


def _mean(values: np.ndarray) -> float:
    """Return the mean of all values; 0 if there are none."""
    return float(values.mean()) if values.size else 0.0


def lens_period(image: np.ndarray, grid: tuple[int, int]) -> tuple[int, int] | None:
    """Return the grid of a MacPI image, from the distance of its brightness steps.

    Args:
        image: ``[V * H, U * W, C]``.
        grid: ``(V, U)`` that the user declares; seams of its tiles do not count.

    Returns:
        ``(V, U)``, each 2 to 20; None if the image has no clear period, as a tiled image.

    Example:
        >>> view = np.random.default_rng(0).random((24, 24, 1))
        >>> lens_period(join_macpi(np.broadcast_to(view, (3, 4, 24, 24, 1))), (4, 6))
        (3, 4)
    """
    period = []
    for axis, count in enumerate(grid):
        profile = _brightness_steps(image, axis)
        position = np.arange(1, image.shape[axis])
        inner = position % (image.shape[axis] // count) != 0
        ratios = {}
        for n in range(2, 21):
            at_lenses = inner & (position % n == 0)
            if image.shape[axis] % n == 0 and at_lenses.any():
                elsewhere = profile[inner & ~at_lenses].mean()
                # The median: only a few of these places may be seams of tiles.
                usual = float(np.median(profile[at_lenses]))
                ratios[n] = usual / max(elsewhere, np.finfo(np.float32).tiny)
        best = max(ratios, key=ratios.__getitem__, default=None)
        if best is None or ratios[best] <= ReadingConfig().min_seam_ratio:
            return None
        period.append(best)
    return period[0], period[1]


def repeated_tiles(image: np.ndarray) -> tuple[int, int] | None:
    """Return the grid of a tiled image, from the distance at which its content repeats.

    Args:
        image: ``[V * H, U * W]`` grey tiles.

    Returns:
        ``(V, U)``, each 2 to 20; None if no grid divides the image.

    Example:
        >>> view = np.random.default_rng(0).random((16, 24))
        >>> repeated_tiles(np.tile(view, (3, 5)))
        (3, 5)
    """
    grid = []
    for axis in (0, 1):
        lines = np.moveaxis(image, axis, 0)
        size = len(lines)
        most = min(20, size // ReadingConfig().min_repeated_px)
        counts = [n for n in range(most, 1, -1) if size % n == 0]
        if not counts:
            return None
        change = {n: _change(lines, n) for n in counts}
        # The largest count, since content also repeats at multiples of the tile size.
        grid.append(next(n for n in counts if change[n] <= 1.2 * min(change.values())))
    return grid[0], grid[1]


def _change(lines: np.ndarray, count: int) -> float:
    """Return the mean difference of each of ``count`` equal parts from the next one."""
    size = len(lines) // count
    return float(np.abs(lines[size:] - lines[:-size]).mean())


def _warn_of_other_tiles(path: Path, image: np.ndarray, tiles: tuple[int, int]) -> None:
    """Warn if the content of a quilt repeats at other distances than those of the given tiles."""
    grey = to_grey(image)
    found = repeated_tiles(grey)
    if found is None:
        return
    ratio = ReadingConfig().min_seam_ratio
    differs = (
        declared > 1 and _change(lines, declared) > ratio * _change(lines, repeated)
        for lines, declared, repeated in zip((grey, grey.T), tiles, found, strict=True)
    )
    if any(differs):
        warn(
            f"{path}: read as a quilt of {tiles[1]}x{tiles[0]} tiles (columns x rows), but its "
            f"content repeats as in {found[1]}x{found[0]} tiles; if so, pass grid "
            f"(--grid {found[0]} {found[1]})",
            GridWarning,
        )


def _has_dark_views(image: np.ndarray, grid: tuple[int, int]) -> bool:
    """Return whether, taken as a MacPI image, some views are much darker than others.

    If a tiled image is split as a MacPI image, each part has pixels of all views. Therefore all
    parts are about equally bright.
    """
    config = ReadingConfig()
    if image.shape[0] * image.shape[1] < config.min_dark_pixels * grid[0] * grid[1]:
        return False
    brightness = split_macpi(image, grid).mean((2, 3, 4), dtype=np.float64)
    return bool(brightness.min() < config.max_dark_ratio * brightness.max())


def _view_size(
    image: np.ndarray, grid: tuple[int, int], prefix: str = "", remedy: str = ""
) -> tuple[int, int]:
    """Return ``(H, W)`` of the views in an image of all views."""
    check_whole_pair("grid", grid)
    (rows, columns), (height, width) = grid, image.shape[:2]
    if height % rows or width % columns:
        raise InputError(
            f"{prefix}{height}x{width} pixels are not a multiple of the {rows}x{columns} grid; "
            f"pass the right grid (--grid V U) or crop the image{remedy}"
        )
    return height // rows, width // columns


def split_tiles(image: np.ndarray, grid: tuple[int, int]) -> np.ndarray:
    """Split a tiled image into its views.

    Args:
        image: ``[V * H, U * W, C]``.
        grid: ``(V, U)``.

    Returns:
        ``[V, U, H, W, C]`` views.

    Raises:
        InputError: If the grid is not two whole numbers that divide the size of the image.

    Example:
        >>> split_tiles(np.arange(4).reshape(2, 2, 1), (2, 1))[:, :, 0, :, 0].tolist()
        [[[0, 1]], [[2, 3]]]
    """
    (v, u), (h, w) = grid, _view_size(image, grid)
    split = image.reshape(v, h, u, w, -1)
    return np.ascontiguousarray(split.transpose(0, 2, 1, 3, 4))


def split_quilt(image: np.ndarray, tiles: tuple[int, int]) -> np.ndarray:
    """Split a quilt into its row of views.

    Args:
        image: ``[H', W', C]``; pixels at the top and the right that do not fill a tile are dropped.
        tiles: Rows and columns of tiles.

    Returns:
        ``[1, U, H, W, C]`` views, U the number of tiles.

    Raises:
        InputError: If there are no tiles, or more than pixels.

    Example:
        >>> split_quilt(np.arange(4).reshape(2, 2, 1), (2, 2)).ravel().tolist()
        [2, 3, 0, 1]
    """
    check_whole_pair("tiles", tiles)
    rows, columns = tiles
    h, w = image.shape[0] // rows, image.shape[1] // columns
    if min(h, w) < 1:
        raise InputError(f"{list(image.shape)} pixels are too few for {rows}x{columns} tiles")
    views = split_tiles(image[image.shape[0] - rows * h :, : columns * w], tiles)
    return views[::-1].reshape(1, rows * columns, *views.shape[2:])


def join_tiles(views: np.ndarray) -> np.ndarray:
    """Join views to a tiled image.

    Args:
        views: ``[V, U, H, W, C]``.

    Returns:
        ``[V * H, U * W, C]`` tiled image.

    Raises:
        InputError: If the views have another shape.

    Example:
        >>> join_tiles(np.arange(4).reshape(2, 1, 1, 2, 1))[..., 0].tolist()
        [[0, 1], [2, 3]]
    """
    v, u, h, w, c = _shape_of_views(views)
    return np.ascontiguousarray(views.transpose(0, 2, 1, 3, 4).reshape(v * h, u * w, c))


def split_macpi(image: np.ndarray, grid: tuple[int, int]) -> np.ndarray:
    """Split a MacPI image into its views.

    Args:
        image: ``[H * V, W * U, C]``.
        grid: ``(V, U)``.

    Returns:
        ``[V, U, H, W, C]`` views.

    Raises:
        InputError: If the grid is not two whole numbers that divide the size of the image.

    Example:
        >>> split_macpi(np.arange(4).reshape(1, 4, 1), (1, 2))[0, :, 0, :, 0].tolist()
        [[0, 2], [1, 3]]
    """
    (v, u), (h, w) = grid, _view_size(image, grid)
    split = image.reshape(h, v, w, u, -1)
    return np.ascontiguousarray(split.transpose(1, 3, 0, 2, 4))


def join_macpi(views: np.ndarray) -> np.ndarray:
    """Join views to a MacPI image.

    Args:
        views: ``[V, U, H, W, C]``.

    Returns:
        ``[H * V, W * U, C]`` MacPI image.

    Raises:
        InputError: If the views have another shape.

    Example:
        >>> join_macpi(np.array([[0, 2], [1, 3]]).reshape(1, 2, 1, 2, 1))[..., 0].tolist()
        [[0, 1, 2, 3]]
    """
    v, u, h, w, c = _shape_of_views(views)
    return np.ascontiguousarray(views.transpose(2, 0, 3, 1, 4).reshape(h * v, w * u, c))


def _shape_of_views(views: np.ndarray) -> tuple[int, ...]:
    """Return the shape of views ``[V, U, H, W, C]``; raise an error if they have another one."""
    if np.ndim(views) != 5:
        raise InputError(f"views must be [V, U, H, W, C], not {list(np.shape(views))}")
    return views.shape
