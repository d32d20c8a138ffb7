"""The pictures that go with an estimate.

Every function returns a matplotlib figure; :func:`occjax.viz.canvas.save` writes it. Maps are shown
without resampling. Maps of any shape, with missing values or constant, are fine.
"""

from __future__ import annotations

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from occjax.lightfield import to_unit_float
from occjax.viz.canvas import MARGIN, TITLE_HEIGHT, Canvas, map_canvas, whole_zoom
from occjax.viz.colour import (
    MISSING,
    NO_VALUE,
    confidence_colours,
    cut_ends,
    disparity_colours,
    disparity_limits,
    error_colours,
)

DISPARITY_LABEL = "disparity [pixels per view step]"
DEPTH_LABEL = "depth [metres]"
ERROR_LABEL = "estimate - ground truth [pixels per view step]"

BAD = 0.07
"""Error above which a pixel counts as bad: the first threshold of the HCI benchmark."""

CENTRE_VIEW = "#f2b632"
"""Colour of the frame around the centre view."""


def disparity_figure(
    disparity: np.ndarray,
    *,
    confidence: np.ndarray | None = None,
    ground_truth: np.ndarray | None = None,
    title: str = "Disparity",
) -> Figure:
    """A disparity map with its colour bar, over the range that the scene has.

    Args:
        disparity: ``[H, W]`` pixels per view step.
        confidence: ``[H, W]`` in [0, 1], to keep wild values out of the range
            (:func:`occjax.viz.colour.disparity_limits`); the bar's ends are pointed where they
            lie beyond it.
        ground_truth: ``[H, W]`` pixels per view step, whose range the colours cover.
        title: Line above the map.
    """
    norm, colours = disparity_limits(disparity, confidence, ground_truth), disparity_colours()
    title += _missing_note(disparity)
    cut = cut_ends(norm, disparity)
    canvas, _ = map_canvas(disparity, norm, colours, title=title, label=DISPARITY_LABEL, cut=cut)
    return canvas.figure


def depth_figure(depth: np.ndarray, *, title: str = "Depth") -> Figure:
    """A depth map with its colour bar; near is yellow and far dark blue, as for disparity.

    Args:
        depth: ``[H, W]`` metres; where it is infinite the map is grey. A thousandth of the values
            at each end does not stretch the range (:func:`occjax.viz.colour.disparity_limits`).
        title: Line above the map.
    """
    norm = disparity_limits(depth, np.ones(depth.shape))
    title += _missing_note(depth)
    cut = cut_ends(norm, depth)
    colours = disparity_colours().reversed().with_extremes(bad=NO_VALUE)
    return map_canvas(depth, norm, colours, title=title, label=DEPTH_LABEL, cut=cut)[0].figure


def confidence_figure(confidence: np.ndarray, *, title: str = "Confidence") -> Figure:
    """A confidence map; the bar always runs from 0 to 1, so that scenes can be compared.

    Args:
        confidence: ``[H, W]`` in [0, 1].
        title: Line above the map.
    """
    norm, colours = Normalize(0.0, 1.0), confidence_colours()
    label = "confidence (1: certain)"
    title += _missing_note(confidence)
    return map_canvas(confidence, norm, colours, title=title, label=label)[0].figure


def error_figure(
    disparity: np.ndarray,
    ground_truth: np.ndarray,
    *,
    title: str = "Error",
    bad: float = BAD,
    border: int = 0,
) -> Figure:
    """Signed error: blue is too far, red too near, full colours where a pixel is bad.

    Pixels without an estimate are black, pixels without ground truth grey.

    Args:
        disparity: ``[H, W]`` estimate, pixels per view step.
        ground_truth: ``[H, W]`` pixels per view step.
        title: Line above the map, such as the score.
        bad: Error above which a pixel is bad.
        border: Width of the border that the score leaves out; a thin line marks it.
    """
    norm, colours, ticks = error_scale(bad)
    picture = error_picture(disparity, ground_truth, norm, colours)
    canvas, axes = map_canvas(picture, norm, colours, title=title, label=ERROR_LABEL, ticks=ticks)
    mark_border(axes, disparity.shape, border)
    return canvas.figure


