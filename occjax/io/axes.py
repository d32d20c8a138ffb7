"""The order of the axes of an array of views, from its shape or from names of its axes."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from occjax.lightfield import MIN_CERTAIN_SIZE_PX

_ROLES = {4: ("AASS", "SSAA"), 5: ("AASSC", "AACSS", "CAASS", "CSSAA", "SSAAC", "SSCAA")}
"""Orders of angular (A), spatial (S) and colour (C) axes by their number, the usual one first."""


def axis_roles(shape: Sequence[int]) -> tuple[str, ...]:
    """Return which axes of an array of views are angular, spatial and colour.

    Images are larger than the grid of views, and there are 1 to 4 colour channels.

    Args:
        shape: Sizes of the four or five axes.

    Returns:
        The plausible orders, for instance ``"AASSC"`` for ``[V, U, H, W, C]``. There are two if a
        grid of 3 rows may also be the colours.

    Example:
        >>> axis_roles((9, 9, 512, 512, 3)), axis_roles((3, 80, 64, 9, 3)), axis_roles((9,) * 5)
        (('AASSC',), ('CSSAA',), ())
    """
    if len(shape) not in _ROLES or 0 in shape:
        return ()
    usual, *_ = _ROLES[len(shape)]
    certain = tuple(roles for roles in _ROLES[len(shape)] if _is_certain(shape, roles))
    v, u, h, w, c = (*shape, 1)[:5]
    usual_possible = c <= 4 and not (v > h and u > w) and (len(shape) == 5 or w > 4)
    usual_doubtful = min(h, w) < MIN_CERTAIN_SIZE_PX or v > h or u > w
    if usual_possible and (usual in certain or not (usual_doubtful and certain)):
        return (usual,)
    return certain


def _is_certain(shape: Sequence[int], roles: str) -> bool:
    """Return whether the images are clearly larger than the grid in this order."""
    sizes = {role: [n for n, r in zip(shape, roles, strict=True) if r == role] for role in "ASC"}
    return (
        min(sizes["S"]) >= max(MIN_CERTAIN_SIZE_PX, 2 * max(sizes["A"]))
        and max(sizes["C"], default=1) <= 4
    )


def axis_order(roles: str, *, reverse: bool) -> str:
    """Return the order of the axes by their letters.

    Args:
        roles: One of the orders of :func:`axis_roles`.
        reverse: Whether columns come before rows, as in files that MATLAB writes: it stores the
            last axis first.

    Example:
        >>> axis_order("CSSAA", reverse=True)
        'CWHUV'
    """
    angular, spatial = ("UV", "WH") if reverse else ("VU", "HW")
    return roles.replace("AA", angular).replace("SS", spatial)


def named_axis_order(names: str, shape: Sequence[int]) -> str | None:
    """Return the order of the axes by their names in a file.

    Some programs use v, u for the views and t, s for the pixels, others the reverse. The larger
    pair of axes is taken as that of the pixels.

    Args:
        names: Names of the axes in their order, for instance ``"v:u:t:s"`` or ``"v,u,y,x,c"``.
        shape: Sizes of the axes.

    Returns:
        The order in the letters of :func:`axis_order`; None if the names are unknown.

    Example:
        >>> named_axis_order("t:s:v:u:c", (9, 9, 64, 80, 3))
        'VUHWC'
    """
    letters = [word[0] for word in re.findall(r"[a-z]+", names.lower())]
    size = dict(zip(letters, shape, strict=False))
    pairs = [pair for pair in ("vu", "ts", "yx", "hw", "ij", "kl") if set(pair) <= set(size)]
    colour = [letter for letter in letters if letter not in "".join(pairs)]
    if len(pairs) != 2 or len(size) != len(shape) or len(letters) != len(shape) or len(colour) > 1:
        return None
    angular, spatial = sorted(pairs, key=lambda pair: size[pair[0]] * size[pair[1]])
    meaning = dict(zip(angular + spatial + "".join(colour), "VUHWC", strict=False))
    return "".join(meaning[letter] for letter in letters)


def to_usual_order(array: np.ndarray, order: str) -> np.ndarray:
    """Return an array of this order as ``[V, U, H, W]`` or ``[V, U, H, W, C]``."""
    return array.transpose([order.index(letter) for letter in "VUHWC" if letter in order])


def unstacked(array: np.ndarray, grid: tuple[int, int] | None) -> np.ndarray:
    """Return a stack of views ``[V * U, H, W]`` or ``[V * U, H, W, C]`` as a grid of them.

    Args:
        array: Array of any shape; one that is no stack of this many views is returned as it is.
        grid: ``(V, U)``, views counted row by row; None to leave the array as it is.

    Example:
        >>> unstacked(np.zeros((6, 16, 24, 3)), (2, 3)).shape
        (2, 3, 16, 24, 3)
    """
    colours = array.shape[3:] or (1,)
    if grid is None or array.ndim not in (3, 4) or colours[0] > 4:
        return array
    return array.reshape(*grid, *array.shape[1:]) if len(array) == grid[0] * grid[1] else array
