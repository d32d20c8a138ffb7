"""Rows of pictures with a title above and words in the corner, as the paper's figures have them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, Normalize, to_rgb
from matplotlib.figure import Figure

from occjax.viz.canvas import BAR_TEXT, BAR_WIDTH, MARGIN, TEXT, Canvas
from occjax.viz.colour import MISSING, NO_VALUE

LINE, GAP = 22, 12
LETTER = 7
"""Width of a letter of a title, in pixels."""
LARGEST = 600
"""Longer side of a map, in pixels, beyond which it is shown smaller."""

GOOD, BAD = "#dce9dc", "#b2182b"
"""Colours of a BadPix map."""


@dataclass(frozen=True, eq=False)
class Bar:
    """A colour bar beside the last picture of a row.

    Attributes:
        norm: Its range.
        colours: Its colours.
        label: What it measures.
        cut: Ends with values beyond them: neither, min, max or both.
    """

    norm: Normalize
    colours: Colormap
    label: str
    cut: str = "neither"


@dataclass(frozen=True, eq=False)
class Panel:
    """A picture.

    Attributes:
        title: Line above it.
        pixels: ``[H, W, 3]`` colours in [0, 1].
        zoom: Width and height of each pixel on the sheet.
        corner: Words in its upper left corner.
        bar: Colour bar on its right.
        points: Places to mark, by letter: ``(row, column)``.
    """

    title: str
    pixels: np.ndarray
    zoom: int = 1
    corner: str = ""
    bar: Bar | None = None
    points: Sequence[tuple[str, tuple[int, int]]] = ()

    @property
    def size(self) -> tuple[int, int]:
        """Height and width, with its title and bar."""
        height, width = (length * self.zoom for length in self.pixels.shape[:2])
        room = GAP + BAR_WIDTH + BAR_TEXT if self.bar else 0
        return LINE + height, max(width + room, LETTER * len(self.title))


def panel_figure(rows: Sequence[Sequence[Panel]], note: str = "") -> Figure:
    """Rows of panels.

    Args:
        rows: From top to bottom, each from left to right.
        note: A line at the bottom.

    Returns:
        The figure.
    """
    widths = [sum(panel.size[1] + GAP for panel in row) - GAP for row in rows]
    heights = [max(panel.size[0] for panel in row) for row in rows]
    canvas = Canvas(
        max(*widths, LETTER * len(note)) + 2 * MARGIN,
        sum(heights) + GAP * (len(rows) - 1) + (LINE if note else 0) + 2 * MARGIN,
    )
    top = MARGIN
    for row, height in zip(rows, heights, strict=True):
        left = MARGIN
        for panel in row:
            _draw(canvas, panel, left, top)
            left += panel.size[1] + GAP
        top += height + GAP
    if note:
        _write(canvas, note, MARGIN, top, size=9.0)
    return canvas.figure


def shrink_step(values: np.ndarray) -> int:
    """Every which pixel of ``[H, W, ...]`` is shown, so that a map is at most ``LARGEST`` wide.

    Picked, not averaged: the mean of two sides of an edge is on neither.
    """
    return -(-max(values.shape[:2]) // LARGEST)


def rgb(image: np.ndarray) -> np.ndarray:
    """``[H, W, C]`` image in [0, 1] as ``[H, W, 3]``."""
    return np.broadcast_to(image, (*image.shape[:2], 3))


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
        >>> bool((picture[0, 0] == to_rgb(BAD)).all()), bool((picture[0, 1] == to_rgb(GOOD)).all())
        (True, True)
    """
    known, valued = np.isfinite(truth), np.isfinite(disparity)
    both = known & valued
    error = np.abs(np.where(both, disparity, 0.0) - np.where(both, truth, 0.0))
    picture = np.where((error > threshold)[..., None], to_rgb(BAD), to_rgb(GOOD))
    picture[~valued] = to_rgb(MISSING)
    picture[~known] = to_rgb(NO_VALUE)
    return picture


def _draw(canvas: Canvas, panel: Panel, left: int, top: int) -> None:
    height, width = (length * panel.zoom for length in panel.pixels.shape[:2])
    _write(canvas, panel.title, left, top)
    axes = canvas.image(np.clip(panel.pixels, 0.0, 1.0), left, top + LINE, panel.zoom)
    for letter, place in panel.points:
        _mark(axes, letter, place)
    if panel.corner:
        axes.text(
            *(0.02, 0.98, panel.corner),
            transform=axes.transAxes,
            fontsize=8.5,
            va="top",
            color=TEXT,
            parse_math=False,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 2.5, "alpha": 0.85},
        )
    if panel.bar:
        bar = panel.bar
        rectangle = (left + width + GAP, top + LINE, BAR_WIDTH, height)
        canvas.bar(bar.norm, bar.colours, bar.label, rectangle, cut=bar.cut)


def _mark(axes: Axes, letter: str, place: tuple[int, int]) -> None:
    """A ring around a pixel, and its letter beside it."""
    row, column = place
    axes.plot(column, row, "o", ms=11, mfc="none", mec="white", mew=3.0, clip_on=False)
    axes.plot(column, row, "o", ms=11, mfc="none", mec="#d62728", mew=1.6, clip_on=False)
    axes.annotate(
        letter,
        (column, row),
        xytext=(9, 5),
        textcoords="offset points",
        fontsize=12,
        weight="bold",
        color="#d62728",
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0, "alpha": 0.85},
    )


def _write(canvas: Canvas, text: str, left: int, top: int, *, size: float = 9.5) -> None:
    x, y = left / canvas.size[0], 1.0 - (top + 0.4 * LINE) / canvas.size[1]
    canvas.figure.text(x, y, text, fontsize=size, va="center", color=TEXT, parse_math=False)
