"""Figure of a light field: sub-aperture images, epipolar plane images and macro-pixels."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from experiments.figure_panels import Panel, panel_figure, rgb
from occjax.io.mosaics import join_macpi, join_tiles
from occjax.lightfield import LightField, centre_index, to_grey, to_unit_float
from occjax.viz.canvas import whole_zoom

GAP_PX, EPI_LINE_PX = 2, 6
"""Gap between sub-aperture images, and height of a view's line in an epipolar plane image."""

MAX_TILED_PX, MAX_CENTRE_PX = 648, 512
"""Longest side of all sub-aperture images together, and of the part of the centre view."""

MAX_MACRO_PIXELS_PX = 216
"""Longest side of the macro-pixel image before it is enlarged."""


def light_field_figure(light_field: LightField) -> Figure:
    """Draw sub-aperture images, epipolar plane images and a part of the macro-pixel image.

    The part is the square of the centre view with most texture. The epipolar plane images cross in
    its centre.

    Args:
        light_field: The views.
    """
    (rows, columns), size = light_field.grid, light_field.image_size
    v0, u0 = centre_index(light_field.grid)
    step = -(-max(rows * size[0], columns * size[1]) // MAX_TILED_PX)
    tiles = tiled(light_field.views, step)
    side = min(max(1, MAX_MACRO_PIXELS_PX // max(rows, columns)), *size)
    centre = to_unit_float(light_field.centre)
    square = busiest_square(to_grey(centre), side)
    macro_pixels = join_macpi(to_unit_float(light_field.views[:, :, *square]))
    y, x = ((part.start + part.stop) // 2 for part in square)
    part = window(y, x, size)
    across = to_unit_float(light_field.views[v0, :, y, part[1]])
    down = to_unit_float(light_field.views[:, u0, part[0], x])
    zoom = whole_zoom(centre[part].shape[:2], MAX_CENTRE_PX)
    thick = max(1, EPI_LINE_PX // zoom)
    of = "" if max(size) <= MAX_CENTRE_PX else "part of the "
    framed = np.zeros(size, bool)
    framed[y] = framed[:, x] = framed[square] = True
    return panel_figure(
        [
            [
                Panel(f"(b) {of}centre view", rgb(centre[part]), zoom, framed=framed[part]),
                Panel(f"x = {x}", rgb(down.swapaxes(0, 1).repeat(thick, axis=1)), zoom),
                Panel(
                    "(c) macro-pixels of the square",
                    rgb(macro_pixels),
                    whole_zoom(macro_pixels.shape[:2], zoom * centre[part].shape[0]),
                ),
            ],
            [Panel(f"y = {y}", rgb(across.repeat(thick, 0)), zoom)],
        ],
        "Epipolar plane images: the marked row (y) below the centre view and the marked column (x) "
        "on its right, in all views of the grid's centre row or column.",
        left_panel=Panel(
            f"(a) {rows}x{columns} sub-aperture images",
            rgb(tiles),
            whole_zoom(tiles.shape[:2], MAX_TILED_PX),
        ),
    )


def tiled(views: np.ndarray, step: int) -> np.ndarray:
    """Return all views in one image with gaps, reduced by averaging ``step`` x ``step`` pixels.

    Args:
        views: ``[V, U, H, W, C]`` views as stored.
        step: Factor of the reduction, 1 or more.

    Returns:
        ``[rows, columns, C]`` in [0, 1].
    """
    v, u, h, w, c = views.shape
    rows, columns = max(1, h // step), max(1, w // step)
    small = [
        to_unit_float(view)[: rows * step, : columns * step]
        .reshape(rows, min(step, h), columns, min(step, w), c)
        .mean((1, 3))
        for view in views.reshape(v * u, h, w, c)
    ]
    gap = [(0, 0), (0, 0), (0, GAP_PX), (0, GAP_PX), (0, 0)]
    separate = np.pad(np.reshape(small, (v, u, rows, columns, c)), gap, constant_values=1.0)
    return join_tiles(separate)[:-GAP_PX, :-GAP_PX]


def busiest_square(grey: np.ndarray, side: int) -> tuple[slice, slice]:
    """Return the rows and columns of the square with most texture, away from the image border.

    Args:
        grey: ``[H, W]`` image.
        side: Side of the square, in pixels; at most that of the image.

    Example:
        >>> image = np.zeros((6, 9))
        >>> image[1, 7] = 1.0
        >>> busiest_square(image, 3)
        (slice(0, 3, None), slice(5, 8, None))
    """
    rim = [min(length // 8, (length - side) // 2) for length in grey.shape]
    texture = np.zeros(grey.shape)
    texture[1:] += np.abs(np.diff(grey, axis=0))
    texture[:, 1:] += np.abs(np.diff(grey, axis=1))
    sums = np.pad(texture, ((1, 0), (1, 0))).cumsum(0).cumsum(1)
    inside = sums[side:, side:] - sums[:-side, side:] - sums[side:, :-side] + sums[:-side, :-side]
    allowed = inside[tuple(slice(r, n - r) for r, n in zip(rim, inside.shape, strict=True))]
    place = np.unravel_index(np.argmax(allowed), allowed.shape)
    top, left = (int(start) + r for start, r in zip(place, rim, strict=True))
    return slice(top, top + side), slice(left, left + side)


def window(y: int, x: int, size: tuple[int, int]) -> tuple[slice, slice]:
    """Return rows and columns around a pixel, at most ``MAX_CENTRE_PX`` of each.

    Example:
        >>> window(700, 10, (1000, 400))
        (slice(444, 956, None), slice(0, 400, None))
    """
    shown = [min(MAX_CENTRE_PX, length) for length in size]
    starts = [
        min(max(0, place - part // 2), length - part)
        for place, part, length in zip((y, x), shown, size, strict=True)
    ]
    return slice(starts[0], starts[0] + shown[0]), slice(starts[1], starts[1] + shown[1])
