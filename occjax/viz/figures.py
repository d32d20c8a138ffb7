"""Figures of an estimate: disparity, depth, confidence, error, occlusion and a comparison.

Every function returns a matplotlib figure, which :func:`occjax.viz.save` writes. Maps are shown
without resampling; they may have any size, missing values or a single value.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from occjax.errors import InputError
from occjax.lightfield import centre_index, to_unit_float
from occjax.viz.canvas import MARGIN, TITLE_HEIGHT, Canvas, map_canvas, whole_zoom
from occjax.viz.colour import (
    NO_VALUE_COLOUR,
    check_map,
    colourbar_extend,
    confidence_colours,
    disparity_colours,
    disparity_norm,
    occlusion_colours,
)
from occjax.viz.pictures import error_picture, error_scale

DISPARITY_LABEL = "disparity [pixels per view step]"
DEPTH_LABEL = "depth [metres]"
CONFIDENCE_LABEL = "confidence (1: certain)"
ERROR_LABEL = "estimate - ground truth [pixels per view step]"

CENTRE_VIEW = "#f2b632"
"""Colour of the frame around the centre view."""


def disparity_figure(
    disparity: np.ndarray,
    *,
    confidence: np.ndarray | None = None,
    ground_truth: np.ndarray | None = None,
) -> Figure:
    """Draw a disparity map with its colour bar.

    Args:
        disparity: ``[H, W]`` pixels per view step.
        confidence: ``[H, W]`` in [0, 1], which excludes outliers from the range of the colours
            (:func:`occjax.viz.colour.disparity_norm`). Ends of the bar that values exceed are
            drawn as arrows.
        ground_truth: ``[H, W]`` pixels per view step, which the range of the colours covers.

    Returns:
        The figure.

    Raises:
        InputError: If the disparity is not one map, or the confidence has another size.

    Example:
        >>> disparity_figure(np.linspace(-1.0, 1.0, 64).reshape(8, 8)).axes[1].get_ylabel()
        'disparity [pixels per view step]'
    """
    norm = disparity_norm(disparity, confidence, ground_truth)
    return _map_figure("Disparity", disparity, norm, disparity_colours(), DISPARITY_LABEL)


def depth_figure(depth: np.ndarray) -> Figure:
    """Draw a depth map with its colour bar; near is yellow and far dark blue, as for disparity.

    The lowest and the highest 0.1 % of the values do not widen the range of the colours
    (:func:`occjax.viz.colour.disparity_norm`).

    Args:
        depth: ``[H, W]`` metres; infinite depth is grey.

    Returns:
        The figure.

    Raises:
        InputError: If the depth is not one map.

    Example:
        >>> depth_figure(np.array([[1.0, 2.0], [4.0, np.inf]])).axes[1].get_ylabel()
        'depth [metres]'
    """
    check_map("depth", depth)
    norm = disparity_norm(depth, np.ones(depth.shape))
    colours = disparity_colours().reversed().with_extremes(bad=NO_VALUE_COLOUR)
    return _map_figure("Depth", depth, norm, colours, DEPTH_LABEL)


def confidence_figure(confidence: np.ndarray) -> Figure:
    """Draw a confidence map; the bar always covers 0 to 1, so that scenes can be compared.

    Args:
        confidence: ``[H, W]`` in [0, 1].

    Returns:
        The figure.

    Raises:
        InputError: If the confidence is not one map.

    Example:
        >>> confidence_figure(np.full((8, 8), 0.9)).axes[1].get_ylabel()
        'confidence (1: certain)'
    """
    check_map("confidence", confidence)
    norm = Normalize(0.0, 1.0)
    return _map_figure("Confidence", confidence, norm, confidence_colours(), CONFIDENCE_LABEL)


def error_figure(
    disparity: np.ndarray, ground_truth: np.ndarray, *, title: str = "Error", border: int = 0
) -> Figure:
    """Draw the signed error: blue is too far, red is too near, bad pixels have full colours.

    A pixel is bad if its error exceeds :data:`occjax.evaluation.metrics.BAD_PIXEL_THRESHOLD`.
    Pixels without an estimate are black, pixels without ground truth grey.

    Args:
        disparity: ``[H, W]`` estimate, pixels per view step.
        ground_truth: ``[H, W]`` pixels per view step.
        title: Line above the map, such as the score.
        border: Width of the border that the score leaves out, in pixels; a thin line marks it.

    Returns:
        The figure.

    Raises:
        InputError: If the arrays are not two maps of one size.

    Example:
        >>> figure = error_figure(np.full((8, 8), 0.1), np.zeros((8, 8)))
        >>> figure.axes[1].get_yticks().round(2).tolist()
        [-0.21, -0.07, 0.0, 0.07, 0.21]
    """
    norm, colours, ticks = error_scale()
    picture = error_picture(disparity, ground_truth)
    canvas, axes = map_canvas(picture, norm, colours, title=title, label=ERROR_LABEL, ticks=ticks)
    mark_border(axes, disparity.shape, border)
    return canvas.figure


def occlusion_figure(
    occlusion: np.ndarray, *, title: str = "Occlusion of each view (light: occluded)"
) -> Figure:
    """Draw the occlusion maps of all views in the order of the grid, with a frame at the centre.

    The colours cover 0 to the 99th percentile of the values above 0, since most values are small.

    Args:
        occlusion: ``[V, U, H, W]`` in [0, 1]; 1 is occluded.
        title: Line above the mosaic.

    Returns:
        The figure.

    Raises:
        InputError: If the maps are not ``[V, U, H, W]``.

    Example:
        >>> occlusion_figure(np.full((3, 3, 8, 8), 0.2)).axes[1].get_ylabel()
        'occlusion (1: occluded)'
    """
    if np.ndim(occlusion) != 4:
        raise InputError(f"occlusion must be [V, U, H, W], not {list(np.shape(occlusion))}")
    rows, columns, height, width = occlusion.shape
    gap, longest = 3, 1300  # pixels between the maps, and of the longer side of the mosaic
    small = _shrink(occlusion, -(-max(rows * height, columns * width) // longest))
    zoom = whole_zoom((rows * small.shape[2], columns * small.shape[3]), longest // 2)
    norm, colours = _occlusion_limits(small), occlusion_colours()
    tiles = small.repeat(zoom, -2).repeat(zoom, -1)
    tiles = colours(norm(np.ma.masked_invalid(tiles)))[..., :3]
    height, width = tiles.shape[2:4]
    gaps = [(0, 0), (0, 0), (0, gap), (0, gap), (0, 0)]
    mosaic = np.pad(tiles, gaps, constant_values=1.0).transpose(0, 2, 1, 3, 4)
    mosaic = mosaic.reshape(rows * (height + gap), columns * (width + gap), 3)[:-gap, :-gap]

    canvas, axes = map_canvas(
        mosaic,
        norm,
        colours,
        title=title,
        label="occlusion (1: occluded)",
        extend=colourbar_extend(norm, small),
        zoom=1,
    )
    v, u = centre_index((rows, columns))
    corner = (u * (width + gap) - 1.5, v * (height + gap) - 1.5)
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
    hidden: np.ndarray | None = None,
    score: str = "",
    border: int = 0,
) -> Figure:
    """Draw the centre view, ground truth, estimate and error next to each other.

    Without ground truth only the centre view and the estimate are drawn. Ground truth and estimate
    share their colours, which are those of :func:`disparity_figure`. Images larger than 600 pixels
    are reduced.

    Args:
        centre: ``[H, W, C]`` centre view as stored.
        disparity: ``[H, W]`` estimate, pixels per view step.
        ground_truth: ``[H, W]`` pixels per view step.
        confidence: ``[H, W]`` in [0, 1], which excludes outliers from the range of the colours.
        hidden: ``[H, W]`` whether a pixel of the estimate is drawn grey; none by default.
        score: Text after the title of the error.
        border: Width of the border that the score leaves out, in pixels.

    Returns:
        The figure.

    Raises:
        InputError: If the view and the maps do not have one size.

    Example:
        >>> centre, disparity = np.zeros((8, 8, 3), np.uint8), np.eye(8)
        >>> [text.get_text() for text in comparison_figure(centre, disparity).texts]
        ['Centre view', 'Estimate']
    """
    norm, colours = disparity_norm(disparity, confidence, ground_truth), disparity_colours()
    others = {"centre view": centre[..., 0], "ground truth": ground_truth, "hidden": hidden}
    for name, values in others.items():
        if values is not None:
            check_map(name, values, disparity.shape)
    extend = colourbar_extend(norm, disparity)
    step = -(-max(disparity.shape) // 600)  # at most 600 pixels along the longer side
    centre = np.moveaxis(_shrink(np.moveaxis(to_unit_float(centre), -1, 0), step), 0, -1)
    # Disparities are subsampled, since an average across an edge lies on neither side of it.
    disparity = disparity[::step, ::step]
    ground_truth = None if ground_truth is None else ground_truth[::step, ::step]
    height, width = disparity.shape
    zoom = whole_zoom((height, width), 320)
    panel, gap, bar_height = max(width * zoom, 240), 12, 58
    count = 2 if ground_truth is None else 4
    top = MARGIN + TITLE_HEIGHT
    canvas = Canvas(
        count * (panel + gap) - gap + 2 * MARGIN, top + height * zoom + bar_height + MARGIN
    )
    lefts = [MARGIN + number * (panel + gap) for number in range(count)]

    picture = np.repeat(centre, 3, axis=-1) if centre.shape[-1] == 1 else centre
    canvas.title("Centre view", lefts[0])
    canvas.image(np.clip(picture, 0.0, 1.0), lefts[0], top, zoom)

    shown = disparity if hidden is None else np.where(hidden[::step, ::step], np.nan, disparity)
    maps = [("Estimate", shown)]
    if ground_truth is not None:
        maps.insert(0, ("Ground truth", ground_truth))
    for left, (name, values) in zip(lefts[1:], maps, strict=False):
        canvas.title(name, left)
        canvas.image(values, left, top, zoom, colours=colours, norm=norm)
    bar_top = top + height * zoom + 10
    # The labels of the lowest and the highest value are centred below the ends of the bar.
    bar = (lefts[1] + 8, bar_top, len(maps) * (panel + gap) - gap - 16, 12)
    canvas.bar(norm, colours, DISPARITY_LABEL, bar, extend=extend)

    if ground_truth is not None:
        norm, colours, ticks = error_scale()
        canvas.title(f"Error   {score}".rstrip(), lefts[3])
        errors = error_picture(disparity, ground_truth)
        axes = canvas.image(errors, lefts[3], top, zoom)
        mark_border(axes, disparity.shape, border // step)
        bar = (lefts[3], bar_top, panel, 12)
        canvas.bar(norm, colours, "estimate - ground truth", bar, ticks=ticks[1:-1])
    return canvas.figure


def mark_border(axes: Axes, size: tuple[int, int], border: int) -> None:
    """Draw a thin line around the pixels that a score includes.

    Args:
        axes: Axes with the image.
        size: ``(H, W)`` of the image.
        border: Width of the border, in pixels.
    """
    height, width = size
    if border > 0 and min(size) > 2 * border:
        corner, inner = (border - 0.5, border - 0.5), (width - 2 * border, height - 2 * border)
        axes.add_patch(Rectangle(corner, *inner, fill=False, ec="#555555", lw=0.7))


def _map_figure(
    title: str, values: np.ndarray, norm: Normalize, colours: Colormap, label: str
) -> Figure:
    """Draw one map; the title explains grey pixels if there are any."""
    title += "" if np.isfinite(values).all() else "   (grey: no value)"
    extend = colourbar_extend(norm, values)
    return map_canvas(values, norm, colours, title=title, label=label, extend=extend)[0].figure


def _occlusion_limits(occlusion: np.ndarray) -> Normalize:
    """Return the range of the colours of occlusion maps."""
    positive = occlusion[np.isfinite(occlusion) & (occlusion > 0.0)]
    return Normalize(0.0, float(np.percentile(positive, 99.0)) if positive.size else 1.0)


def _shrink(images: np.ndarray, step: int) -> np.ndarray:
    """Average blocks of ``step`` x ``step`` pixels of images ``[..., H, W]``."""
    if step <= 1:
        return images
    height, width = images.shape[-2:]
    padding = [(0, 0)] * (images.ndim - 2) + [(0, -height % step), (0, -width % step)]
    padded = np.pad(images, padding, mode="edge")
    *leading, height, width = padded.shape
    return padded.reshape(*leading, height // step, step, width // step, step).mean((-3, -1))
