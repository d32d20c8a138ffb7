"""A light field made ready for a model: views, candidates to search, what to tell the user."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from occjax.data.views import chosen_views
from occjax.errors import InputError
from occjax.io import Orientation, check
from occjax.lightfield import LightField, to_grey
from occjax.models import PRESETS, NetworkConfig
from occjax.models.config import of_kind
from occjax.ops import view_offsets

INTERVAL = 0.1
"""Spacing of the photometric candidates, in pixels per view step."""

MOST_CANDIDATES = 1024
"""A range that needs more is a mistake: the scene would move by hundreds of pixels."""


class Ready(NamedTuple):
    """What a model is called with.

    Attributes:
        arguments: Arrays; what depends on the light field. The views come first.
        searched: ``(minimum, maximum)`` disparity that is searched, pixels per view step.
        notes: Sentences the user should hear.
        looked_at: Numbers of the views among the arguments, row by row in the light field; None if
            they are those of a grid.
    """

    arguments: tuple[Any, ...]
    searched: tuple[float, float]
    notes: list[str]
    looked_at: np.ndarray | None = None


def for_photometric(light_field: LightField, asked: tuple[float, float] | None) -> Ready:
    """Views in colour, candidates, offsets.

    Args:
        light_field: Views and what is known about them.
        asked: Range the user wants searched, or None.

    Raises:
        InputError: If the range is too wide.
    """
    (low, high), notes = choose_range(light_field, asked)
    _check_width(light_field, low, high, INTERVAL)
    # A multiple of eight candidates: scenes of similar range then share a compilation.
    number = 8 * int(np.ceil(((high - low) / INTERVAL + 1) / 8))
    candidates = np.linspace(low, high, number, dtype=np.float32)
    return Ready((light_field.floating(), candidates, _positions(light_field)), (low, high), notes)


def for_any_views(
    light_field: LightField, asked: tuple[float, float] | None, config: NetworkConfig
) -> Ready:
    """Grey views that are looked at, candidates at the network's interval, offsets, bounds.

    Of a grid the network looks at the two outermost views in each of the eight directions along the
    centre view's row, column and diagonals, as in training.

    Args:
        light_field: Views and what is known about them.
        asked: Range the user wants searched, or None.
        config: A network of any arrangement of views.

    Raises:
        InputError: If there is but one view, or the range is too wide.
    """
    (low, high), notes = choose_range(light_field, asked)
    places = np.asarray(view_offsets(*light_field.grid))
    positions = _positions(light_field)
    offsets = places if positions is None else positions
    looked_at = chosen_views(places.reshape(-1, 2), "outer_star" if positions is None else "all")
    farthest = float(np.abs(offsets).max())
    if farthest == 0:
        raise InputError(
            f"{light_field.name}: one view has no disparity; give a grid of at least 1x2 views"
        )
    learned = config.stages[0].candidates
    interval = (learned[1] - learned[0]) * config.reach / farthest
    _check_width(light_field, low, high, interval)
    # One more on each side, so that the ends of the range have neighbours too; a multiple of four,
    # so that scenes of similar range share a compilation.
    wanted = int(np.ceil((high - low) / interval)) + 3
    number = 4 * -(-wanted // 4)
    candidates = (low + high) / 2 + interval * (np.arange(number) - (number - 1) / 2)
    # What was asked for binds; what was found by photo-consistency may fall a little short.
    limits = (float(candidates[0]), float(candidates[-1])) if asked is None else (low, high)
    bounds = np.array(limits, np.float32)
    # Of many views most are not looked at, and making them all grey takes time.
    images = light_field.views.reshape(-1, *light_field.views.shape[2:])[looked_at]
    grey = np.stack([to_grey(image) for image in images])[None]
    offsets = offsets.reshape(1, -1, 2)[:, looked_at]
    return Ready((grey, candidates.astype(np.float32), offsets, bounds), limits, notes, looked_at)


def for_grid(
    light_field: LightField, asked: tuple[float, float] | None, config: NetworkConfig
) -> Ready:
    """Grey views of the network's grid, its candidates, the ground truth if it needs it.

    Args:
        light_field: Views and what is known about them.
        asked: Range the user wants searched, or None.
        config: A network of a fixed grid.

    Raises:
        InputError: If the light field has too few views, or the range is wider than the network's.
    """
    light_field, notes = _crop(light_field, of_kind(config.views, tuple))
    if light_field.positions is not None:
        notes.append("the views' irregular positions are ignored: the network assumes a grid")
    candidates = np.asarray(config.stages[0].candidates, np.float32)
    wanted = asked or light_field.disparity_range
    covered = (float(candidates[0]), float(candidates[-1]))
    if wanted is not None and not (covered[0] <= wanted[0] and wanted[1] <= covered[1]):
        candidates = candidates + np.float32((sum(wanted) - sum(covered)) / 2)
        covered = (float(candidates[0]), float(candidates[-1]))
        notes.append(f"candidates moved to [{covered[0]:.2f}, {covered[1]:.2f}]")
    if wanted is not None and wanted[1] - wanted[0] > covered[1] - covered[0] + 1e-6:
        message = (
            f"the network covers {covered[1] - covered[0]:g} pixels of disparity, less than "
            f"the range [{wanted[0]:g}, {wanted[1]:g}]"
        )
        if asked is not None:
            raise InputError(f"{message}; the photometric model takes any range")
        notes.append(message)
    truth = None
    if any(stage.occlusion == "ground_truth" for stage in config.stages):
        truth = light_field.ground_truth
        if truth is None:
            raise InputError(
                f"{light_field.name}: this network takes occlusion maps from the ground truth, "
                "and there is none"
            )
    return Ready((light_field.grey(), candidates, truth), covered, notes)


def choose_range(
    light_field: LightField, asked: tuple[float, float] | None
) -> tuple[tuple[float, float], list[str]]:
    """The range to search: what the user asks, what the light field says, or what it shows."""
    if asked is not None:
        return (float(asked[0]), float(asked[1])), []
    if light_field.disparity_range is not None:
        return light_field.disparity_range, []
    report = check(light_field)
    low, high = report.disparity_range
    if report.best == Orientation().reversed_sign:  # but it is used as declared
        low, high = -high, -low
    if not report.measured:
        note = (
            f"no texture to measure the disparity range from; [{low:.2f}, {high:.2f}] is searched"
        )
    else:
        note = (
            f"disparity range [{low:.2f}, {high:.2f}] found by photo-consistency in "
            f"{report.measured:.0%} of the pixels"
        )
    return (low, high), [note]


def check_range(disparity_range: tuple[float, float]) -> None:
    """Refuse what is no range."""
    try:
        low, high = (float(bound) for bound in disparity_range)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"the disparity range needs two numbers, not {disparity_range!r}"
        ) from error
    if not (np.isfinite([low, high]).all() and low + 1e-3 <= high):
        raise InputError(f"the disparity range needs minimum < maximum, not {low} {high}")


def _check_width(light_field: LightField, low: float, high: float, interval: float) -> None:
    if (high - low) / interval > MOST_CANDIDATES:
        raise InputError(
            f"{light_field.name}: the disparity range [{low:g}, {high:g}] is too wide; "
            f"at most {MOST_CANDIDATES * interval:g} pixels per view step can be searched"
        )


def _positions(light_field: LightField) -> np.ndarray | None:
    """Offsets of views that do not stand on a grid."""
    positions = light_field.positions
    return None if positions is None else np.asarray(positions, np.float32)


def _crop(light_field: LightField, views: tuple[int, int]) -> tuple[LightField, list[str]]:
    """The central views a network takes."""
    grid = light_field.grid
    if grid == views:
        return light_field, []
    if grid[0] < views[0] or grid[1] < views[1]:
        fitting = [
            name
            for name, config in PRESETS.items()
            if config.views is None or (config.views[0] <= grid[0] and config.views[1] <= grid[1])
        ]
        raise InputError(
            f"{light_field.name}: has {grid[0]}x{grid[1]} views, the network takes "
            f"{views[0]}x{views[1]}; use one of {', '.join(('photometric', *fitting))}"
        )
    note = f"the central {views[0]}x{views[1]} of {grid[0]}x{grid[1]} views are used"
    return light_field.central(*views), [note]
