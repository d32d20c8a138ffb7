"""Files of the maps of all views, and the point cloud fused from them.

==========================  ====================================================================
``views.npz``               ``disparity`` ``[V, U, H, W]`` float32, pixels per view step;
                            ``confidence`` and ``consistency`` float16 in [0, 1]; ``agreeing``
                            uint8; ``filled`` bool; ``offsets`` ``[V, U, 2]``; ``tolerance``: see
                            :class:`occjax.estimators.ViewMaps`
``views/``                  ``disparity_VV_UU.pfm``: the disparity of each view
``views.ply``               coloured points that several views agree on, in the coordinates of the
                            centre view
==========================  ====================================================================
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from occjax.estimators.protocol import ViewMaps
from occjax.io.files import decoding
from occjax.io.pfm import write_pfm
from occjax.io.ply import write_ply
from occjax.lightfield import LightField, project
from occjax.results.conversion import METRES, PIXELS, points_at
from occjax.viz.pictures import view_picture

ARRAYS, CLOUD, FOLDER = "views.npz", "views.ply", "views"
"""Names of the files, and of the folder of the maps of single views."""


@dataclass(frozen=True)
class FusionConfig:
    """Settings of the fused point cloud.

    Attributes:
        min_agreeing: Number of other views that must confirm a point, or the largest number that
            occurs if that is smaller.
        min_consistency: Consistency below which a point is an outlier.
    """

    min_agreeing: int = 3
    min_consistency: float = 0.75


def fused_points(maps: ViewMaps, light_field: LightField) -> tuple[np.ndarray, np.ndarray]:
    """Fuse the maps of all views into one cloud, without outliers and duplicates.

    A point has the coordinates ``(y, x, d)``: where the centre view would see it, and its
    disparity. Cells are a pixel wide and as deep as the tolerance of the maps. The views are added
    in the order of their distance from the centre view. A view adds one point to a cell if no view
    before it has a point there, or in the cell in front or behind.

    Returns:
        ``[N, 3]`` float64 points ``(y, x, d)`` and ``[N, 3]`` uint8 colours; N is 0 if no map has a
        finite disparity.

    Example:
        >>> from occjax.lightfield import view_offsets
        >>> flat, ones = np.zeros((1, 3, 4, 5), np.float32), np.ones((1, 3, 4, 5))
        >>> agreeing, offsets = 2 * ones.astype(int), view_offsets(1, 3)
        >>> maps = ViewMaps(flat, ones, ones, agreeing, ones > 1, offsets, tolerance=0.1)
        >>> points, colours = fused_points(maps, LightField(np.zeros((1, 3, 4, 5), np.uint8)))
        >>> points.shape, colours.shape
        ((20, 3), (20, 3))
    """
    known = np.isfinite(maps.disparity)
    if not known.any():
        return np.empty((0, 3)), np.empty((0, 3), np.uint8)
    config = FusionConfig()
    low, high = float(maps.disparity[known].min()), float(maps.disparity[known].max())
    steps = int((high - low) / maps.tolerance) + 4
    needed = min(config.min_agreeing, int(maps.agreeing.max()))
    offsets = maps.offsets
    order = np.argsort(np.square(offsets).sum(-1), axis=None, kind="stable")
    # Cells are numbered by row, column and depth; margins hold the cells of neighbours.
    width = light_field.image_size[1]
    margin = int(np.ceil(np.abs(offsets).max() * max(abs(low), abs(high)))) + 1
    occupied = np.empty(0, np.int64)
    points, colours = [], []
    for view in zip(*np.unravel_index(order, light_field.grid), strict=True):
        kept = known[view] & (maps.agreeing[view] >= needed)
        kept &= maps.consistency[view] >= config.min_consistency
        y, x = np.nonzero(kept)
        d = maps.disparity[view][kept].astype(np.float64)
        row, column = project(y, x, d, -offsets[view])
        cell = (np.rint(row).astype(np.int64) + margin) * (width + 2 * margin)
        cell = (cell + np.rint(column).astype(np.int64) + margin) * steps
        cell += np.rint((d - low) / maps.tolerance).astype(np.int64) + 1
        new = ~(_is_in(cell, occupied) | _is_in(cell - 1, occupied) | _is_in(cell + 1, occupied))
        _, first = np.unique(cell[new], return_index=True)
        chosen = np.flatnonzero(new)[first]
        points.append(np.stack([row, column, d], -1)[chosen])
        colours.append(view_picture(light_field.views[view])[kept][chosen])
        occupied = np.union1d(occupied, cell[chosen])
    return np.concatenate(points), np.concatenate(colours)


def _is_in(values: np.ndarray, occupied: np.ndarray) -> np.ndarray:
    """Return which values are in a sorted array."""
    if not occupied.size:
        return np.zeros(values.shape, bool)
    place = np.minimum(np.searchsorted(occupied, values), occupied.size - 1)
    return occupied[place] == values


def write_view_maps(maps: ViewMaps, light_field: LightField, folder: Path) -> None:
    """Write the files of the table at the top of this module to a folder.

    Raises:
        InputError: If a file cannot be written.
    """
    np.savez(
        folder / ARRAYS,
        disparity=maps.disparity,
        confidence=maps.confidence.astype(np.float16),
        consistency=maps.consistency.astype(np.float16),
        agreeing=maps.agreeing.astype(np.uint8),
        filled=maps.filled,
        offsets=maps.offsets,
        tolerance=maps.tolerance,
    )
    (folder / FOLDER).mkdir()
    for v, u in np.argwhere(np.isfinite(maps.disparity).any((2, 3))):
        write_pfm(folder / FOLDER / f"disparity_{v:02}_{u:02}.pfm", maps.disparity[v, u])
    points, colours = fused_points(maps, light_field)
    calibration = light_field.calibration
    y, x, d = (points[:, axis] for axis in range(3))
    cloud = points_at(y, x, d, calibration, light_field.image_size)
    finite = np.isfinite(cloud).all(-1)
    comment = PIXELS if calibration is None else METRES
    write_ply(folder / CLOUD, cloud[finite], colours[finite], comment=comment)


def read_view_maps(folder: Path) -> ViewMaps | None:
    """Read the maps of all views from a folder of results; None if it has none.

    Raises:
        InputError: If the file is damaged.
    """
    path = folder / ARRAYS
    if not path.is_file():
        return None
    with decoding(path, "maps of all views", remedy="estimate again") as file:
        stored = np.load(file)
        arrays = {name: stored[name] for name in ViewMaps._fields}
    arrays |= {name: arrays[name].astype(np.float32) for name in ("confidence", "consistency")}
    return ViewMaps(**arrays | {"tolerance": float(arrays["tolerance"])})