def occlusion_figure(
    occlusion: np.ndarray, *, title: str = "Occlusion of each view (white: occluded)"
) -> Figure:
    """Occlusion maps of all views in the order of the grid, the centre view framed.

    Args:
        occlusion: ``[V, U, H, W]`` in [0, 1].
        title: Line above the mosaic.
    """
    rows, columns, height, width = occlusion.shape
    gap, longest = 3, 1300
    small = _shrink(occlusion, -(-max(rows * height, columns * width) // longest))
    zoom = whole_zoom((rows * small.shape[2], columns * small.shape[3]), longest // 2)
    colours = colormaps["gray"].with_extremes(bad=NO_VALUE)
    tiles = colours(np.ma.masked_invalid(small.repeat(zoom, -2).repeat(zoom, -1)))[..., :3]
    height, width = tiles.shape[2:4]
    white = [(0, 0), (0, 0), (0, gap), (0, gap), (0, 0)]
    mosaic = np.pad(tiles, white, constant_values=1.0).transpose(0, 2, 1, 3, 4)
    mosaic = mosaic.reshape(rows * (height + gap), columns * (width + gap), 3)[:-gap, :-gap]

    canvas = Canvas(
        max(mosaic.shape[1], 360) + 2 * MARGIN, mosaic.shape[0] + TITLE_HEIGHT + 2 * MARGIN
    )
    canvas.title(title, MARGIN)
    axes = canvas.image(mosaic, MARGIN, MARGIN + TITLE_HEIGHT, 1)
    corner = (columns // 2 * (width + gap) - 1.5, rows // 2 * (height + gap) - 1.5)
    frame = Rectangle(corner, width + 2, height + 2, fill=False, ec=CENTRE_VIEW, lw=2.0)
    axes.add_patch(frame)
    frame.set_clip_on(False)
    return canvas.figure


def comparison_figure(
    centre: np.ndarray,
    disparity: np.ndarray,
    ground_truth: np.ndarray | None = None,
    *,
    confidence: np.ndarray | None = None,
    score: str = "",
    bad: float = BAD,
    border: int = 0,
) -> Figure:
    """Centre view, ground truth, estimate and error side by side.

    Without ground truth: centre view and estimate. Ground truth and estimate share their colours,
    which are those of :func:`disparity_figure`. Images beyond 600 pixels are shown smaller.

    Args:
        centre: ``[H, W, C]`` centre view as stored.
        disparity: ``[H, W]`` estimate, pixels per view step.
        ground_truth: ``[H, W]`` pixels per view step.
        confidence: ``[H, W]`` in [0, 1], to keep wild values out of the range of the colours.
        score: Words behind the title of the error.
        bad: Error above which a pixel is bad.
        border: Width of the border that the score leaves out.
    """
    norm, colours = disparity_limits(disparity, confidence, ground_truth), disparity_colours()
    cut = cut_ends(norm, disparity)
    step = -(-max(disparity.shape) // 600)
    centre = np.moveaxis(_shrink(np.moveaxis(to_unit_float(centre), -1, 0), step), 0, -1)
    # Disparities are picked, not averaged: the mean of two sides of an edge is on neither.
    disparity = disparity[::step, ::step]
    ground_truth = None if ground_truth is None else ground_truth[::step, ::step]
    height, width = disparity.shape
    zoom = whole_zoom((height, width), 320)
    panel, gap, bar_room = max(width * zoom, 240), 12, 58
    count = 2 if ground_truth is None else 4
    top = MARGIN + TITLE_HEIGHT
    canvas = Canvas(
        count * (panel + gap) - gap + 2 * MARGIN, top + height * zoom + bar_room + MARGIN
    )
    lefts = [MARGIN + number * (panel + gap) for number in range(count)]

    picture = np.repeat(centre, 3, axis=-1) if centre.shape[-1] == 1 else centre
    canvas.title("Centre view", lefts[0])
    canvas.image(np.clip(picture, 0.0, 1.0), lefts[0], top, zoom)

    maps = [("Estimate", disparity)]
    if ground_truth is not None:
        maps.insert(0, ("Ground truth", ground_truth))
    for left, (name, values) in zip(lefts[1:], maps, strict=False):
        canvas.title(name, left)
        canvas.image(values, left, top, zoom, colours=colours, norm=norm)
    bar_top = top + height * zoom + 10
    # The labels of the lowest and the highest value are centred below the ends.
    bar = (lefts[1] + 8, bar_top, len(maps) * (panel + gap) - gap - 16, 12)
    canvas.bar(norm, colours, DISPARITY_LABEL, bar, cut=cut)

    if ground_truth is not None:
        norm, colours, ticks = error_scale(bad)
        canvas.title(f"Error   {score}".rstrip(), lefts[3])
        errors = error_picture(disparity, ground_truth, norm, colours)
        axes = canvas.image(errors, lefts[3], top, zoom)
        mark_border(axes, disparity.shape, border // step)
        bar = (lefts[3], bar_top, panel, 12)
        canvas.bar(norm, colours, "estimate - ground truth", bar, ticks=ticks[1:-1])
    return canvas.figure


def _missing_note(values: np.ndarray) -> str:
    """Words behind a title that explain the grey of the map, if there is any."""
    return "" if np.isfinite(values).all() else "   (grey: no value)"


def error_scale(bad: float) -> tuple[Normalize, Colormap, list[float]]:
    """Range, colours and ticks of an error map: three times the error that is just not bad."""
    limit = 3.0 * bad
    ticks = [-limit, -bad, 0.0, bad, limit]
    return Normalize(-limit, limit), error_colours(bad, limit), ticks


def error_picture(
    disparity: np.ndarray, ground_truth: np.ndarray, norm: Normalize, colours: Colormap
) -> np.ndarray:
    """``[H, W, 3]`` colours of the errors; no estimate and no truth look different."""
    known = np.isfinite(disparity) & np.isfinite(ground_truth)
    error = np.where(
        known, np.where(known, disparity, 0) - np.where(known, ground_truth, 0), np.nan
    )
    picture = colours(norm(np.ma.masked_invalid(error)))[..., :3]
    picture[np.isfinite(ground_truth) & ~np.isfinite(disparity)] = to_rgb(MISSING)
    return picture


def mark_border(axes: Axes, size: tuple[int, int], border: int) -> None:
    """A thin line around the pixels that count."""
    height, width = size
    if border > 0 and min(size) > 2 * border:
        corner = (border - 0.5, border - 0.5)
        axes.add_patch(
            Rectangle(
                corner, width - 2 * border, height - 2 * border, fill=False, ec="#555555", lw=0.7
            )
        )


def _shrink(images: np.ndarray, step: int) -> np.ndarray:
    """Images ``[..., H, W]`` with blocks of ``step`` x ``step`` pixels averaged."""
    if step <= 1:
        return images
    height, width = images.shape[-2:]
    padding = [(0, 0)] * (images.ndim - 2) + [(0, -height % step), (0, -width % step)]
    padded = np.pad(images, padding, mode="edge")
    *leading, height, width = padded.shape
    return padded.reshape(*leading, height // step, step, width // step, step).mean((-3, -1))
