"""Figure of disparity maps side by side, with their errors and scores."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from experiments.figure_panels import Bar, Panel, coloured, panel_figure, rgb, shrink_step
from occjax.evaluation import Metrics
from occjax.evaluation.metrics import BAD_PIXEL_THRESHOLD, compare
from occjax.lightfield import LightField, to_unit_float
from occjax.viz.canvas import TEXT, whole_zoom
from occjax.viz.colour import (
    MISSING_COLOUR,
    NO_VALUE_COLOUR,
    colourbar_extend,
    common_norm,
    disparity_colours,
    disparity_norm,
)
from occjax.viz.figures import DISPARITY_LABEL, ERROR_LABEL
from occjax.viz.pictures import error_picture, error_scale

GOOD_COLOUR, BAD_COLOUR = "#dce9dc", "#b2182b"
"""Colours of good and bad pixels in a BadPix map."""

BEST, SECOND = "#c00000", "#1f4fc0"
"""Colours of the best and the second best score, as in the paper."""

MAX_LARGE_MAPS, SMALL_MAP_SIZE_PX = 4, 300
"""Number of maps above which maps are reduced, and the maximum side of a reduced map."""

Maps = Mapping[str, np.ndarray]
"""``[H, W]`` disparity by the name of a method or stage."""


def maps_figure(
    light_field: LightField,
    maps: Maps,
    confidence: np.ndarray | None = None,
    *,
    binary: bool,
    rank: bool = False,
) -> Figure:
    """Draw disparities in common colours, below their errors if there is ground truth.

    Args:
        light_field: The views.
        maps: Disparity by name.
        confidence: ``[H, W]`` confidence of the last map, in [0, 1]; uncertain outliers are
            excluded from the colour range.
        binary: Draw errors as BadPix maps instead of signed errors.
        rank: Colour the best and the second best scores.
    """
    truth, last = light_field.ground_truth, list(maps.values())[-1]
    known = confidence is not None or truth is not None
    norm = disparity_norm(last, confidence, truth) if known else common_norm(*maps.values())
    colours = disparity_colours()
    step = shrink_step(last, *[SMALL_MAP_SIZE_PX] * (len(maps) > MAX_LARGE_MAPS))
    zoom = whole_zoom(last[::step, ::step].shape)
    bar = Bar(norm, colours, DISPARITY_LABEL, colourbar_extend(norm, *maps.values()))

    def shown(title: str, values: np.ndarray) -> Panel:
        return Panel(title, coloured(values[::step, ::step], norm, colours), zoom)

    centre = Panel("centre view", rgb(to_unit_float(light_field.centre)[::step, ::step]), zoom)
    below = [shown(name, disparity) for name, disparity in maps.items()]
    if truth is None:
        return panel_figure([[centre, *with_bar(below, bar)]])
    corners = score_lines(maps, truth, rank=rank)
    error_norm, error_colours, _ = error_scale()
    above = []
    for name, disparity in maps.items():
        pair = disparity[::step, ::step], truth[::step, ::step]
        if binary:
            title = f"{name}: BadPix {BAD_PIXEL_THRESHOLD:g}"
            picture = badpix_picture(*pair, BAD_PIXEL_THRESHOLD)
        else:
            title, picture = f"{name}: error", error_picture(*pair)
        above.append(Panel(title, picture, zoom, corner=corners[name]))
    if not binary:
        above = with_bar(above, Bar(error_norm, error_colours, ERROR_LABEL, "both"))
    rows = [[centre, *above], [shown("ground truth", truth), *with_bar(below, bar)]]
    legend = f"Red: error above {BAD_PIXEL_THRESHOLD:g} pixels per view step."
    return panel_figure(rows, legend if binary else "")


def badpix_picture(disparity: np.ndarray, truth: np.ndarray, threshold: float) -> np.ndarray:
    """Return a BadPix map: bad red, good pale, without ground truth grey, without estimate black.

    Args:
        disparity: ``[H, W]`` estimate, pixels per view step.
        truth: ``[H, W]`` true disparity.
        threshold: Error above which a pixel is bad, pixels per view step.

    Returns:
        ``[H, W, 3]`` colours in [0, 1].

    Example:
        >>> picture = badpix_picture(np.array([[0.1, 0.0]]), np.zeros((1, 2)), 0.07)
        >>> bool((picture[0, 0] == to_rgb(BAD_COLOUR)).all())
        True
    """
    known, valued = np.isfinite(truth), np.isfinite(disparity)
    both = known & valued
    error = np.abs(np.where(both, disparity, 0.0) - np.where(both, truth, 0.0))
    picture = np.where((error > threshold)[..., None], to_rgb(BAD_COLOUR), to_rgb(GOOD_COLOUR))
    picture[~valued] = to_rgb(MISSING_COLOUR)
    picture[~known] = to_rgb(NO_VALUE_COLOUR)
    return picture


def with_bar(panels: Sequence[Panel], bar: Bar) -> list[Panel]:
    """Return the panels with a colour bar at the last one."""
    return [*panels[:-1], replace(panels[-1], bar=bar)]


def score_lines(
    maps: Maps, truth: np.ndarray, *, rank: bool = False
) -> dict[str, list[tuple[str, str]]]:
    """Return text lines with the BadPix and MSE of each map, and their colours.

    Args:
        maps: Disparity by name.
        truth: ``[H, W]`` true disparity.
        rank: Colour the best scores red, and of more than two the second best blue.

    Returns:
        Lines and colours by name; no lines for maps without any comparable pixel.

    Example:
        >>> score_lines({"good": np.zeros((4, 4))}, np.zeros((4, 4)))["good"][0][0]
        'BadPix 0.07: 0.00 %'
    """
    metrics = {name: compare(disparity, truth) for name, disparity in maps.items()}
    scores = {name: _scores(one) for name, one in metrics.items() if one is not None}
    lines: dict[str, list[tuple[str, str]]] = {name: [] for name in maps}
    for name, own in scores.items():
        for measure, (value, words) in own.items():
            order = sorted({others[measure][0] for others in scores.values()})
            place = order.index(value) if rank and len(scores) > 1 else None
            colour = BEST if place == 0 else SECOND if place == 1 and len(scores) > 2 else TEXT
            lines[name].append((words, colour))
    return lines


def _scores(metrics: Metrics) -> dict[str, tuple[float, str]]:
    """Return each score as a rounded number and as text."""
    found = {}
    for threshold in (0.07, 0.03):
        percent = round(metrics.badpix[threshold], 2)
        found[f"BadPix {threshold:g}"] = (percent, f"BadPix {threshold:g}: {percent:.2f} %")
    mse = round(metrics.mse_x100, 3)
    return found | {"MSE": (mse, f"MSE x100: {mse:.3f}")}
