"""What the scripts have in common: exit codes, and small light fields to try them on."""

from __future__ import annotations

import dataclasses
import sys
import warnings
from collections.abc import Callable
from typing import NoReturn

import numpy as np

from occjax.cli.estimating import show_warning
from occjax.errors import InputError
from occjax.lightfield import LightField


def exit_with(command: Callable[[], int]) -> NoReturn:
    """Run a command and exit with its code; what the input is at fault for is one line and code 2.

    Args:
        command: Returns the exit code.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("default", UserWarning)
        warnings.showwarning = show_warning
        try:
            code = command()
        except InputError as error:
            print(f"occjax: {error}", file=sys.stderr)
            code = 2
    sys.exit(code)


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
    """
    top, left = corner or [max(0, (length - size) // 2) for length in light_field.image_size]
    inner = np.s_[top : top + size, left : left + size]
    truth = light_field.ground_truth
    return dataclasses.replace(
        light_field,
        views=light_field.views[:, :, *inner],
        ground_truth=None if truth is None else truth[inner],
        calibration=None,
    )
