"""The eight view orders of a grid, and how to convert between them.

Files list views row by row or column by column, rows downwards or upwards, columns rightwards or
leftwards. The convention of :mod:`occjax.lightfield` is one of these eight view orders.
"""

from __future__ import annotations

import dataclasses
import itertools
from dataclasses import dataclass
from typing import Literal

import numpy as np

from occjax.errors import check_one_of
from occjax.lightfield import LightField, centre_index

Order = Literal["vu", "uv", "serpentine"]
"""Order in which files count views: rows first, columns first, or every second row backwards."""

Flip = Literal["", "v", "u", "vu", "uv"]
"""Axes of the grid that run backwards in the files."""


@dataclass(frozen=True)
class Orientation:
    """A change of the view order: first swap the axes of the grid, then flip them.

    Attributes:
        swap: The first index of the grid is the view column, not the row.
        flip_rows: After the swap, view rows run from bottom to top.
        flip_columns: After the swap, view columns run from right to left.
    """

    swap: bool = False
    flip_rows: bool = False
    flip_columns: bool = False

    @property
    def name(self) -> str:
        """Return the description, e.g. ``"rows and columns swapped, rows flipped"``.

        Example:
            >>> Orientation(swap=True, flip_rows=True).name
            'rows and columns swapped, rows flipped'
        """
        flipped = ["rows"] * self.flip_rows + ["columns"] * self.flip_columns
        parts = ["rows and columns swapped"] * self.swap
        parts += [f"{' and '.join(flipped)} flipped"] * bool(flipped)
        return ", ".join(parts) or "as declared"

    @property
    def order(self) -> str:
        """Return ``"uv"`` if the axes are swapped, else ``"vu"``."""
        return "uv" if self.swap else "vu"

    @property
    def flip(self) -> str:
        """Return the flipped axes: ``""``, ``"v"``, ``"u"`` or ``"vu"``."""
        return "v" * self.flip_rows + "u" * self.flip_columns

    @property
    def reversed_sign(self) -> Orientation:
        """Return this orientation with both axes flipped in addition, which negates disparity."""
        return Orientation(self.swap, not self.flip_rows, not self.flip_columns)

    def then(self, other: Orientation) -> Orientation:
        """Combine this orientation with one that is applied after it.

        Example:
            >>> swap, rows = Orientation(swap=True), Orientation(flip_rows=True)
            >>> rows.then(swap).name
            'rows and columns swapped, columns flipped'
        """
        rows, columns = self.flip_rows, self.flip_columns
        if other.swap:
            rows, columns = columns, rows
        return Orientation(
            self.swap != other.swap, rows != other.flip_rows, columns != other.flip_columns
        )

    def apply(self, light_field: LightField) -> LightField:
        """Return the light field with its grid swapped and flipped.

        Camera positions follow the views: a swap exchanges their two components, a flip negates
        one. The ground truth belongs to the centre view and stays, except where a flip of an axis
        of even size makes another view the centre. The view order report is dropped.

        Args:
            light_field: Light field with any grid.

        Returns:
            The same views, as a contiguous copy, in the new view order.

        Example:
            >>> light_field = LightField(np.zeros((3, 5, 8, 8, 1), np.uint8))
            >>> Orientation(swap=True).apply(light_field).grid
            (5, 3)
        """
        moved = light_field.rearranged(lambda grid: np.ascontiguousarray(self.lay_out(grid)))
        rows, columns = moved.grid
        positions, ground_truth = moved.positions, moved.ground_truth
        if positions is not None:
            signs = np.where([self.flip_rows, self.flip_columns], -1.0, 1.0)
            positions = positions[..., ::-1] if self.swap else positions
            positions = positions * signs.astype(positions.dtype)
            positions = positions - positions[centre_index((rows, columns))]
        if (self.flip_rows and rows % 2 == 0) or (self.flip_columns and columns % 2 == 0):
            ground_truth = None
        return dataclasses.replace(moved, positions=positions, ground_truth=ground_truth)

    def lay_out(self, grid: np.ndarray) -> np.ndarray:
        """Return an array ``[V, U, ...]`` with its first two axes swapped and flipped; no copy."""
        if self.swap:
            grid = grid.swapaxes(0, 1)
        if self.flip_rows:
            grid = grid[::-1]
        if self.flip_columns:
            grid = grid[:, ::-1]
        return grid


ORIENTATIONS = tuple(
    Orientation(swap, rows, columns)
    for swap, rows, columns in itertools.product((False, True), repeat=3)
)
"""The eight orientations; the first one is the convention of this library."""


def declared_orientation(order: str, flip: str) -> Orientation:
    """Return the orientation that corrects the view order that a user declares.

    Args:
        order: ``"vu"`` if the first index of the files is the view row, ``"uv"`` if it is the view
            column.
        flip: Axes that run backwards once the order is correct: any of ``"v"`` (rows run from
            bottom to top) and ``"u"`` (columns run from right to left).

    Returns:
        The orientation; its ``apply`` puts a light field into the order of the library.

    Raises:
        InputError: If ``order`` or ``flip`` has another value.

    Example:
        >>> declared_orientation("uv", "v")
        Orientation(swap=True, flip_rows=True, flip_columns=False)
    """
    check_one_of("order", order, Order)
    check_one_of("flip", flip, Flip)
    return Orientation(order == "uv", "v" in flip, "u" in flip)


def straightened(grid: np.ndarray) -> np.ndarray:
    """Return a copy of a grid in which every second row is reversed.

    It puts views in serpentine order into rows that all run from left to right, and back.

    Args:
        grid: ``[V, U, ...]`` one item for each view.

    Returns:
        ``[V, U, ...]`` the same items.

    Example:
        >>> straightened(np.arange(6).reshape(2, 3)).tolist()
        [[0, 1, 2], [5, 4, 3]]
    """
    grid = grid.copy()
    grid[1::2] = grid[1::2, ::-1]
    return grid


def declaration(orientation: Orientation) -> str:
    """Return the options that declare an orientation, in Python and on the command line.

    Args:
        orientation: Orientation that corrects the view order of the files.

    Returns:
        An instruction, for a message to the user.

    Example:
        >>> declaration(Orientation(swap=True, flip_rows=True))
        'pass order (--order uv) and flip (--flip v)'
        >>> declaration(Orientation())
        'leave out order and flip'
    """
    order = f"order (--order {orientation.order})" if orientation.swap else ""
    flip = f"flip (--flip {orientation.flip})" if orientation.flip else ""
    if order and flip:
        return f"pass {order} and {flip}"
    if not order and not flip:
        return "leave out order and flip"
    return f"pass {order or flip} alone"
