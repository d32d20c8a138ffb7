"""Detection of video frames of a camera array, whose file names look like one grid of views."""

from __future__ import annotations

import numpy as np

from occjax.errors import InputError, warn
from occjax.io.naming import GridWarning
from occjax.io.view_files import ViewFiles
from occjax.layout import ORIENTATIONS, Orientation, ViewOrderReport
from occjax.layout.hypotheses import best_hypothesis, row_major_offsets
from occjax.lightfield import LightField, view_offsets


def refuse_video_frames(
    stored: LightField,
    files: ViewFiles,
    order: Orientation,
    report: ViewOrderReport,
    *,
    declared: bool,
) -> None:
    """Raise an error if the views are several frames of a camera array, not one grid of views.

    The two numbers in a file name may be row and column, or frame and camera. Reversing the order
    of the frames does not change the photo-consistency. So if one view order is clearly the most
    consistent, the views are a grid, and nothing else is tested.

    Args:
        stored: The views as stored.
        files: Their files.
        order: Declared view order.
        report: Measurement of the views in the declared order.
        declared: Whether the user has declared what the names mean.

    Raises:
        InputError: If the views are frames.

    Warns:
        GridWarning: If frames and grid are about equally photo-consistent, unless ``declared``.
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
        cameras, clear = _camera_grid_of_frames(frames, *arrays)
        if cameras is None or (declared and not clear):
            continue
        name = f"{sample.string[: sample.start(camera)]}{{i}}{sample.string[sample.end(camera) :]}"
        v, u = cameras
        what = f"{len(frames)} frames of {v}x{u} views"
        one = f"pattern (--pattern {name!r}{'' if v == u else f' --grid {v} {u}'})"
        if clear:
            raise InputError(
                f"{files.folder}: has {what}, judged by photo-consistency; to read one frame, "
                f"pass {one}; to read all files as one light field, pass {option}"
            )
        warn(
            f"{files.folder}: read as one {rows}x{columns} grid, but {what} are about as "
            f"photo-consistent; to read one frame, pass {one}; to confirm the grid, pass {option}",
            GridWarning,
        )


def _stored_offsets(grid: tuple[int, int], order: Orientation) -> np.ndarray:
    """Return the ``[V, U, 2]`` offsets of the stored views when ``order`` is their view order."""
    numbers = order.lay_out(np.arange(grid[0] * grid[1]).reshape(grid))
    offsets = np.empty((numbers.size, 2), np.float32)
    offsets[numbers] = view_offsets(*numbers.shape)
    return offsets.reshape(*grid, 2)


def _camera_grid_of_frames(
    frames: np.ndarray, present: np.ndarray, offsets: np.ndarray
) -> tuple[tuple[int, int] | None, bool]:
    """Test whether the views are video frames, and return the grid of the cameras.

    Args:
        frames: ``[F, N, H, W, C]`` views: the rows, or the columns, of the grid in the names.
        present: ``[F, N]`` bool, views that are there.
        offsets: ``[F, N, 2]`` offsets of the views in the grid in the names.

    Returns:
        The grid of the N cameras, or None if the views are the grid in the names; and whether the
        frames are clearly more consistent than that grid.
    """
    count, cameras = present.shape
    middle = slice(max(0, count // 2 - 1), count // 2 + 1)
    grids = [(v, cameras // v) for v in range(2, cameras // 2 + 1) if cameras % v == 0]
    grids.sort(key=lambda grid: abs(grid[0] - grid[1]), reverse=True)
    if grids and present[middle].all():
        # Both middle frames must agree, so that one swapped view cannot decide. If the views are a
        # grid, its middle rows have the least vignetting.
        hypotheses = [offsets[count // 2], *map(row_major_offsets, grids)]
        found = [best_hypothesis(frame, hypotheses) for frame in frames[middle]]
        if all(best.number > 0 or best.alike for best in found):
            number = max(1, *(best.number for best in found))
            return grids[number - 1], all(best.number > 0 and best.clear for best in found)
    near_centre = middle, slice(max(0, cameras // 2 - 1), cameras // 2 + 2)
    if present[near_centre].all():
        views = frames[near_centre].reshape(-1, *frames.shape[2:])
        grid = offsets[near_centre].reshape(-1, 2)
        # A row of cameras that are at the same positions in all frames.
        static = grid * (np.ptp(offsets[0], axis=0) > 0)
        best = best_hypothesis(views, [grid, static])
        if best.number == 1:
            return (1, cameras), best.clear
    return None, False
