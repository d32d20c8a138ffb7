"""Disparity maps side by side, below their errors with scores in the corner."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from matplotlib.colors import Colormap, Normalize, to_rgb
from matplotlib.figure import Figure

from experiments.figure_panels import Bar, Panel, panel_figure, rgb, shrink_step
from occjax.evaluation import Metrics
from occjax.inference.outputs import compare
from occjax.lightfield import LightField, to_unit_float
from occjax.viz.canvas import TEXT, whole_zoom
from occjax.viz.colour import (
    MISSING,
    NO_VALUE,
    cut_ends,
    disparity_colours,
    disparity_limits,
    limits,
)
from occjax.viz.figures import BAD, DISPARITY_LABEL, ERROR_LABEL, error_picture, error_scale

GOOD_COLOUR, BAD_COLOUR = "#dce9dc", "#b2182b"
"""Colours of a BadPix map."""

BEST, SECOND = "#c00000", "#1f4fc0"
"""Colours of the best and the second best score, as in the paper."""

MANY, SMALLER = 4, 300
"""More maps than this are shown smaller: no side is longer, in pixels."""

Maps = Mapping[str, np.ndarray]
"""Disparity ``[H, W]`` of each method or stage by its name."""


def maps_figure(
    light_field: LightField,
    maps: Maps,
    confidence: np.ndarray | None = None,
    *,
    binary: bool,
    rank: bool = False,
) -> Figure:
    """Disparities side by side in the same colours, and above them their errors, if there is truth.

    Args:
        light_field: The views.
        maps: Disparity by name.
        confidence: ``[H, W]`` in [0, 1] of the last map, to keep wild values out of the range of
            the colours.
        binary: Whether errors are shown as good and bad pixels alone.
        rank: Whether the best and the second best scores have colours.
    """
    truth, last = light_field.ground_truth, list(maps.values())[-1]
    known = confidence is not None or truth is not None
    norm = disparity_limits(last, confidence, truth) if known else limits(*maps.values())
    colours = disparity_colours()
    step = shrink_step(last, *[SMALLER] * (len(maps) > MANY))
    zoom = whole_zoom(last[::step, ::step].shape)
    bar = Bar(norm, colours, DISPARITY_LABEL, cut_ends(norm, *maps.values()))

    def shown(title: str, values: np.ndarray) -> Panel:
        return Panel(title, coloured(values[::step, ::step], norm, colours), zoom)

    centre = Panel("centre view", rgb(to_unit_float(light_field.centre)[::step, ::step]), zoom)
    below = [shown(name, disparity) for name, disparity in maps.items()]
    if truth is None:
        return panel_figure([[centre, *with_bar(below, bar)]])
    corners = score_lines(maps, truth, rank=rank)
    error_norm, error_colours, _ = error_scale(BAD)
    above = []
    for name, disparity in maps.items():
        pair = disparity[::step, ::step], truth[::step, ::step]
        if binary:
            title, picture = f"{name}: BadPix {BAD:g}", badpix_picture(*pair, BAD)
        else:
            title, picture = f"{name}: error", error_picture(*pair, error_norm, error_colours)
        above.append(Panel(title, picture, zoom, corner=corners[name]))
    if not binary:
        above = with_bar(above, Bar(error_norm, error_colours, ERROR_LABEL, "both"))
    rows = [[centre, *above], [shown("ground truth", truth), *with_bar(below, bar)]]
    return panel_figure(rows, f"Red: error above {BAD:g} pixels per view step." if binary else "")


def coloured(values: np.ndarray, norm: Normalize, colours: Colormap) -> np.ndarray:
    """``[H, W, 3]`` colours of a map ``[H, W]``; what is not finite has the colour for it."""
    return colours(norm(np.ma.masked_invalid(values)))[..., :3]


def badpix_picture(disparity: np.ndarray, truth: np.ndarray, threshold: float) -> np.ndarray:
    """Where an estimate is bad: red if it is, pale if not, grey without truth, black without value.

    Args:
        disparity: ``[H, W]`` estimate, pixels per view step.
        truth: ``[H, W]`` true disparity.
        threshold: Error above which a pixel is bad.

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
    picture[~valued] = to_rgb(MISSING)
    picture[~known] = to_rgb(NO_VALUE)
    return picture


def with_bar(panels: Sequence[Panel], bar: Bar) -> list[Panel]:
    """The panels, the last with a colour bar."""
    return [*panels[:-1], replace(panels[-1], bar=bar)]


def score_lines(
    maps: Maps, truth: np.ndarray, *, rank: bool = False
) -> dict[str, list[tuple[str, str]]]:
    """BadPix and MSE of each map in words, with their colours.

    Args:
        maps: Disparity by name.
        truth: ``[H, W]`` true disparity.
        rank: Whether the best scores are red, and blue the second best of more than two.

    Returns:
        By name; nothing for maps that cannot be compared with the truth.

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
    """Each score as it is printed and as words."""
    found = {}
    for threshold in (0.07, 0.03):
        percent = round(metrics.badpix[threshold], 2)
        found[f"BadPix {threshold:g}"] = (percent, f"BadPix {threshold:g}: {percent:.2f} %")
    mse = round(metrics.mse_x100, 3)
    return found | {"MSE": (mse, f"MSE x100: {mse:.3f}")}
