"""Is the grid of views the right way round, and what disparities does the scene have?

A grid whose rows and columns are swapped, or that runs backwards, still loads and still gives a
disparity map, only a wrong one. :func:`check` finds out from the images alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from occjax.errors import InputError
from occjax.io.measurement import ENOUGH, NOISE, Measurement, measure
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

SURE_OF_SIGN = 0.8
"""Share of collisions from which the occlusion order settles the sign of disparity.

Near views and noise make foreground bleed into background, which votes for the wrong side: real 3x3
crops come down to 0.35 for the right sign.
"""

LITTLE_TEXTURE, WELL_MEASURED, MOVED = 0.1, 0.85, 0.3
"""Share of textured pixels below which, and of measured pixels and disparity in pixels from which,
it says something that all layouts are alike.
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
        best: The layout that is right, to be applied to the light field as it is now; the one as
            it is now unless the report is conclusive.
        conclusive: Whether one layout, up to the sign of disparity, is clearly better than the
            others. If not, the views have no texture or no disparity, or fit together in no
            layout: the grid or the arrangement of a mosaic may be wrong.
        clearly_worse: Whether the light field as it is now is wrong beyond doubt.
        nearer_in_front: Under ``best``, the share of occlusions in which the surface of larger
            disparity is in front: near 1 if the sign is right; None if there are too few to say.
        sign_known: Whether the occlusions settle the sign. If not, ``best`` and
            ``best.reversed_sign`` are equally likely, and ``best`` is the one closer to the light
            field as it is now.
        disparity_range: Disparities of the scene under ``best``, with a small margin, in pixels per
            view step; (-4, 4) if nothing could be measured.
        measured: Share of the pixels that the range is taken from; 0 if there is no texture
            or no more is measured than noise feigns.
        fits: Whether the views may belong together. False if they are textured but agree in no
            layout more than in the others: noise, or a mosaic taken apart wrongly.
    """

    scores: dict[str, float]
    best: Orientation
    conclusive: bool
    clearly_worse: bool
    nearer_in_front: float | None
    sign_known: bool
    disparity_range: tuple[float, float]
    measured: float
    fits: bool


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
        raise InputError(f"{light_field.name}: has one view; disparity needs at least two")
    far_and_wide = cross(light_field, COARSE_SIZE)
    if far_and_wide.reach == 0.0:
        raise InputError(f"{light_field.name}: all positions are the same; give where cameras were")
    largest = min(light_field.image_size) * min(
        LARGEST_MOTION / far_and_wide.reach, LARGEST_DISPARITY
    )
    coarse = CostVolumes(far_and_wide, _candidates(far_and_wide, largest, 65))
    rough = measure(coarse, _most_consistent(coarse))

    detailed = cross(light_field, FINE_SIZE)
    if rough.measured >= ENOUGH and detailed.scale < far_and_wide.scale:
        largest = min(largest, 1.25 * float(np.abs(rough.extremes).max()) + coarse.step)
    fine = CostVolumes(detailed, _candidates(detailed, largest, 65))
    scores = {orientation: _score(fine, orientation) for orientation in ORIENTATIONS}
    best = _most_consistent(fine)
    best, front, sign_known = _settle_sign(detailed, measure(fine, best).disparity, best)
    measurement = measure(fine, best)

    one_stands_out, all_alike = _compare(scores, light_field.grid)
    conclusive = one_stands_out and not measurement.nothing
    if not conclusive and best != Orientation():  # no reason to doubt what is declared
        best, front, sign_known = Orientation(), None, False
        measurement = measure(fine, best)
    otherwise = _clearly_above(scores[Orientation()], scores[best])
    only_the_sign = best == Orientation().reversed_sign and sign_known
    return OrientationReport(
        scores={o.name: score * detailed.brightness for o, score in scores.items()},
        best=best,
        conclusive=conclusive,
        clearly_worse=conclusive and (otherwise or only_the_sign),
        nearer_in_front=front,
        sign_known=sign_known,
        disparity_range=_range(measurement),
        measured=0.0 if measurement.nothing else measurement.measured,
        fits=conclusive or not (all_alike and _jumbled(measurement)),
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
    return best if _clearly_above(declared, right) else Orientation()


def _clearly_above(score: float, best: float) -> bool:
    """Whether a layout of this score is worse than the best beyond doubt."""
    return score > CLEARLY * best and score - best > NOISE


def _compare(scores: dict[Orientation, float], grid: tuple[int, int]) -> tuple[bool, bool]:
    """Whether one layout, up to the sign of disparity, is clearly best; whether all are alike.

    On a grid of one row or column the flip along the missing axis changes nothing.
    """
    kinds = [Orientation(), Orientation(swap=True)]
    if min(grid) > 1:
        kinds += [Orientation(flip_rows=True), Orientation(swap=True, flip_rows=True)]
    ranked = sorted(scores[kind] for kind in kinds)
    return _clearly_above(ranked[1], ranked[0]), not _clearly_above(ranked[-1], ranked[0])


def _jumbled(measurement: Measurement) -> bool:
    """Whether textured views that are alike in all layouts show that they do not belong together.

    Views that are the same or differ by noise alone are alike in all layouts, too.
    """
    if measurement.textured < LITTLE_TEXTURE:
        return False
    if measurement.nothing:
        return True
    low, high = measurement.extremes
    largest = measurement.candidates[-1]
    anything_goes = high - low > 1.6 * largest
    moved = max(-low, high) > MOVED and measurement.measured > WELL_MEASURED
    return bool(anything_goes or moved)


def _settle_sign(
    cross: Cross, disparity: np.ndarray, best: Orientation
) -> tuple[Orientation, float | None, bool]:
    """Choose between the two layouts of a pair by what is in front of what."""
    front = nearer_in_front(cross, disparity, best)
    if front is None or 1 - SURE_OF_SIGN < front < SURE_OF_SIGN:
        return best, front, False
    return (best, front, True) if front >= 0.5 else (best.reversed_sign, 1 - front, True)


def _range(measurement: Measurement) -> tuple[float, float]:
    """The range to search, rounded outwards to a twentieth of a pixel."""
    if measurement.nothing:
        return UNKNOWN_RANGE
    low, high = np.round(measurement.span * 20, 3)  # what rounding errors add is no reason to widen
    return math.floor(low) / 20, math.ceil(high) / 20
