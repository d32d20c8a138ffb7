"""Rows of pictures with a title above and words in the corner, as the paper's figures have them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure

from occjax.viz.canvas import BAR_TEXT, BAR_WIDTH, MARGIN, TEXT, Canvas

LINE, GAP = 22, 12
LETTER = 7
"""Width of a letter of a title, in pixels."""

MARK, FRAME = "#d62728", "#2b6fd6"
"""Colours of marked points and of frames."""


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
        corner: Lines in its upper left corner, each with its colour.
        bar: Colour bar on its right.
        points: Places to mark, by letter: ``(row, column)``.
        framed: ``[H, W]`` booleans; a blue line goes around those that are set.
    """

    title: str
    pixels: np.ndarray
    zoom: int = 1
    corner: Sequence[tuple[str, str]] = ()
    bar: Bar | None = None
    points: Sequence[tuple[str, tuple[int, int]]] = ()
    framed: np.ndarray | None = None

    @property
    def size(self) -> tuple[int, int]:
        """Height and width, with its title and bar."""
        height, width = (length * self.zoom for length in self.pixels.shape[:2])
        room = GAP + BAR_WIDTH + BAR_TEXT if self.bar else 0
        return LINE + height, max(width + room, LETTER * len(self.title))


def panel_figure(
    rows: Sequence[Sequence[Panel]], note: str = "", *, beside: Panel | None = None
) -> Figure:
    """Rows of panels.

    Args:
        rows: From top to bottom, each from left to right.
        note: A line at the bottom.
        beside: A panel on the left of all rows.

    Returns:
        The figure.
    """
    widths = [sum(panel.size[1] + GAP for panel in row) - GAP for row in rows]
    heights = [max(panel.size[0] for panel in row) for row in rows]
    indent = 0 if beside is None else beside.size[1] + GAP
    body = max(sum(heights) + GAP * (len(rows) - 1), 0 if beside is None else beside.size[0])
    canvas = Canvas(
        max(indent + max(widths), LETTER * len(note)) + 2 * MARGIN,
        body + (GAP + LINE if note else 0) + 2 * MARGIN,
    )
    if beside is not None:
        _draw(canvas, beside, MARGIN, MARGIN)
    top = MARGIN
    for row, height in zip(rows, heights, strict=True):
        left = MARGIN + indent
        for panel in row:
            _draw(canvas, panel, left, top)
            left += panel.size[1] + GAP
        top += height + GAP
    if note:
        _write(canvas, note, MARGIN, MARGIN + body + GAP, size=9.0)
    return canvas.figure


def shrink_step(values: np.ndarray, longest: int = 600) -> int:
    """Every which pixel of ``[H, W, ...]`` is shown, so that neither side is above ``longest``.

    Picked, not averaged: the mean of two sides of an edge is on neither.

    Example:
        >>> shrink_step(np.zeros((512, 1024))), shrink_step(np.zeros((512, 512)))
        (2, 1)
    """
    return -(-max(values.shape[:2]) // longest)


def rgb(image: np.ndarray) -> np.ndarray:
    """``[H, W, C]`` image in [0, 1] as ``[H, W, 3]``."""
    return np.broadcast_to(image, (*image.shape[:2], 3))


def frame_lines(framed: np.ndarray) -> np.ndarray:
    """Lines between pixels that are set and pixels that are not, or the outside.

    Args:
        framed: ``[H, W]`` booleans.

    Returns:
        ``[N, 2, 2]`` both ends of each line as (column, row), pixels being centred on whole ones.

    Example:
        >>> frame_lines(np.ones((1, 1), bool))[:2].tolist()
        [[[-0.5, -0.5], [0.5, -0.5]], [[-0.5, 0.5], [0.5, 0.5]]]
    """
    padded = np.pad(framed, 1).astype(np.int8)
    across = np.argwhere(np.diff(padded, axis=0)[:, 1:-1])[:, ::-1] - 0.5
    down = np.argwhere(np.diff(padded, axis=1)[1:-1])[:, ::-1] - 0.5
    rightwards, downwards = np.eye(2)
    lines = [(across, across + rightwards), (down, down + downwards)]
    return np.concatenate([np.stack(ends, axis=1) for ends in lines])


def _draw(canvas: Canvas, panel: Panel, left: int, top: int) -> None:
    height, width = (length * panel.zoom for length in panel.pixels.shape[:2])
    _write(canvas, panel.title, left, top)
    axes = canvas.image(np.clip(panel.pixels, 0.0, 1.0), left, top + LINE, panel.zoom)
    if panel.framed is not None:
        lines = LineCollection(
            list(frame_lines(panel.framed)), colors=FRAME, linewidths=1.6, capstyle="projecting"
        )
        axes.add_collection(lines, autolim=False)
    for letter, place in panel.points:
        _mark(axes, letter, place)
    for number, (words, colour) in enumerate(panel.corner):
        axes.annotate(
            words,
            (0.0, 1.0),
            xycoords="axes fraction",
            xytext=(5, -5 - 12 * number),
            textcoords="offset points",
            fontsize=8.5,
            va="top",
            color=colour,
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
    axes.plot(column, row, "o", ms=11, mfc="none", mec=MARK, mew=1.6, clip_on=False)
    axes.annotate(
        letter,
        (column, row),
        xytext=(9, 5),
        textcoords="offset points",
        fontsize=12,
        weight="bold",
        color=MARK,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0, "alpha": 0.85},
    )


def _write(canvas: Canvas, text: str, left: int, top: int, *, size: float = 9.5) -> None:
    x, y = left / canvas.size[0], 1.0 - (top + 0.4 * LINE) / canvas.size[1]
    canvas.figure.text(x, y, text, fontsize=size, va="center", color=TEXT, parse_math=False)
