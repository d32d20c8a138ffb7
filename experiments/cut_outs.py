"""Small light fields to try the scripts on."""

from __future__ import annotations

import dataclasses

import numpy as np

from occjax.errors import InputError
from occjax.lightfield import LightField


def cut_out(
    light_field: LightField, size: int, corner: tuple[int, int] | None = None
) -> LightField:
    """A square of a light field's pixels.

    Args:
        light_field: The whole.
        size: Side of the square, in pixels; cut off where the views end.
        corner: ``(row, column)`` of its upper left pixel; by default it is in the middle.

    Returns:
        The same light field with fewer pixels, and without the calibration of the whole sensor.

    Raises:
        InputError: If it would have no pixels.

    Example:
        >>> whole = LightField(np.zeros((3, 3, 8, 9, 1), np.uint8))
        >>> cut_out(whole, 4).image_size
        (4, 4)
    """
    if size < 1:
        raise InputError(f"a cut-out of {size} pixels has none; its side must be 1 or more")
    top, left = corner or [max(0, (length - size) // 2) for length in light_field.image_size]
    inner = np.s_[top : top + size, left : left + size]
    truth = light_field.ground_truth
    return dataclasses.replace(
        light_field,
        views=light_field.views[:, :, *inner],
        ground_truth=None if truth is None else truth[inner],
        calibration=None,
    )
