"""Figures of panel rows, each panel with a title, as in the paper's figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure

from occjax.viz.canvas import BAR_TEXT, BAR_WIDTH, MARGIN, TEXT, Canvas

LINE_HEIGHT, GAP = 22, 12
LETTER_WIDTH = 7
"""Width of a letter of a title, in pixels."""

MARK, FRAME = "#d62728", "#2b6fd6"
"""Colours of marked points and of frames."""


@dataclass(frozen=True, eq=False)
class Bar:
    """Colour bar to the right of a panel.

    Attributes:
        norm: Range of values.
        colours: Colormap.
        label: Name of the quantity.
        extend: Ends of the range that values exceed: neither, min, max or both.
    """

    norm: Normalize
    colours: Colormap
    label: str
    extend: str = "neither"


@dataclass(frozen=True, eq=False)
class Panel:
    """Image with a title.

    Attributes:
        title: Line above the image.
        pixels: ``[H, W, 3]`` colours in [0, 1].
        zoom: Size of each image pixel in the figure, in figure pixels.
        corner: Text lines in the upper left corner, each with its colour.
        bar: Colour bar to the right.
        points: Points to mark, each a letter and ``(row, column)``.
        framed: ``[H, W]`` booleans; a blue line surrounds the true ones.
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
        """Height and width including title and bar, in figure pixels."""
        height, width = (length * self.zoom for length in self.pixels.shape[:2])
        room = GAP + BAR_WIDTH + BAR_TEXT if self.bar else 0
        return LINE_HEIGHT + height, max(width + room, LETTER_WIDTH * len(self.title))


def panel_figure(
    rows: Sequence[Sequence[Panel]], note: str = "", *, left_panel: Panel | None = None
) -> Figure:
    """Draw rows of panels.

    Args:
        rows: Rows from top to bottom, each from left to right.
        note: Line at the bottom.
        left_panel: Panel to the left of all rows.

    Returns:
        The figure.
    """
    widths = [sum(panel.size[1] + GAP for panel in row) - GAP for row in rows]
    heights = [max(panel.size[0] for panel in row) for row in rows]
    indent = 0 if left_panel is None else left_panel.size[1] + GAP
    body = max(
        sum(heights) + GAP * (len(rows) - 1), 0 if left_panel is None else left_panel.size[0]
    )
    canvas = Canvas(
        max(indent + max(widths), LETTER_WIDTH * len(note)) + 2 * MARGIN,
        body + (GAP + LINE_HEIGHT if note else 0) + 2 * MARGIN,
    )
    if left_panel is not None:
        _draw(canvas, left_panel, MARGIN, MARGIN)
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
    """Return the step of subsampling ``[H, W, ...]`` values to sides of at most ``longest``.

    Maps are subsampled without averaging: the mean across an edge is on neither of its sides.

    Example:
        >>> shrink_step(np.zeros((512, 1024))), shrink_step(np.zeros((512, 512)))
        (2, 1)
    """
    return -(-max(values.shape[:2]) // longest)


def rgb(image: np.ndarray) -> np.ndarray:
    """Return an ``[H, W, C]`` image as ``[H, W, 3]``."""
    return np.broadcast_to(image, (*image.shape[:2], 3))


def coloured(values: np.ndarray, norm: Normalize, colours: Colormap) -> np.ndarray:
    """Return ``[H, W, 3]`` colours of a map ``[H, W]``; non-finite values get their own colour."""
    return colours(norm(np.ma.masked_invalid(values)))[..., :3]


def frame_lines(framed: np.ndarray) -> np.ndarray:
    """Return the boundary between true pixels and false pixels or the outside.

    Args:
        framed: ``[H, W]`` booleans.

    Returns:
        ``[N, 2, 2]`` both ends of each line as (column, row); pixel centres are at integers.

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
    axes = canvas.image(np.clip(panel.pixels, 0.0, 1.0), left, top + LINE_HEIGHT, panel.zoom)
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
        rectangle = (left + width + GAP, top + LINE_HEIGHT, BAR_WIDTH, height)
        canvas.bar(bar.norm, bar.colours, bar.label, rectangle, extend=bar.extend)


def _mark(axes: Axes, letter: str, place: tuple[int, int]) -> None:
    """Draw a ring around a pixel with a letter next to it."""
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
    x, y = left / canvas.size[0], 1.0 - (top + 0.4 * LINE_HEIGHT) / canvas.size[1]
    canvas.figure.text(x, y, text, fontsize=size, va="center", color=TEXT, parse_math=False)
