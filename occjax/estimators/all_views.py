"""Disparity of all views, checked against each other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from occjax import programs
from occjax.errors import InputError
from occjax.estimators.driver import run_estimator, with_report
from occjax.estimators.phases import Phase, ReportPhase
from occjax.estimators.protocol import DisparityRange, Estimator, ViewMaps
from occjax.layout import check, registered
from occjax.lightfield import LightField, centre_index, project


@dataclass(frozen=True)
class CrossViewConfig:
    """Settings of the comparison of the views.

    Attributes:
        tolerance: Largest difference of disparities that agree, as a fraction of the searched
            range.
        radius: Largest distance of views that are compared, in rows and in columns of the grid.
        min_consistency: Consistency below which a pixel is filled from other views.
        min_confidence: Confidence that a pixel needs to fill another view.
    """

    tolerance: float = 0.02
    radius: int = 2
    min_consistency: float = 0.5
    min_confidence: float = 0.5


def estimate_all_views(
    estimator: Estimator,
    light_field: LightField,
    *,
    disparity_range: DisparityRange | None = None,
    config: CrossViewConfig = CrossViewConfig(),
    report_phase: ReportPhase = lambda phase: None,
) -> ViewMaps:
    """Estimate the disparity of every view and compare the maps with each other.

    View order, brightness and disparity range are measured once. Only disparity and confidence of
    each view are kept.

    A pixel that the other views contradict, or that none confirms, takes the largest disparity (the
    foreground) of which a neighbouring view or the centre view is certain there. It keeps its
    confidence.

    Args:
        estimator: From :func:`make_estimator`, or any :class:`Estimator`.
        light_field: Light field.
        disparity_range: ``(minimum, maximum)`` to search, in pixels per view step.
        config: Settings of the comparison.
        report_phase: Function that is called when a phase begins.

    Returns:
        Disparity, confidence and consistency of all views.

    Raises:
        InputError: If the light field does not fit the estimator, or has only one view.

    Example:
        >>> from occjax.data.bundled_sample import sample
        >>> from occjax.estimators import make_estimator
        >>> views = sample().views[4:5, 4:6, :48, :48]
        >>> small = LightField(views, disparity_range=(-1.0, 1.0))
        >>> maps = estimate_all_views(make_estimator("photometric"), small)
        >>> maps.disparity.shape
        (1, 2, 48, 48)
    """
    if light_field.grid == (1, 1):
        raise InputError(f"{light_field.name}: has one view; disparity needs at least two")
    light_field = with_report(light_field)
    usable = check(light_field).brightness.usable
    shape = (*light_field.grid, *light_field.image_size)
    disparity, confidence = np.full(shape, np.nan, np.float32), np.zeros(shape, np.float32)
    # From the centre view outwards: views at the same distance have the same number of candidates,
    # so they use the same program one after the other.
    centre = centre_index(usable.shape)
    indices = sorted(
        ((int(v), int(u)) for v, u in np.argwhere(usable)),
        key=lambda view: int(np.abs(np.subtract(view, centre)).max()),
    )
    searched: list[DisparityRange] = []
    for number, view in enumerate(indices, 1):

        def report(phase: str, number: int = number) -> None:
            report_phase(f"view {number} of {len(indices)}, {phase}")

        estimate = run_estimator(
            estimator,
            light_field.around(view),
            disparity_range=disparity_range,
            report_phase=report,
        )
        disparity[view], confidence[view] = estimate.disparity, estimate.confidence
        searched.append(estimate.disparity_range)
    report_phase(Phase.COMPARING_VIEWS)
    low, high = min(low for low, _ in searched), max(high for _, high in searched)
    tolerance = config.tolerance * (high - low)
    # Of the registration, the positions are used and the shifts are not: the map of each view has
    # the pixels of the view as it is stored.
    offsets = registered(light_field)[0].offsets.astype(np.float32)

    def compare() -> Iterator[np.ndarray]:
        """Return how many views agree with each pixel, and its consistency; 0 without a map."""
        known = np.isfinite(disparity)
        maps = np.where(known, disparity, np.float32(0.0))
        counts = _counts(maps, np.float32(tolerance), offsets, usable, radius=config.radius)
        return (known * np.asarray(count) for count in counts)

    agreeing, consistency = compare()
    sources = (consistency >= config.min_consistency) & (confidence >= config.min_confidence)
    filled = _fill(disparity, sources, consistency < config.min_consistency, offsets, usable)
    if filled.any():
        agreeing, consistency = compare()
    return ViewMaps(disparity, confidence, consistency, agreeing, filled, offsets, tolerance)


def _fill(
    disparity: np.ndarray,
    sources: np.ndarray,
    uncertain: np.ndarray,
    offsets: np.ndarray,
    usable: np.ndarray,
) -> np.ndarray:
    """Replace uncertain disparities, in place, by those of other views.

    Args:
        disparity: ``[V, U, H, W]`` maps, which are changed.
        sources: ``[V, U, H, W]`` pixels that may fill others.
        uncertain: ``[V, U, H, W]`` pixels to fill.
        offsets: ``[V, U, 2]`` offset of each view.
        usable: ``[V, U]`` views that have a map.

    Returns:
        ``[V, U, H, W]`` pixels that were filled.
    """
    source = np.where(sources, disparity, np.nan)
    filled = np.zeros(disparity.shape, bool)
    centre = centre_index(usable.shape)
    for view in map(tuple, np.argwhere(usable)):
        foreground = np.full(disparity.shape[2:], -np.inf, np.float32)
        for other in map(tuple, np.argwhere(usable)):
            adjacent = np.abs(np.subtract(other, view)).max() == 1
            if adjacent or (other == centre and other != view):
                _splat(foreground, source[other], offsets[view] - offsets[other])
        filled[view] = uncertain[view] & np.isfinite(foreground)
        disparity[view][filled[view]] = foreground[filled[view]]
    return filled


def _splat(target: np.ndarray, disparity: np.ndarray, offset: np.ndarray) -> None:
    """Project a map into a view and keep the largest disparity of each pixel of ``target``."""
    height, width = target.shape
    y, x = np.nonzero(np.isfinite(disparity))
    d = disparity[y, x]
    row, column = (np.rint(place).astype(np.int64) for place in project(y, x, d, offset))
    inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    np.maximum.at(target, (row[inside], column[inside]), d[inside])


@programs.kept
def _counts(disparity, tolerance, offsets, usable, *, radius):
    from occjax.ops import cross_view_counts

    counts = cross_view_counts(
        disparity, tolerance=tolerance, radius=radius, offsets=offsets, usable=usable
    )
    return counts.agreeing, counts.consistency
