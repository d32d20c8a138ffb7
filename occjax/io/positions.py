"""Camera positions, from the names of the views or a file next to them."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np

from occjax.errors import InputError, warn
from occjax.io.arrays import check_positions, read_npy
from occjax.io.config import ReadingConfig
from occjax.io.files import decoding
from occjax.io.naming import GridWarning, NamedViews
from occjax.lightfield import centre_index


def read_positions(folder: Path, named: NamedViews) -> tuple[NamedViews, np.ndarray | None]:
    """Read the camera positions of a folder of views from ``positions.npy`` or ``positions.csv``.

    The unit of the positions becomes the mean spacing of the view rows (of the columns if there is
    one row): disparity is then in pixels per row step, whatever unit the file has.

    Returns:
        The views, ordered by their positions, and ``[V, U, 2]`` float32 positions ``(row, column)``
        relative to the centre view; None if the folder has no such file.

    Raises:
        InputError: If the file is damaged or does not fit the views, or there are two.
    """
    paths = [
        path for name in ("positions.npy", "positions.csv") if (path := folder / name).exists()
    ]
    if not paths:
        return named, None
    if len(paths) == 2:
        raise InputError(f"{folder}: has positions.npy and positions.csv; remove one of them")
    (path,) = paths
    positions = read_npy(path) if path.suffix == ".npy" else _read_csv(path)
    v, u = named.grid
    if positions.shape == (v * u, 2):
        positions = positions.reshape(v, u, 2)
    named, positions = arranged(str(folder), named, check_positions(path, positions, named.grid))
    rows, columns = spacing(positions)
    return named, relative_to_centre(positions, rows or columns or 1.0)


def gantry_grid(folder: str, named: NamedViews) -> tuple[NamedViews, np.ndarray]:
    """Order gantry views top to bottom and left to right, and return their positions.

    Views of the Stanford light field archive were taken with a gantry and are named
    ``out_ROW_COLUMN_Y_X_.png``. The gantry moved back and forth, so row and column only count the
    exposures; ``Y`` and ``X`` give the camera position. The archive does not document the
    directions of these axes. Other readers take ``X`` to the right and ``Y`` downwards, except in
    the scenes whose names lack the underscore before the suffix (beans, knights, tarot), where
    ``Y`` points upwards. If a scene differs, ``occjax check`` shows it and ``flip`` corrects it.

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


def arranged(
    folder: str, named: NamedViews, positions: np.ndarray
) -> tuple[NamedViews, np.ndarray]:
    """Order views by their positions: rows from top to bottom, columns from left to right.

    Args:
        folder: Name of the folder, for messages.
        named: The views in any of the eight view orders.
        positions: ``[V, U, 2]`` positions ``(row, column)``, rows downwards.

    Returns:
        The views in the order of the library, and their positions ``[V, U, 2]``.

    Raises:
        InputError: If the rows or the columns of cameras have the same position.
    """
    positions = np.asarray(positions, np.float64)
    order = np.arange(math.prod(named.grid)).reshape(named.grid)
    steps = np.abs([[_step(positions, axis, c) for c in (0, 1)] for axis in (0, 1)])
    if steps[0, 1] + steps[1, 0] > steps[0, 0] + steps[1, 1]:  # the rows are columns of cameras
        positions, order = positions.swapaxes(0, 1), order.T
    if _step(positions, 0, 0) < 0:
        positions, order = positions[::-1], order[::-1]
    if _step(positions, 1, 1) < 0:
        positions, order = positions[:, ::-1], order[:, ::-1]
    for size, step in zip(order.shape, spacing(positions), strict=True):
        if size > 1 and step == 0:
            raise InputError(
                f"{folder}: cameras of several rows or columns have the same position; correct the "
                "positions, or name the views only by row and column"
            )
    return named.reordered(order), positions


def spacing(positions: np.ndarray) -> tuple[float, float]:
    """Return the mean distance of neighbouring rows, and of columns; zero if there is only one."""
    return _step(positions, 0, 0), _step(positions, 1, 1)


def relative_to_centre(positions: np.ndarray, unit: float) -> np.ndarray:
    """Return ``[V, U, 2]`` float32 positions relative to the centre view, in this unit."""
    centre = positions[centre_index(positions.shape[:2])]
    return ((positions - centre) / unit).astype(np.float32)


def warn_of_unit(path: Path, positions: np.ndarray) -> None:
    """Warn if positions that are used as they are seem to be in another unit than view steps.

    Args:
        path: File that they come from.
        positions: ``[V, U, 2]`` positions ``(row, column)``.

    Warns:
        GridWarning: If the mean spacing of rows and of columns is far from 1.

    Example:
        >>> warn_of_unit(Path("scene.npz"), np.indices((3, 3)).transpose(1, 2, 0))
    """
    step = max(abs(_step(positions, axis, c)) for axis in (0, 1) for c in (0, 1))
    shortest = ReadingConfig().min_view_step
    if not shortest < step < 1 / shortest:
        warn(
            f"{path}: neighbouring cameras are {step:.4g} apart in positions, which are used as "
            "they are: disparity is in pixels per unit of them; divide positions by this number "
            "to have it per view step",
            GridWarning,
        )


def _step(positions: np.ndarray, axis: int, component: int) -> float:
    """Return the mean change of a component from one row (axis 0) or column (1) to the next."""
    if positions.shape[axis] < 2:
        return 0.0
    return float(np.diff(positions[..., component], axis=axis).mean())


def _read_csv(path: Path) -> np.ndarray:
    """Read one line ``row,column`` for each view; a first line of other text is a heading."""
    remedy = "write one line 'row,column' for each view, in the order of the views"
    with decoding(path, "a table of two columns", remedy=remedy, max_bytes=2**24) as file:
        lines = file.read().decode("utf-8-sig").splitlines()
    numbered = [(number, line) for number, line in enumerate(lines, 1) if line.strip()]
    if numbered and _numbers(numbered[0][1]) is None:
        del numbered[0]
    rows = []
    for number, line in numbered:
        values = _numbers(line)
        if values is None or len(values) != 2 or not np.isfinite(values).all():
            raise InputError(
                f"{path}: line {number} is {line.strip()[:60]!r}, not two numbers; {remedy}"
            )
        rows.append(values)
    return np.array(rows).reshape(-1, 2)


def _numbers(line: str) -> list[float] | None:
    """Return the numbers of a line, between commas, semicolons or spaces; None for other text."""
    try:
        return [float(field) for field in re.split(r"\s*[,;\s]\s*", line.strip())]
    except ValueError:
        return None
