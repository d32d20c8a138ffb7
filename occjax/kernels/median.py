"""Median of 3x3 pixels by a sorting network, which is much faster than a sort.

The reference is NumPy's median over windows.
"""

from __future__ import annotations

import functools
from typing import TypeVar

import numpy as np
from jaxtyping import Array

from occjax.kernels.padding import pad_borders

Image = TypeVar("Image", np.ndarray, Array)


def median_filter(image: Image) -> Image:
    """Compute the median of the 3x3 pixels around each pixel, borders replicated.

    Args:
        image: ``[h, w]`` NumPy or JAX array; the result is of the same kind.

    Returns:
        ``[h, w]`` medians.

    Example:
        >>> float(median_filter(np.pad([[9.0]], 2)).max())
        0.0
    """
    xp = image.__array_namespace__()
    padded = pad_borders(image, (1, 1), (1, 1))
    low, middle, high = _sort_three(padded[:-2], padded[1:-1], padded[2:])
    # Of three sorted columns the median is the median of these three values.
    max_low = functools.reduce(xp.maximum, _column_triple(low))
    median_middle = _sort_three(*_column_triple(middle))[1]
    min_high = functools.reduce(xp.minimum, _column_triple(high))
    return _sort_three(max_low, median_middle, min_high)[1]


def _sort_three(one: Image, two: Image, three: Image) -> tuple[Image, Image, Image]:
    """Sort three arrays element by element in ascending order."""
    xp = one.__array_namespace__()
    one, two = xp.minimum(one, two), xp.maximum(one, two)
    two, three = xp.minimum(two, three), xp.maximum(two, three)
    one, two = xp.minimum(one, two), xp.maximum(one, two)
    return one, two, three


def _column_triple(padded: Image) -> tuple[Image, Image, Image]:
    """Return the left neighbour, the pixel itself and the right neighbour of each column."""
    return padded[:, :-2], padded[:, 1:-1], padded[:, 2:]
