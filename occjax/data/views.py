"""Which views of a light field an estimator is given: all, a star, a crosshair, fewer of them."""

from __future__ import annotations

from typing import Literal, get_args

import jax
import jax.numpy as jnp
import numpy as np

from occjax.data.samples import Sample
from occjax.errors import InputError

Arrangement = Literal["all", "cross", "star", "outer_star"]
"""All views; those of the centre view's row and column; these and those of both diagonals; of these
the two outermost in each of the eight directions, which tell the most about disparity."""

Selection = Arrangement | tuple[int, int]
"""An arrangement, or ``(V, U)``: the views of that many rows and columns around the centre view."""


def select_views(sample: Sample, selection: Selection) -> Sample:
    """The sample with some of its views, the centre view still in the centre.

    Views of a grid are chosen by their place in it, whatever their exact offsets. Views that are a
    list, ``[1, n]``, are chosen by their offsets, which must then be known: not inside ``jax.jit``.

    Args:
        sample: One sample, or a batch of them of one arrangement; NumPy or JAX arrays. A grid may
            have any size, of odd or even numbers of views.
        selection: ``"all"``, ``"cross"`` (row and column of the centre view), ``"star"`` (and both
            diagonals), ``"outer_star"`` (its two outermost views in each direction) or
            ``(V, U)``.

    Returns:
        Views ``[V, U]`` for ``(V, U)`` of a grid, else ``[1, n]``: row by row, but with the centre
        view at ``n // 2``, which changes nothing in a grid of odd size. All other fields follow.

    Raises:
        InputError: If there is no such selection, or the sample does not have its views.

    Example:
        >>> from occjax.ops import view_offsets
        >>> images = jnp.zeros((9, 9, 4, 6))
        >>> known = images == 0
        >>> sample = Sample(images, view_offsets(9, 9), images[4, 4], known, known[4, 4])
        >>> [select_views(sample, some).views.shape[:2] for some in ("star", "outer_star", (3, 5))]
        [(1, 33), (1, 17), (3, 5)]
    """
    _check(selection)
    v, u = sample.views.shape[-4:-2]
    if selection == "all":
        return sample
    if min(v, u) > 1:
        return _of_grid(sample, selection)
    if isinstance(sample.offsets, jax.core.Tracer):
        raise InputError(
            "the views are a list, chosen by offsets that jax.jit hides; select views before it"
        )
    return _of_list(sample, selection)


def _check(selection: Selection) -> None:
    """Whether there is such a selection."""
    if isinstance(selection, str):
        if selection not in get_args(Arrangement):
            raise InputError(
                f'selection is "{selection}"; it must be one of {", ".join(get_args(Arrangement))} '
                "or the numbers (V, U)"
            )
    elif len(selection) != 2 or min(selection) < 1:
        raise InputError(f"selection is {selection}; (V, U) must be two positive numbers")


def _of_grid(sample: Sample, selection: Selection) -> Sample:
    """Views by their row and column in the grid."""
    v, u = sample.views.shape[-4:-2]
    if not isinstance(selection, str):
        rows, columns = selection
        if rows > v or columns > u:
            raise InputError(f"has {v}x{u} views, {rows}x{columns} are needed; select fewer")
        top, left = v // 2 - rows // 2, u // 2 - columns // 2
        inner = np.s_[top : top + rows, left : left + columns]
        return sample._replace(
            views=sample.views[(..., *inner, slice(None), slice(None))],
            offsets=sample.offsets[(..., *inner, slice(None))],
            visibility=sample.visibility[(..., *inner, slice(None), slice(None))],
        )
    row, column = (place.ravel() for place in np.indices((v, u)))
    chosen = chosen_views(np.stack([row - v // 2, column - u // 2], axis=-1), selection)
    row, column = row[chosen][None], column[chosen][None]
    return sample._replace(
        views=sample.views[..., row, column, :, :],
        offsets=sample.offsets[..., row, column, :],
        visibility=sample.visibility[..., row, column, :, :],
    )


def _of_list(sample: Sample, selection: Selection) -> Sample:
    """Views by their offsets, which may come in another order in each sample of a batch."""
    views, visibility = (_as_list(images, 2) for images in (sample.views, sample.visibility))
    offsets = _as_list(sample.offsets, 1)
    whole = np.rint(np.asarray(offsets)).astype(int)
    lead = whole.shape[:-2]
    chosen = [chosen_views(places, selection) for places in whole.reshape(-1, *whole.shape[-2:])]
    if len({len(order) for order in chosen}) != 1:
        raise InputError("the samples of the batch differ in arrangement; select alike ones")
    order = np.stack(chosen).reshape(*lead, 1, -1)
    library = np if isinstance(sample.views, np.ndarray) else jnp

    def taken(values, trailing):
        index = order.reshape(*order.shape, *(1,) * trailing)
        values = values.reshape(*lead, 1, *values.shape[len(lead) :])
        return library.take_along_axis(values, index, axis=len(lead) + 1)

    return sample._replace(
        views=taken(views, 2), offsets=taken(offsets, 1), visibility=taken(visibility, 2)
    )


def _as_list(values, trailing: int):
    """``[..., v, u, *]`` as ``[..., v * u, *]``."""
    lead, rest = values.shape[: -2 - trailing], values.shape[-trailing:]
    return values.reshape(*lead, -1, *rest)


def chosen_views(places: np.ndarray, selection: Selection) -> np.ndarray:
    """Numbers of the views that a selection takes.

    Args:
        places: ``[n, 2]`` whole offsets ``(row, column)`` of the views from the centre view.
        selection: As for :func:`select_views`.

    Returns:
        ``[k]`` int32, row by row, but with the centre view at ``k // 2``.

    Raises:
        InputError: If there are no such views, or not one centre view.

    Example:
        >>> places = np.array([[0, -2], [0, -1], [0, 0], [0, 1]])
        >>> chosen_views(places, "star").tolist()
        [0, 1, 2, 3]
    """
    row, column = places.T
    if selection == "all":
        taken = np.ones(len(places), bool)
    elif isinstance(selection, str):
        taken = (row == 0) | (column == 0)
        if selection != "cross":
            taken |= np.abs(row) == np.abs(column)
        if selection == "outer_star":
            taken &= _further_out(row, column, taken) < 2
    else:
        first = -(np.array(selection) // 2)
        last = first + np.array(selection) - 1
        taken = np.all((places >= first) & (places <= last), axis=-1)
        there = len(np.unique(places[taken], axis=0))
        if there < np.prod(selection):
            raise InputError(
                f"has {there} of the {selection[0]}x{selection[1]} views around the centre; "
                "select others"
            )
    centre = np.flatnonzero((row == 0) & (column == 0))
    if len(centre) != 1:
        raise InputError(f"{len(centre)} views have the offset (0, 0); the centre view alone must")
    others = np.setdiff1d(np.flatnonzero(taken), centre)
    others = others[np.lexsort((column[others], row[others]))]
    return np.insert(others, (len(others) + 1) // 2, centre).astype(np.int32)


def _further_out(row: np.ndarray, column: np.ndarray, counted: np.ndarray) -> np.ndarray:
    """How many of the views that count lie further out in the same of eight directions."""
    distance = np.maximum(np.abs(row), np.abs(column))
    direction = np.stack([np.sign(row), np.sign(column)], axis=-1)
    alike = np.all(direction[:, None] == direction[None], axis=-1)
    further = distance[None] > distance[:, None]
    return (alike & further & counted[None]).sum(axis=1)
