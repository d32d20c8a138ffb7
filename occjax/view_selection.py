"""Selections of views: all views, a star, a cross, or a smaller grid around the centre view."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from occjax.errors import InputError, check_whole_pair, nearest
from occjax.lightfield import centre_index, view_offsets

Arrangement = Literal["all", "cross", "star", "outer_star"]
"""``all`` views; the ``cross`` of the centre view's row and column; the ``star``, which adds both
diagonals; the ``outer_star`` of the two outermost views in each of the eight directions."""

ViewSelection = Arrangement | tuple[int, int]
"""An arrangement, or ``(V, U)``: that many rows and columns of views around the centre view."""


def select_view_indices(offsets: np.ndarray, selection: ViewSelection) -> np.ndarray:
    """Return the indices of the selected views in a list of views.

    Args:
        offsets: ``[n, 2]`` integer offsets ``(row, column)`` of the views from the centre view.
        selection: The views to take.

    Returns:
        ``[k]`` int32 indices, ordered by row, then column, except that the centre view is moved to
        ``k // 2``.

    Raises:
        InputError: If the selection is invalid, if a view of ``(V, U)`` is missing, or if the
            number of views with offset (0, 0) is not one.

    Example:
        >>> offsets = np.array([[0, -2], [0, -1], [0, 0], [0, 1]])
        >>> select_view_indices(offsets, "star").tolist()
        [0, 1, 2, 3]
    """
    check_selection(selection)
    row, column = offsets.T
    if selection == "all":
        selected = np.ones(len(offsets), bool)
    elif isinstance(selection, str):
        selected = (row == 0) | (column == 0)
        if selection != "cross":
            selected |= np.abs(row) == np.abs(column)
        if selection == "outer_star":
            selected &= _count_further_out(row, column, selected) < 2
    else:
        first = -np.array(centre_index(selection))
        last = first + np.array(selection) - 1
        selected = np.all((offsets >= first) & (offsets <= last), axis=-1)
        present = len(np.unique(offsets[selected], axis=0))
        if present < np.prod(selection):
            raise InputError(
                f"has {present} of the {selection[0]}x{selection[1]} views around the centre; "
                "select others"
            )
    centre = np.flatnonzero((row == 0) & (column == 0))
    if len(centre) != 1:
        raise InputError(
            f"{len(centre)} views have the offset (0, 0); exactly one view must be the centre view"
        )
    others = np.setdiff1d(np.flatnonzero(selected), centre)
    others = others[np.lexsort((column[others], row[others]))]
    place = centre_index((1, len(others) + 1))[1]
    return np.insert(others, place, centre).astype(np.int32)


def select_from_grid(
    offsets: np.ndarray, selection: ViewSelection
) -> tuple[np.ndarray, np.ndarray]:
    """Return the array indices of the selected views of an array ``[v, u, ...]``.

    Views of a grid with several rows and columns are selected by their index in the array, so that
    irregular camera positions have no effect. A single row of views can be a list of any views;
    they are selected by their offsets, rounded to whole steps.

    Args:
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view.
        selection: The views to take.

    Returns:
        Row and column indices, each ``[v, u]`` for ``"all"``, ``[V, U]`` for ``(V, U)`` of a grid,
        and ``[1, k]`` otherwise. The centre view is at ``centre_index`` of that shape.

    Raises:
        InputError: As :func:`select_view_indices`.

    Example:
        >>> rows, columns = select_from_grid(view_offsets(3, 3), "cross")
        >>> rows.tolist(), columns.tolist()
        ([[0, 1, 1, 1, 2]], [[1, 0, 1, 2, 1]])
    """
    grid = v, u = offsets.shape[:2]
    is_grid = min(grid) > 1
    index = np.arange(v * u).reshape(grid)
    if selection != "all":
        view_steps = view_offsets(v, u) if is_grid else np.rint(offsets)
        index = select_view_indices(view_steps.reshape(-1, 2), selection)[None]
        if is_grid and not isinstance(selection, str):
            index = np.sort(index).reshape(selection)
    rows, columns = np.unravel_index(index, grid)
    return rows, columns


def is_grid(offsets: np.ndarray, tolerance: float = 0.25) -> bool:
    """Return whether views stand in rows and columns, whose spacings may differ.

    Args:
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view.
        tolerance: Largest distance of three quarters of the views from their places in the grid, in
            steps along each axis. A few misplaced views do not unmake a grid.

    Example:
        >>> is_grid(view_offsets(3, 5) * np.array([1.0, 2.0]))
        True
        >>> is_grid(np.random.default_rng(0).normal(size=(3, 5, 2)))
        False
    """
    regular = view_offsets(*offsets.shape[:2])
    for axis in (0, 1):
        nominal, offset = regular[..., axis], offsets[..., axis]
        if nominal.any():
            step = np.median(offset[nominal != 0] / nominal[nominal != 0])
            distance = np.abs(offset - step * nominal) / max(abs(step), np.finfo(np.float32).tiny)
        else:
            distance = np.abs(offset) / max(np.abs(offsets).max(), 1.0)
        if np.quantile(distance, 0.75) > tolerance:
            return False
    return True


def check_selection(selection: ViewSelection) -> None:
    """Raise an error if a selection is invalid.

    Raises:
        InputError: If it is neither the name of an arrangement nor two positive numbers.
    """
    if isinstance(selection, str):
        if selection not in get_args(Arrangement):
            raise InputError(
                f"selection is {selection!r}; {nearest(selection, get_args(Arrangement))} or the "
                "numbers (V, U)"
            )
    else:
        check_whole_pair("selection", selection)


def _count_further_out(row: np.ndarray, column: np.ndarray, counted: np.ndarray) -> np.ndarray:
    """Return, for each view, how many counted views lie further out in the same direction.

    Directions are the eight combinations of the signs of row and column.
    """
    distance = np.maximum(np.abs(row), np.abs(column))
    direction = np.stack([np.sign(row), np.sign(column)], axis=-1)
    same_direction = np.all(direction[:, None] == direction[None], axis=-1)
    further = distance[None] > distance[:, None]
    return (same_direction & further & counted[None]).sum(axis=1)
