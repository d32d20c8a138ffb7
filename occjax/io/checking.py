"""Is the grid of views the right way round, and what disparities does the scene have?

A grid whose rows and columns are swapped, or that runs backwards, still loads and still gives a
disparity map, only a wrong one. :func:`check` finds out from the images alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from occjax.errors import InputError
from occjax.io.occlusion_order import nearer_in_front
from occjax.io.orientation import ORIENTATIONS, Orientation
from occjax.io.photoconsistency import CostVolumes, Cross, cross
from occjax.lightfield import LightField

COARSE_SIZE, FINE_SIZE = 96, 256
"""Shorter image side in pixels: to search all disparities, and to measure the range found."""

LARGEST_MOTION, LARGEST_DISPARITY = 0.2, 0.08
"""Largest motion that is searched, of the shorter image side: to an outer view, and per step."""

CLEARLY = 1.15
"""Ratio of two inconsistencies from which one is clearly worse.

Right and wrong layouts of real light fields are 1.4 to 4 apart.
"""

NOISE = 0.05 / 255
"""Inconsistencies closer than this are equal: views without texture agree in any layout."""

SURE_OF_SIGN = 0.8
"""Share of collisions from which the occlusion order settles the sign of disparity.

Near views and noise make foreground bleed into background, which votes for the wrong side: real 3x3
crops come down to 0.35 for the right sign.
"""

UNKNOWN_RANGE = (-4.0, 4.0)
"""What is searched where no disparity can be measured: the range of the published network."""


@dataclass(frozen=True)
class OrientationReport:
    """What the images say about the layout of the grid.

    The eight layouts come in four pairs that differ by the sign of disparity only. The two of a
    pair are equally consistent; occlusion tells them apart where the scene has enough of it.

    Attributes:
        scores: Inconsistency of each layout by its name: mean grey difference, in [0, 1], between
            the centre view and the others at the best disparity of each pixel. Lower is better.
        best: The layout that is right, to be applied to the light field as it is now.
        clearly_worse: Whether the light field as it is now is wrong beyond doubt.
        nearer_in_front: Under ``best``, the share of occlusions in which the surface of larger
            disparity is in front: near 1 if the sign is right; None if there are too few to say.
        sign_known: Whether the occlusions settle the sign. If not, ``best`` and
            ``best.reversed_sign`` are equally likely, and ``best`` is the one closer to the light
            field as it is now.
        disparity_range: Disparities of the scene under ``best``, with a small margin, in pixels per
            view step; (-4, 4) if nothing could be measured.
        measured: Share of the pixels that the range is taken from; 0 if there is no texture.
    """

    scores: dict[str, float]
    best: Orientation
    clearly_worse: bool
    nearer_in_front: float | None
    sign_known: bool
    disparity_range: tuple[float, float]
    measured: float


def check(light_field: LightField) -> OrientationReport:
    """Measure in which of its eight layouts the grid of views is consistent.

    Takes about a second for 9x9 views of 512x512. Grids of one row or column work: the two flips
    along the missing axis change nothing, and the swap shows as motion along the wrong image axis.

    Args:
        light_field: At least two views.

    Returns:
        The scores of the eight layouts, the best one, and the scene's disparity range.

    Raises:
        InputError: If there is only one view.

    Example:
        >>> columns = np.random.default_rng(0).random(80, np.float32)
        >>> rows = np.random.default_rng(1).random(80, np.float32)
        >>> wall = np.add.outer(rows, columns)[None, ..., None] / 2
        >>> views = np.stack([[np.roll(wall[0], (-v, -u), (0, 1)) for u in (-1, 0, 1)]
        ...                   for v in (-1, 0, 1)])  # disparity 1 everywhere
        >>> check(LightField(views[::-1])).best.name
        'rows flipped'
    """
    if light_field.grid == (1, 1):
        raise InputError(f"{light_field.name}: one view has no order to check; give at least two")
    far_and_wide = cross(light_field, COARSE_SIZE)
    largest = min(light_field.image_size) * min(
        LARGEST_MOTION / far_and_wide.reach, LARGEST_DISPARITY
    )
    coarse = CostVolumes(far_and_wide, _candidates(far_and_wide, largest, 65))
    disparity, sure = _measure(coarse, _most_consistent(coarse))

    detailed = cross(light_field, FINE_SIZE)
    spread = np.abs(_enclosing(disparity[sure], 0.0)).max() if sure.any() else 1.0
    fine = CostVolumes(detailed, _candidates(detailed, 1.25 * spread + coarse.step, 65))
    scores = {orientation: _score(fine, orientation) for orientation in ORIENTATIONS}
    best = _most_consistent(fine)
    disparity, sure = _measure(fine, best)
    best, front, sign_known = _settle_sign(detailed, disparity, best)
    disparity, sure = _measure(fine, best)

    declared, right = scores[Orientation()], scores[best]
    inconsistent = declared > CLEARLY * right and declared - right > NOISE
    only_the_sign = best == Orientation().reversed_sign and sign_known
    return OrientationReport(
        scores={orientation.name: score for orientation, score in scores.items()},
        best=best,
        clearly_worse=inconsistent or only_the_sign,
        nearer_in_front=front,
        sign_known=sign_known,
        disparity_range=_range(disparity[sure], fine.step) if sure.any() else UNKNOWN_RANGE,
        measured=float(sure.mean()),
    )


def _candidates(cross: Cross, largest: float, at_most: int) -> np.ndarray:
    """Disparities around zero; neighbours move the outermost view by half a pixel or more."""
    step = max(0.5 * cross.scale / cross.reach, 2 * largest / (at_most - 1))
    count = math.ceil(largest / step)
    return np.arange(-count, count + 1) * step


def _score(volumes: CostVolumes, orientation: Orientation) -> float:
    """Mean over pixels of the cost at the best disparity."""
    return float(volumes.of(orientation).min(0).mean())


def _most_consistent(volumes: CostVolumes) -> Orientation:
    """The best layout up to the sign of disparity; the one as it is now unless clearly worse."""
    one_of_each_pair = [o for o in ORIENTATIONS if not o.flip_columns]
    best = min(one_of_each_pair, key=lambda orientation: _score(volumes, orientation))
    declared, right = _score(volumes, Orientation()), _score(volumes, best)
    clear = declared > CLEARLY * right and declared - right > NOISE
    return best if clear else Orientation()


def _measure(volumes: CostVolumes, orientation: Orientation) -> tuple[np.ndarray, np.ndarray]:
    """``[h, w]`` disparity under a layout, and where its cost stands out from the others'."""
    volume = volumes.of(orientation)
    index = volume.argmin(0)
    lowest = np.take_along_axis(volume, index[None], 0)[0]
    sure = (lowest < 0.5 * volume.mean(0)) & (volume.mean(0) > 4 * NOISE)
    return volumes.candidates[index].astype(np.float32), sure


def _settle_sign(
    cross: Cross, disparity: np.ndarray, best: Orientation
) -> tuple[Orientation, float | None, bool]:
    """Choose between the two layouts of a pair by what is in front of what."""
    front = nearer_in_front(cross, disparity, best)
    if front is None or 1 - SURE_OF_SIGN < front < SURE_OF_SIGN:
        return best, front, False
    return (best, front, True) if front >= 0.5 else (best.reversed_sign, 1 - front, True)


def _enclosing(disparity: np.ndarray, margin: float) -> np.ndarray:
    """Lower and upper end, but for a few outliers."""
    return np.percentile(disparity, [0.3, 99.7]) + np.array([-margin, margin])


def _range(disparity: np.ndarray, step: float) -> tuple[float, float]:
    """The range to search, rounded outwards to a twentieth of a pixel."""
    low, high = _enclosing(disparity, step) * 20
    return math.floor(low) / 20, math.ceil(high) / 20
