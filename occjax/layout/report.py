"""Report on the view order and the disparity range.

A light field whose rows and columns are swapped, or reversed, still loads and still gives a
disparity map, but a wrong one. :func:`check` detects this from the images alone.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from occjax.errors import InputError
from occjax.layout.brightness import ViewBrightness, view_brightness
from occjax.layout.config import ViewOrderConfig
from occjax.layout.consistency import CostVolumes, Cross, view_cross
from occjax.layout.disorder import Disorder, is_serpentine, recentred
from occjax.layout.disparity_range import DisparityMeasurement, measure_disparity
from occjax.layout.filters import box_mean
from occjax.layout.occlusion_order import nearer_in_front
from occjax.layout.orientation import ORIENTATIONS, Orientation
from occjax.layout.registration import Registration, register
from occjax.layout.spacing import column_spacing
from occjax.lightfield import LightField, centre_index, view_offsets

DECLARED = Orientation()
"""The view order of the light field as it is given."""


@dataclass(frozen=True)
class ViewOrderReport:
    """Measurement of the view order and of the disparity range.

    The eight view orders form four pairs. The two view orders of a pair differ only by the sign of
    disparity and are equally consistent. Occlusion tells them apart if the scene has enough of it.

    Attributes:
        scores: Inconsistency of each view order by its name: mean grey difference, in [0, 1],
            between the centre view and the others at the best disparity of each pixel. Lower is
            better.
        best: Orientation that gives the light field the correct view order; the identity unless the
            report is conclusive.
        conclusive: Whether one view order, up to the sign of disparity, is clearly better than the
            others. If not, the views have no texture or no disparity, or are consistent in no
            view order: the grid or the arrangement of a mosaic may be wrong.
        clearly_worse: Whether the given view order is certainly wrong.
        nearer_in_front: Under ``best``, the fraction of occlusions in which the surface of larger
            disparity is in front: near 1 if the sign is correct; None if there are too few.
        sign_known: Whether the occlusions determine the sign. If not, ``best`` and
            ``best.reversed_sign`` are equally likely, and ``best`` is the one closer to the given
            view order.
        disparity_range: Range of the scene under ``best``, with a small margin, in pixels per view
            step; (-4, 4) if nothing could be measured.
        measured_fraction: Fraction of the pixels with a reliable disparity, from which the range is
            computed; 0 if there is no texture, or no more pixels are reliable than in noise.
        plausible: Whether the views can belong to one light field. False if they are textured but
            no view order is more consistent than the others: noise, or a wrongly split mosaic.
        brightness: Gains of the views, and which of them are usable.
        max_disparity: Largest absolute disparity that was searched, in pixels per view step.
        registration: Spacing, shifts and camera positions of the views, if they clearly differ from
            those of a regular, rectified grid. Then everything else was measured after their
            correction.
        relative_spacing: Spacing of the view columns relative to the declared camera positions, if
            the two clearly disagree; nothing is corrected then.
        disorder: Cause of inconsistent views other than the view order: ``"serpentine"`` if every
            second row runs backwards, ``"centre"`` if the centre view is not in its place,
            ``"grid"`` if neither explains why many views are not in their places.
    """

    scores: dict[str, float]
    best: Orientation
    conclusive: bool
    clearly_worse: bool
    nearer_in_front: float | None
    sign_known: bool
    disparity_range: tuple[float, float]
    measured_fraction: float
    plausible: bool
    brightness: ViewBrightness
    max_disparity: float
    registration: Registration | None = None
    relative_spacing: float | None = None
    disorder: Disorder | None = None

    @property
    def position_notes(self) -> tuple[str, ...]:
        """Messages for the user on camera positions that were corrected or do not fit."""
        if self.relative_spacing is not None:
            return (
                "the declared camera positions do not fit the images: the view columns are "
                f"{self.relative_spacing:.3g} times as far apart as declared; correct or leave out "
                "--spacing or the file of the positions",
            )
        notes = () if self.registration is None else self.registration.notes
        if self.disorder == "serpentine":
            advice = "every second row of views runs backwards; pass order (--order serpentine)"
        elif self.disorder == "centre":
            row, column = centre_index(self.brightness.usable.shape)
            advice = (
                f"the centre view ({row}, {column}) is not in its place in the grid; without it "
                "the other views are consistent; exchange its file with the right one"
            )
        elif self.disorder == "grid" and self.registration is not None:
            misplaced = self.registration.misplaced
            rows, columns = misplaced.shape
            advice = (
                f"{misplaced.sum()} of {misplaced.size} views are nearer to another place of the "
                f"{rows}x{columns} grid than to their own; the grid or the order of the views is "
                "probably wrong; pass grid (--grid V U), order (--order) or pattern (--pattern)"
            )
        else:
            return notes
        return (advice, *notes)

    @property
    def at_limit(self) -> bool:
        """Whether the disparity range was measured and ends where the search ended."""
        low, high = self.disparity_range
        return bool(self.measured_fraction) and max(-low, high) >= self.max_disparity

    @property
    def declared_range(self) -> tuple[float, float]:
        """Return the disparity range for the light field as it is now.

        This is ``disparity_range``, negated if ``best`` reverses only the sign of disparity.
        """
        low, high = self.disparity_range
        return (-high, -low) if self.best == DECLARED.reversed_sign else (low, high)

    def around(self, view: tuple[int, int]) -> ViewOrderReport:
        """Return the measurement for the same views around another one.

        Args:
            view: ``(v, u)``, index of the new centre view, see
                :meth:`occjax.lightfield.LightField.around`.
        """
        registration = self.registration
        return dataclasses.replace(
            self,
            brightness=self.brightness.around(view),
            registration=None if registration is None else registration.around(view),
        )


def check(light_field: LightField, config: ViewOrderConfig | None = None) -> ViewOrderReport:
    """Measure which of the eight view orders makes the views consistent.

    Takes about a second for 9x9 views of 512x512. :func:`occjax.load` stores the report in the
    light field; a stored report is returned without a measurement. Grids of one row or column work:
    the two flips along the missing axis change nothing, and a swap shows as motion along the wrong
    image axis.

    Args:
        light_field: At least two views.
        config: Settings of a new measurement; None for the stored report, or the default settings
            if there is none.

    Returns:
        The scores of the eight view orders, the best one, and the disparity range of the scene.

    Raises:
        InputError: If it is an array, if there is only one view, or if all camera positions are
            the same.

    Example:
        >>> columns = np.random.default_rng(0).random(48, np.float32)
        >>> rows = np.random.default_rng(1).random(48, np.float32)
        >>> wall = np.add.outer(rows, columns)[None, ..., None] / 2
        >>> views = np.stack([[np.roll(wall[0], (-v, -u), (0, 1)) for u in (-1, 0, 1)]
        ...                   for v in (-1, 0, 1)])  # disparity 1 everywhere
        >>> check(LightField(views[::-1])).best.name
        'rows flipped'
    """
    if not isinstance(light_field, LightField):
        raise InputError(
            f"light_field must be a LightField, not {type(light_field).__name__}; pass "
            "LightField(views)"
        )
    if config is None and light_field.view_order_report is not None:
        return light_field.view_order_report
    config = ViewOrderConfig() if config is None else config
    measured = _measure(light_field, config)
    report, rejected = _registered_report(light_field, measured, config)
    moved = 0.0 if report.registration is None else report.registration.moved.mean()
    orderly = moved <= config.max_moved_fraction and not rejected
    if (report.conclusive and not report.clearly_worse and orderly) or not report.measured_fraction:
        return report

    if min(light_field.grid) > 1 and light_field.positions is None:
        if is_serpentine(light_field, measured.report.best, config):
            return dataclasses.replace(
                report, disorder="serpentine", best=DECLARED, clearly_worse=False
            )
        report = _report_without_centre(light_field, measured, config) or report
    misplaced = 0.0 if report.registration is None else report.registration.misplaced.mean()
    if report.disorder is None and misplaced > config.max_misplaced_fraction:
        return dataclasses.replace(report, disorder="grid")
    return report


def _report_without_centre(
    light_field: LightField, measured: _Measured, config: ViewOrderConfig
) -> ViewOrderReport | None:
    """Return the report on a light field whose centre view seems not to be in its place, else None.

    A neighbour of the centre view is taken as the centre, and the positions of the other views are
    measured relative to it. They may show that only neighbours of the centre view are misplaced.
    Both neighbours are tried: one may be the view that was exchanged with the centre view.
    """
    parts = [part for axis in (0, 1) if (part := recentred(light_field, axis))]
    others, rest, found = min(
        ((*part, _measure(part[0], config)) for part in parts),
        key=lambda each: each[-1].score,
        default=(light_field, (), measured),
    )
    if measured.score <= config.disorder_ratio * found.score:
        return None
    relative = register(others, found.report.brightness, found.disparity, found.scale, config)
    registration, misplaced = None, True
    if relative is not None and relative.positions is not None:
        moved = np.zeros(light_field.grid, bool)
        moved[rest] = relative.moved
        positions = view_offsets(*light_field.grid)
        neighbour = positions[rest][centre_index(others.grid)]
        positions[moved] = (relative.positions + neighbour)[relative.moved]
        positions = positions - positions[centre_index(light_field.grid)]
        registration = Registration(1.0, positions, None, moved)
        misplaced = bool(moved[centre_index(light_field.grid)])
    return dataclasses.replace(
        found.report,
        brightness=measured.report.brightness,
        registration=registration,
        disorder="centre" if misplaced else None,
    )


def _registered_report(
    light_field: LightField, measured: _Measured, config: ViewOrderConfig
) -> tuple[ViewOrderReport, bool]:
    """Return the report with the measured corrections of the views, if they are clear.

    Also return whether there are corrections that do not make the views more consistent.
    """
    report = measured.report
    if report.best not in (DECLARED, DECLARED.reversed_sign):
        return report, False  # Without the right view order, every view seems to be misplaced.
    spacing = column_spacing(measured.volumes, DECLARED)
    if spacing is not None and light_field.positions is not None:
        return dataclasses.replace(report, relative_spacing=spacing), False
    if not report.measured_fraction:
        return report, False
    if spacing is not None:
        offsets = view_offsets(*light_field.grid, column_spacing=spacing)
        measured = _measure(dataclasses.replace(light_field, positions=offsets), config)
        if not measured.report.measured_fraction:
            return report, False
    registration = register(
        light_field,
        measured.report.brightness,
        measured.disparity,
        measured.scale,
        config,
        spacing,
    )
    if registration is None:
        return report, False
    corrected = _measure(registration.apply(light_field), config)
    # The correction of single views hardly changes the score; that of the spacing must lower it.
    improvement = 0.0 if spacing is None else config.registration.min_improvement
    limit = (1 - improvement) * report.scores[DECLARED.name] + config.noise_floor
    if corrected.score > limit:
        return report, True
    return dataclasses.replace(corrected.report, registration=registration), False


def view_order_scores(light_field: LightField, config: ViewOrderConfig) -> dict[str, float]:
    """Return the ``scores`` of :func:`check` for the views as they are, without registration."""
    return _measure(light_field, config).report.scores


def registered(light_field: LightField) -> tuple[LightField, tuple[str, ...]]:
    """Return the light field with measured positions and undone shifts, and notes on the changes.

    Args:
        light_field: Any light field; it is measured unless it carries its report.

    Returns:
        The light field with ``positions``, and with shifted views moved back, and one note for each
        change. If nothing needs a correction, views and positions are the same objects. The result
        carries its report.

    Example:
        >>> columns = np.random.default_rng(0).random((48, 48), np.float32)
        >>> wall = LightField(np.stack([np.roll(columns, -2 * u, 1) for u in (-1, 0, 1)])[None])
        >>> registered(wall)[1]
        ()
    """
    if light_field.grid == (1, 1):
        return light_field, ()
    report = check(light_field)
    notes = report.position_notes
    if report.registration is not None:
        light_field = report.registration.apply(light_field)
        report = dataclasses.replace(report, registration=None)
    return dataclasses.replace(light_field, view_order_report=report), notes


@dataclass(frozen=True, eq=False)
class _Measured:
    """A report, and what it was computed from.

    Attributes:
        report: The report.
        volumes: Cost volumes of all view orders.
        disparity: ``[h, w]`` disparity of the light field as declared, pixels per view step.
        scale: Pixels of the light field per pixel of ``disparity``.
    """

    report: ViewOrderReport
    volumes: CostVolumes
    disparity: np.ndarray
    scale: int

    @property
    def score(self) -> float:
        """Inconsistency of the views in the order in which they are."""
        return self.report.scores[DECLARED.name]


def _measure(light_field: LightField, config: ViewOrderConfig) -> _Measured:
    """Measure view order and disparity range of the light field as it is."""
    if light_field.grid == (1, 1):
        raise InputError(
            f"{light_field.name}: has one view; disparity needs at least two; check grid and views "
            "(--grid, --views)"
        )
    brightness = view_brightness(light_field, config.brightness)
    config, coarse = _search(light_field, brightness, config)
    rough = measure_disparity(coarse, _most_consistent(_scores(coarse), config))
    largest = float(coarse.candidates[-1])
    fine_cross = view_cross(light_field, brightness, config.fine_size_px, config)
    sufficient = rough.reliable_fraction >= config.sufficient_fraction
    if rough.limits is not None and sufficient and fine_cross.scale < coarse.scale:
        largest = min(largest, 1.25 * float(np.abs(rough.limits).max()) + coarse.step)
    fine = CostVolumes(fine_cross, largest)
    scores = _scores(fine)
    best = _most_consistent(scores, config)
    # A single misplaced view, which only one arm contains, must not decide for another view order.
    if best != DECLARED and any(
        fine.score(DECLARED, arm) <= fine.score(best, arm) for arm in fine.removable_arms
    ):
        best = DECLARED
        scores = {o: max(score, scores[DECLARED]) for o, score in scores.items()}
    measurement = measure_disparity(fine, best)
    front = nearer_in_front(fine_cross, measurement.disparity, best)
    sign_known = front is not None and max(front, 1 - front) >= config.sign_fraction
    if front is not None and sign_known and front < 0.5:
        best, front = best.reversed_sign, 1 - front
        measurement = measure_disparity(fine, best)

    one_stands_out, all_alike = _compare(scores, light_field.grid, config)
    conclusive = one_stands_out and measurement.limits is not None
    if not conclusive and best != DECLARED:  # There is no reason to doubt the declared order.
        best, front, sign_known = DECLARED, None, False
        measurement = measure_disparity(fine, best)
    order_is_wrong = _clearly_worse(scores[DECLARED], scores[best], config)
    sign_is_wrong = best == DECLARED.reversed_sign and sign_known
    report = ViewOrderReport(
        scores={o.name: score * fine_cross.brightness for o, score in scores.items()},
        best=best,
        conclusive=conclusive,
        clearly_worse=conclusive and (order_is_wrong or sign_is_wrong),
        nearer_in_front=front,
        sign_known=sign_known,
        disparity_range=measurement.search_range,
        measured_fraction=measurement.reliable_fraction,
        plausible=conclusive
        or not (all_alike and _is_no_light_field(measurement, fine.candidates[-1], config)),
        brightness=brightness,
        max_disparity=float(coarse.candidates[-1]),
    )
    reversed_sign = best == DECLARED.reversed_sign
    disparity = -measurement.disparity if reversed_sign else measurement.disparity
    known = measurement.limits is not None and best in (DECLARED, DECLARED.reversed_sign)
    if known and not brightness.is_equal:
        refined = view_brightness(light_field, config.brightness, disparity=disparity)
        report = dataclasses.replace(report, brightness=refined)
    return _Measured(report, fine, disparity, fine_cross.scale)


def disparity_range_of(light_field: LightField) -> tuple[tuple[float, float], tuple[str, ...]]:
    """Return the disparity range to search: the declared range, else the measured one.

    Args:
        light_field: At least two views, unless it declares its range.

    Returns:
        ``(minimum, maximum)`` in pixels per view step for the light field as it is now, and notes
        for the user: empty if the light field declares its range, else how the range was found.

    Raises:
        InputError: If the range must be measured and there is only one view, or all camera
            positions are the same.

    Example:
        >>> views = np.zeros((3, 3, 48, 48, 1), np.uint8)
        >>> disparity_range_of(LightField(views, disparity_range=(-1.0, 2.0)))
        ((-1.0, 2.0), ())
        >>> disparity_range_of(LightField(views))[0]
        (-4.0, 4.0)
    """
    if light_field.disparity_range is not None:
        return light_field.disparity_range, ()
    report = check(light_field)
    low, high = report.declared_range
    if not report.measured_fraction:
        note = (
            f"too little texture to measure the disparity range up to {report.max_disparity:.2f}; "
            f"searched [{low:.2f}, {high:.2f}]; pass disparity_range (--disparity-range) or, if "
            "the scene has larger disparities, max_disparity (--max-disparity) to load"
        )
    else:
        note = (
            f"disparity range [{low:.2f}, {high:.2f}] found by photo-consistency in "
            f"{report.measured_fraction:.0%} of the pixels, searched with a margin"
        )
    if report.at_limit:
        note += (
            f"; it ends where the search ended, at {report.max_disparity:.2f}; if the scene has "
            "larger disparities, pass max_disparity (--max-disparity) to load"
        )
    return (low, high), (note,)


def _search(
    light_field: LightField, brightness: ViewBrightness, config: ViewOrderConfig
) -> tuple[ViewOrderConfig, CostVolumes]:
    """Compare small images at the usual disparities, and at larger ones if many pixels need them.

    For large disparities only the nearest views are compared: the others have too little in common
    with the centre view.

    Returns:
        The settings for the final measurement, and the cost volumes.
    """
    size, requested = min(light_field.image_size), config.max_disparity_px
    cross = view_cross(light_field, brightness, config.coarse_size_px, config)
    if cross.reach == 0.0:
        raise InputError(
            f"{light_field.name}: all camera positions are the same; give the true positions"
        )
    usual = size * min(config.max_motion / cross.reach, config.max_disparity)
    if requested is not None and requested <= usual:
        return config, CostVolumes(cross, requested)
    if requested is None and light_field.disparity_range is not None:
        return config, CostVolumes(cross, usual)  # the range is not needed, only the view order
    wide_config = dataclasses.replace(
        config, view_steps=config.view_steps[:1], max_candidates=config.max_wide_candidates
    )
    nearest = view_cross(light_field, brightness, config.coarse_size_px, wide_config)
    wide = CostVolumes(nearest, requested or size * config.max_wide_disparity)
    if requested is not None or _exceed(wide, nearest, usual):
        return wide_config, wide
    return config, CostVolumes(cross, usual)


def _exceed(volumes: CostVolumes, cross: Cross, limit: float) -> bool:
    """Return whether only disparities beyond a limit explain some part of the image.

    They do not if most of those pixels look like another pixel of the centre view at that distance:
    it repeats its own content, as in a wrongly split mosaic.

    Args:
        volumes: Costs of all candidates.
        cross: Views of the volumes.
        limit: Largest absolute disparity, in pixels per view step.
    """
    config, candidates = volumes.config, volumes.candidates
    orientation = _most_consistent(_scores(volumes), config)
    costs = volumes.of(orientation)
    beyond = np.abs(candidates) > limit + volumes.step
    if not beyond.any():
        return False
    best = costs[beyond].argmin(0)
    disparity = candidates[beyond][best].astype(np.float32)
    lowest_within, lowest_beyond = costs[~beyond].min(0), costs[beyond].min(0)
    clear = lowest_beyond < config.clear_minimum * lowest_within
    textured = lowest_within > 4 * config.noise_floor
    smooth = np.abs(disparity - box_mean(disparity, 1)) <= volumes.step
    found = clear & textured & smooth
    if found.mean() <= config.min_fraction_beyond:
        return False
    copies = [
        dataclasses.replace(arm, images=np.stack([cross.centre] * len(arm.images)))
        for arm in cross.arms
    ]
    own_volumes = CostVolumes(dataclasses.replace(cross, arms=tuple(copies)), float(candidates[-1]))
    own_costs = own_volumes.of(orientation)[beyond]
    own_cost = np.take_along_axis(own_costs, best[None], 0)[0]
    unrepeated = own_cost > config.clear_minimum * own_costs.mean(0)
    return bool(unrepeated[found].mean() >= 0.5)


def _scores(volumes: CostVolumes) -> dict[Orientation, float]:
    """Return the mean lowest cost of each view order; the two of a pair have the same."""
    pairs = {o: volumes.score(o) for o in ORIENTATIONS if not o.flip_columns}
    return {o: pairs[o.reversed_sign if o.flip_columns else o] for o in ORIENTATIONS}


def _most_consistent(scores: dict[Orientation, float], config: ViewOrderConfig) -> Orientation:
    """Return the best view order up to the sign; the declared one unless it is clearly worse."""
    best = min((o for o in ORIENTATIONS if not o.flip_columns), key=scores.__getitem__)
    return best if _clearly_worse(scores[DECLARED], scores[best], config) else DECLARED


def _clearly_worse(score: float, best: float, config: ViewOrderConfig) -> bool:
    """Return whether a view order of this score is certainly worse than the best."""
    return score > config.clearly_worse_ratio * best and score - best > config.noise_floor


def _compare(
    scores: dict[Orientation, float], grid: tuple[int, int], config: ViewOrderConfig
) -> tuple[bool, bool]:
    """Return whether one view order, up to the sign, is clearly best, and whether all are equal.

    On a grid of one row or column the flip along the missing axis changes nothing.
    """
    kinds = [DECLARED, Orientation(swap=True)]
    if min(grid) > 1:
        kinds += [Orientation(flip_rows=True), Orientation(swap=True, flip_rows=True)]
    ranked = sorted(scores[kind] for kind in kinds)
    one_stands_out = _clearly_worse(ranked[1], ranked[0], config)
    return one_stands_out, not _clearly_worse(ranked[-1], ranked[0], config)


def _is_no_light_field(
    measurement: DisparityMeasurement, largest: float, config: ViewOrderConfig
) -> bool:
    """Return whether views that are equally consistent in all view orders cannot be a light field.

    Views without texture, copies of one view, and copies with noise are equally consistent too.
    """
    if measurement.textured_fraction < config.min_textured_fraction:
        return False
    if measurement.limits is None:
        return True
    low, high = measurement.limits
    whole_range = high - low > config.wrong_grid_span * largest
    moves = max(-low, high) > config.wrong_grid_disparity
    return bool(
        whole_range or (moves and measurement.reliable_fraction > config.wrong_grid_fraction)
    )
