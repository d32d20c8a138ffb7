"""Small light fields for smoke tests."""

from __future__ import annotations

import dataclasses

import numpy as np

from occjax.data.bundled_sample import sample
from occjax.errors import InputError
from occjax.lightfield import LightField

SMALL_SIZE_PX = 64
"""Height and width of a smoke test's views."""


def cut_out(
    light_field: LightField, size: int, corner: tuple[int, int] | None = None
) -> LightField:
    """Return a square part of all views of a light field.

    Args:
        light_field: The whole light field.
        size: Side of the square, in pixels; the square is clipped at the image border.
        corner: ``(row, column)`` of its upper left pixel; by default the square is centred.

    Returns:
        The part, without the calibration, which describes the whole sensor.

    Raises:
        InputError: If the part has no pixels.

    Example:
        >>> whole = LightField(np.zeros((3, 3, 8, 9, 1), np.uint8))
        >>> cut_out(whole, 4).image_size
        (4, 4)
    """
    if size < 1:
        raise InputError(f"a cut-out of {size} pixels is empty; its side must be 1 or more")
    top, left = corner or [max(0, (length - size) // 2) for length in light_field.image_size]
    inner = np.s_[top : top + size, left : left + size]
    truth = light_field.ground_truth
    return dataclasses.replace(
        light_field,
        views=light_field.views[:, :, *inner],
        ground_truth=None if truth is None else truth[inner],
        calibration=None,
    )


def small_sample(size: int = SMALL_SIZE_PX) -> LightField:
    """Return the central ``size`` x ``size`` pixels of the bundled sample."""
    return cut_out(sample(), size)
