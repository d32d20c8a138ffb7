"""Choice of the disparity range, and notes if it was too narrow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occjax.errors import InputError
from occjax.estimators.protocol import DisparityRange
from occjax.layout import disparity_range_of
from occjax.lightfield import LightField


@dataclass(frozen=True)
class LimitConfig:
    """Thresholds by which a searched range counts as too narrow.

    Attributes:
        margin: Margin, as a fraction of the range, within which a disparity counts as at its limit.
        max_fraction: Fraction of the pixels at a limit above which the range was too narrow.
            Sufficient ranges have at most 0.003, insufficient ones 0.12 and more.
    """

    margin: float = 0.001
    max_fraction: float = 0.1


def choose_range(
    light_field: LightField, requested: DisparityRange | None
) -> tuple[DisparityRange, tuple[str, ...]]:
    """Return the range to search, and notes on where it comes from.

    Args:
        light_field: Light field; its own range is used if none is requested. If it has none, the
            range is measured.
        requested: Range that the user requested, or None.

    Raises:
        InputError: If the requested range is not a range.
    """
    if requested is None:
        disparity_range, notes = disparity_range_of(light_field)
        return disparity_range, tuple(notes)
    return check_range(requested), ()


def check_range(requested: DisparityRange) -> DisparityRange:
    """Return the range that the user requested, as two floats.

    Args:
        requested: ``(minimum, maximum)``, pixels per view step.

    Raises:
        InputError: If it is not two finite numbers, the smaller one first.
    """
    name = "disparity_range (--disparity-range)"
    try:
        low, high = (float(bound) for bound in requested)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} needs two numbers, not {requested!r}") from error
    if not (np.isfinite([low, high]).all() and low + 1e-3 <= high):
        raise InputError(f"{name} needs minimum < maximum, not {low:g} {high:g}")
    return low, high


def notes_on_limits(
    disparity: np.ndarray,
    confidence: np.ndarray,
    disparity_range: DisparityRange,
    config: LimitConfig = LimitConfig(),
) -> list[str]:
    """Return notes for the user if many disparities are at a limit of the searched range.

    Pixels of confidence 0 do not count as at a limit: nothing was measured there, so a wider range
    would not help.

    Args:
        disparity: ``[H, W]`` disparity, pixels per view step.
        confidence: ``[H, W]`` confidence in [0, 1].
        disparity_range: Range that was searched.
        config: Thresholds.
    """
    low, high = disparity_range
    margin = config.margin * (high - low)
    notes = []
    for end, at_limit in (
        ("lower", disparity <= low + margin),
        ("upper", disparity >= high - margin),
    ):
        fraction = float(np.mean(at_limit & (confidence != 0)))
        if fraction > config.max_fraction:
            notes.append(
                f"{fraction:.0%} of the disparities are at the {end} limit of the searched range "
                f"[{low:.2f}, {high:.2f}]; the range is probably too narrow, pass a wider "
                "disparity_range (--disparity-range), or a larger max_disparity (--max-disparity) "
                "to load, which then measures the range"
            )
    return notes
