"""The files of the views of a folder, and what to do if that of the centre view is missing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from occjax.errors import InputError
from occjax.io.naming import NamedViews, first_few
from occjax.lightfield import centre_index


@dataclass(frozen=True, eq=False)
class ViewFiles:
    """File names of a grid of views, as stored.

    Attributes:
        folder: Name of the folder, for messages.
        named: The views by their names.
        present: ``[V, U]`` bool, False for views that are missing or cannot be used.
    """

    folder: str
    named: NamedViews
    present: np.ndarray

    def usable(self, arrange: Callable[[np.ndarray], np.ndarray]) -> np.ndarray | None:
        """Return the mask ``[V, U]`` of the views that can be used, in the declared view order.

        Args:
            arrange: Puts an array ``[V, U]`` of the stored grid into the declared view order. A
                flip of an axis of even size makes another view the centre.

        Returns:
            The mask; None if all views can be used.

        Raises:
            InputError: If the centre view cannot be used. The message says which views to move to
                another folder, so that the centre view is one that can be used.
        """
        usable = arrange(self.present)
        row, column = centre = centre_index(usable.shape)
        if not usable[centre]:
            name = arrange(self._names())[centre]
            rows, columns = usable.shape
            raise InputError(
                f"{self.folder}: the centre view {name} (row {row}, column {column} of the "
                f"{rows}x{columns} grid, counted from 0), for which disparity is estimated, is "
                f"missing or cannot be used; add it{self._alternative(arrange)}"
            )
        return None if usable.all() else usable

    def _names(self) -> np.ndarray:
        """Return the ``[V, U]`` file names, also of the missing views."""
        names = np.empty(self.named.grid, object)
        present = {index: match.string for index, match in self.named.matches.items()}
        for index, name in (present | self.named.missing).items():
            names[index] = name
        return names

    def _alternative(self, arrange: Callable[[np.ndarray], np.ndarray]) -> str:
        """Return which row or column can be left out, as the end of a message; may be empty."""
        names = self._names()
        numbered = "i" in next(iter(self.named.matches.values())).groupdict()
        sides: dict[str, slice | tuple[slice, slice]] = {
            "last row": np.s_[:-1],
            "first row": np.s_[1:],
            "last column": np.s_[:, :-1],
            "first column": np.s_[:, 1:],
            "last two rows": np.s_[:-2],
            "last two columns": np.s_[:, :-2],
        }
        for side, kept in sides.items():
            if numbered and not side.endswith(("last row", "last two rows")):
                continue  # The other views would change their places in the grid.
            rest, present = arrange(names[kept]), arrange(self.present[kept])
            if rest.size < 2 or not present[centre_index(rest.shape)]:
                continue
            left_out = np.ones(names.shape, bool)
            left_out[kept] = False
            moved = [str(name) for name in names[left_out & self.present]]
            grid = "x".join(map(str, names[kept].shape))
            option = f" and pass grid (--grid {grid.replace('x', ' ')})" * numbered
            return (
                f", or move the {side} of views ({first_few(moved)}) to another folder{option}: "
                f"{rest[centre_index(rest.shape)]} is the centre view of the {grid} views that stay"
            )
        return ""
