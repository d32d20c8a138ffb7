"""Figures that compare methods: by their scores, and pixel by pixel."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure

from occjax.errors import InputError
from occjax.evaluation.metrics import BAD_PIXEL_THRESHOLD
from occjax.viz.canvas import MARGIN, TEXT, TITLE_HEIGHT, Canvas, whole_zoom
from occjax.viz.colour import NO_VALUE_COLOUR
from occjax.viz.figures import mark_border
from occjax.viz.pictures import error_picture, error_scale

MAX_EQUAL_DIFFERENCE = 0.01
"""Difference up to which two errors count as equal, pixels per view step."""

METHOD_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#222222")
"""Palette of Okabe and Ito, which is distinguishable with colour vision deficiency."""

METHOD_LINES = ("-", "--", ":")
"""Line styles; when all colours are used, they repeat with the next style."""

MAX_MAP_SIZE_PX = 600
"""Longer side of a map above which it is subsampled."""

MIN_RADAR_PX, RADAR_PX_PER_MEASURE = 430, 25
"""Diameter of a radar chart: its minimum, and its size per measure that keeps names apart."""

RADAR_LABEL_PX = 190
"""Width for the names of the measures at each side of a radar chart."""

MAX_CLOSE_LABELS = 12
"""Number of measures above which the top and bottom names move away from their neighbours."""


def radar_figure(
    scores: Mapping[str, Mapping[str, float]], *, title: str = "Scores: smaller is better"
) -> Figure:
    """Draw a radar chart of several methods with one spoke for each measure.

    The centre is 0. The end of a spoke is the worst score of all methods, which is printed there.
    Scores can be compared along each spoke; areas have no meaning.

    Args:
        scores: Scores by method and measure; 0 is the best. Measures that not all methods have are
            omitted.
        title: Line above the chart.

    Raises:
        InputError: If there is no method, or all methods have fewer than three measures in common.
    """
    if not scores:
        raise InputError("a radar chart needs one method or more")
    common = [
        name
        for name in next(iter(scores.values()))
        if all(np.isfinite(values.get(name, np.nan)) for values in scores.values())
    ]
    if len(common) < 3:
        raise InputError(
            f"a radar chart needs three measures that all methods have, not {len(common)}"
        )
    table = np.array([[values[name] for name in common] for values in scores.values()])
    worst = table.max(axis=0)
    shapes = table / np.where(worst > 0.0, worst, 1.0)

    diameter = max(MIN_RADAR_PX, RADAR_PX_PER_MEASURE * len(common))
    away = 24 if len(common) > MAX_CLOSE_LABELS else 0
    top = MARGIN + TITLE_HEIGHT + 40 + away
    below = 50 + away
    legend = 24 * len(scores) + 10
    canvas = Canvas(diameter + 2 * RADAR_LABEL_PX, top + diameter + below + legend)
    canvas.title(title, MARGIN)
    axes = canvas.axes(RADAR_LABEL_PX, top, diameter, diameter, projection="polar")
    angles = 2.0 * np.pi * np.arange(len(common)) / len(common)
    for number, (method, shape) in enumerate(zip(scores, shapes, strict=True)):
        repeats, colour = divmod(number, len(METHOD_COLOURS))
        axes.plot(
            np.append(angles, angles[0]),
            np.append(shape, shape[0]),
            color=METHOD_COLOURS[colour],
            linestyle=METHOD_LINES[repeats % len(METHOD_LINES)],
            marker="o",
            markersize=4,
            linewidth=1.6,
            label=method,
            clip_on=False,
        )
    # The spokes start at the top and run clockwise.
    axes.set_theta_zero_location("N")  # type: ignore[attr-defined]
    axes.set_theta_direction(-1)  # type: ignore[attr-defined]
    axes.set_ylim(0.0, 1.0)
    axes.set_yticks([0.25, 0.5, 0.75, 1.0], labels=[])
    axes.set_xticks(angles, labels=[])
    axes.grid(color="#d5d5d5", linewidth=0.7)
    axes.spines["polar"].set_visible(False)
    for angle, name, value in zip(angles, common, worst, strict=True):
        side, height = np.sin(angle), np.cos(angle)
        pole = abs(side) < 0.1
        axes.text(
            angle,
            1.06 + pole * away / (0.5 * diameter),
            f"{name.replace('_', ' ')}\n{value:.3g}",
            fontsize=8.5,
            color=TEXT,
            ha="center" if pole else "left" if side > 0 else "right",
            va="bottom" if height > 0.97 else "top" if height < -0.97 else "center",
        )
    place = (0.5, -below / diameter)
    axes.legend(loc="upper center", bbox_to_anchor=place, frameon=False, fontsize=9.5)
    return canvas.figure


def pairwise_figure(
    first: np.ndarray,
    second: np.ndarray,
    ground_truth: np.ndarray,
    *,
    names: tuple[str, str] = ("first", "second"),
    bad: float = BAD_PIXEL_THRESHOLD,
    border: int = 0,
) -> Figure:
    """Draw the errors of two estimates and the difference of their absolute errors.

    Pixels where the first estimate is closer to the truth are purple, pixels where the second one
    is are orange. Where only one of them has an estimate, it counts as the better one. Pixels
    without ground truth or without any estimate are grey. The title states the percentage of pixels
    inside the border where each is better by more than 0.01. Maps larger than 600 pixels are
    subsampled.

    Args:
        first: ``[H, W]`` estimate, pixels per view step.
        second: ``[H, W]`` another estimate.
        ground_truth: ``[H, W]`` true disparity.
        names: Names of the two estimates.
        bad: Error above which a pixel is bad; the colours end at three times this error.
        border: Border that the percentages leave out, in pixels; a thin line marks it.

    Raises:
        InputError: If the maps differ in size.
    """
    if not first.shape == second.shape == ground_truth.shape:
        raise InputError(
            f"the maps are {list(first.shape)}, {list(second.shape)} and "
            f"{list(ground_truth.shape)}; compare maps of equal size"
        )
    difference = error_difference(first, second, ground_truth)
    shares = _shares(difference, names, border)
    step = -(-max(difference.shape) // MAX_MAP_SIZE_PX)
    # Subsampling keeps the errors of thin objects; averaging would hide them.
    picked = (one[::step, ::step] for one in (first, second, ground_truth, difference))
    first, second, ground_truth, difference = picked
    norm, colours, ticks = error_scale(bad)
    height, width = difference.shape
    zoom = whole_zoom((height, width))
    panel, gap, bar_room = max(width * zoom, 300), 14, 58
    top = MARGIN + TITLE_HEIGHT
    canvas = Canvas(3 * (panel + gap) - gap + 2 * MARGIN, top + height * zoom + bar_room + MARGIN)
    lefts = [MARGIN + number * (panel + gap) for number in range(3)]
    bar_top = top + height * zoom + 10

    for left, name, estimate in zip(lefts[:2], names, (first, second), strict=True):
        canvas.title(f"Error of {name}", left)
        axes = canvas.image(error_picture(estimate, ground_truth, bad=bad), left, top, zoom)
        mark_border(axes, (height, width), border // step)
    bar = (lefts[0] + 8, bar_top, 2 * panel + gap - 16, 12)
    canvas.bar(norm, colours, "estimate - ground truth", bar, ticks=ticks)

    better = Normalize(-3.0 * bad, 3.0 * bad)
    canvas.title(shares, lefts[2])
    axes = canvas.image(
        np.ma.masked_invalid(np.clip(difference, better.vmin, better.vmax)),
        lefts[2],
        top,
        zoom,
        colours=better_colours(),
        norm=better,
    )
    mark_border(axes, (height, width), border // step)
    bar = (lefts[2] + 8, bar_top, panel - 16, 12)
    label = f"|error of {names[0]}| - |error of {names[1]}|"
    canvas.bar(
        better, better_colours(), label, bar, ticks=[ticks[0], 0.0, ticks[-1]], extend="both"
    )
    return canvas.figure


def error_difference(first: np.ndarray, second: np.ndarray, ground_truth: np.ndarray) -> np.ndarray:
    """Return the absolute error of one estimate minus that of another.

    Args:
        first: ``[H, W]`` estimate, pixels per view step.
        second: ``[H, W]`` another estimate.
        ground_truth: ``[H, W]`` true disparity.

    Returns:
        ``[H, W]`` difference, negative where the first estimate is better. It is infinite where
        only one of them has an estimate, and NaN where both have none or the truth is unknown.

    Example:
        >>> first, second = np.array([[0.1, np.nan]]), np.array([[-0.3, 0.2]])
        >>> error_difference(first, second, np.zeros((1, 2))).round(3).tolist()
        [[-0.2, inf]]
    """
    known = np.isfinite(ground_truth)
    truth = np.where(known, ground_truth, 0.0)
    first_size, second_size = (
        np.where(np.isfinite(one), np.abs(np.where(np.isfinite(one), one, 0.0) - truth), np.inf)
        for one in (first, second)
    )
    known &= np.isfinite(first_size) | np.isfinite(second_size)
    nothing = np.full(known.shape, np.nan)
    return np.subtract(first_size, second_size, out=nothing, where=known)


def _shares(difference: np.ndarray, names: tuple[str, str], border: int) -> str:
    """Return text with the percentage of pixels where each estimate is better."""
    h, w = difference.shape
    inside = difference[border : max(h - border, border), border : max(w - border, border)]
    values = inside[~np.isnan(inside)]
    if not values.size:
        return "No comparable pixels"
    first, second = (np.mean(sign * values > MAX_EQUAL_DIFFERENCE) for sign in (-1.0, 1.0))
    return f"Better: {names[0]} {first:.1%}, {names[1]} {second:.1%}"


def better_colours() -> Colormap:
    """Return purple where the first of two is better, orange where the second is, white between.

    The colours differ from those of errors, so that "better" is not read as "nearer".
    """
    return colormaps["PuOr_r"].with_extremes(bad=NO_VALUE_COLOUR)
