"""Folders that hold several frames of numbered cameras, which look like a grid by their names."""

from __future__ import annotations

import warnings

import numpy as np

from occjax.errors import InputError
from occjax.io.naming import GridWarning
from occjax.io.view_files import ViewFiles
from occjax.layout import ORIENTATIONS, Orientation, ViewOrderReport
from occjax.layout.readings import best_reading, places
from occjax.lightfield import LightField, view_offsets


def check_frames(
    stored: LightField,
    files: ViewFiles,
    order: Orientation,
    report: ViewOrderReport,
    *,
    declared: bool,
) -> None:
    """Refuse several frames of numbered cameras, which look like a grid by their names.

    The first or the second number of the names may be that of the frame. Frames are as consistent
    in the reverse order. So if views are clearly more consistent in one view order than in all
    others, they are a grid and need no comparison.

    Args:
        stored: The views as stored.
        files: Their files.
        order: Declared view order.
        report: Measurement of the views in the declared order.
        declared: Whether the user has declared what the names mean.

    Raises:
        InputError: If the views are frames.

    Warns:
        GridWarning: If the frames explain the images as well as the grid, unless ``declared``.
    """
    sample = next(iter(files.named.matches.values()))
    if report.conclusive or "i" in sample.groupdict() or min(stored.grid) < 2:
        return
    rows, columns = stored.grid
    option = f"grid (--grid {rows} {columns})"
    likely = min(ORIENTATIONS, key=lambda orientation: report.scores[orientation.name])
    grid_offsets = _stored_offsets(stored.grid, order.then(likely))
    for axis, camera in enumerate("uv"):
        frames, *arrays = (
            array.swapaxes(0, axis) for array in (stored.views, files.present, grid_offsets)
        )
        cameras, clear = _grid_of_frames(frames, *arrays)
        if cameras is None or (declared and not clear):
            continue
        name = f"{sample.string[: sample.start(camera)]}{{i}}{sample.string[sample.end(camera) :]}"
        v, u = cameras
        reading = f"{len(frames)} frames of {v}x{u} views"
        one = f"pattern of one (--pattern {name!r}{'' if v == u else f' --grid {v} {u}'})"
        if clear:
            raise InputError(
                f"{files.folder}: has {reading} by photo-consistency; pass the {one}, or {option} "
                "if not"
            )
        warnings.warn(
            f"{files.folder}: read as one {rows}x{columns} grid, but {reading} explain the images "
            f"about as well; if they are frames, pass the {one}; if not, pass {option}",
            GridWarning,
            stacklevel=4,
        )


def _stored_offsets(grid: tuple[int, int], order: Orientation) -> np.ndarray:
    """Return the ``[V, U, 2]`` offsets of the views as stored, if this is their view order."""
    numbers = order.lay_out(np.arange(grid[0] * grid[1]).reshape(grid))
    offsets = np.empty((numbers.size, 2), np.float32)
    offsets[numbers] = view_offsets(*numbers.shape)
    return offsets.reshape(*grid, 2)


def _grid_of_frames(
    frames: np.ndarray, present: np.ndarray, offsets: np.ndarray
) -> tuple[tuple[int, int] | None, bool]:
    """Return the grid of the cameras of a frame if the views may be frames, and if that is clear.

    Args:
        frames: ``[F, N, H, W, C]`` views: the rows, or the columns, of the grid in the names.
        present: ``[F, N]`` bool, views that are there.
        offsets: ``[F, N, 2]`` offsets of the views in the grid in the names.

    Returns:
        The grid of the N cameras; None if the views are those of the grid in the names.
    """
    count, cameras = present.shape
    middle = slice(max(0, count // 2 - 1), count // 2 + 1)
    grids = [(v, cameras // v) for v in range(2, cameras // 2 + 1) if cameras % v == 0]
    grids.sort(key=lambda grid: abs(grid[0] - grid[1]), reverse=True)
    if grids and present[middle].all():
        # Two frames must agree, so that one swapped view does not decide. The middle ones are the
        # least vignetted.
        readings = [offsets[count // 2], *map(places, grids)]
        found = [best_reading(frame, readings) for frame in frames[middle]]
        if all(best.number > 0 or best.alike for best in found):
            number = max(1, *(best.number for best in found))
            return grids[number - 1], all(best.number > 0 and best.clear for best in found)
    near_centre = middle, slice(max(0, cameras // 2 - 1), cameras // 2 + 2)
    if present[near_centre].all():
        views = frames[near_centre].reshape(-1, *frames.shape[2:])
        grid = offsets[near_centre].reshape(-1, 2)
        still = grid * (np.ptp(offsets[0], axis=0) > 0)  # cameras that do not move between frames
        best = best_reading(views, [grid, still])
        if best.number == 1:
            return (1, cameras), best.clear
    return None, False
