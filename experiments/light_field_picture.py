"""Three ways to look at all views: side by side, along a line, and pixel by pixel."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from experiments.figure_panels import Panel, panel_figure, rgb
from occjax.io.mosaics import join_macpi, join_tiles
from occjax.lightfield import LightField, to_grey, to_unit_float
from occjax.viz.canvas import whole_zoom

GAP, EPI_LINE = 2, 6
"""Pixels between sub-aperture images, and height of a view's line of an epipolar plane image."""

TILED, WIDEST = 648, 512
"""Longest sides of all views side by side, and of what is shown of the centre view, in pixels."""

MACRO_PIXELS = 216
"""Longest side of a macro-pixel image, before it is enlarged."""


def light_field_figure(light_field: LightField) -> Figure:
    """Sub-aperture images, epipolar plane images and a part of the macro-pixel image.

    The epipolar plane images cross where the macro-pixel image is taken from: the square of the
    centre view with most texture.

    Args:
        light_field: The views.
    """
    (rows, columns), size = light_field.grid, light_field.image_size
    step = -(-max(rows * size[0], columns * size[1]) // TILED)
    tiles = tiled(light_field.views, step)
    side = min(max(1, MACRO_PIXELS // max(rows, columns)), *size)
    centre = to_unit_float(light_field.centre)
    square = busiest_square(to_grey(centre), side)
    macro_pixels = join_macpi(to_unit_float(light_field.views[:, :, *square]))
    y, x = ((part.start + part.stop) // 2 for part in square)
    part = window(y, x, size)
    across = to_unit_float(light_field.views[rows // 2, :, y, part[1]])
    down = to_unit_float(light_field.views[:, columns // 2, part[0], x])
    zoom = whole_zoom(centre[part].shape[:2], WIDEST)
    thick = max(1, EPI_LINE // zoom)
    of = "" if max(size) <= WIDEST else "part of the "
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
        "on its right, as all views of the grid's middle row or column see them.",
        beside=Panel(
            f"(a) {rows}x{columns} sub-aperture images",
            rgb(tiles),
            whole_zoom(tiles.shape[:2], TILED),
        ),
    )


def tiled(views: np.ndarray, step: int) -> np.ndarray:
    """All views in one image, ``step`` x ``step`` pixels averaged, with gaps between the views.

    Args:
        views: ``[V, U, H, W, C]`` as stored.
        step: 1 or more.

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
    gap = [(0, 0), (0, 0), (0, GAP), (0, GAP), (0, 0)]
    separate = np.pad(np.reshape(small, (v, u, rows, columns, c)), gap, constant_values=1.0)
    return join_tiles(separate)[:-GAP, :-GAP]


def busiest_square(grey: np.ndarray, side: int) -> tuple[slice, slice]:
    """Rows and columns of the square with most texture, not at the rim if there is room.

    Args:
        grey: ``[H, W]`` image.
        side: Of the square, in pixels; no longer than the image.

    Example:
        >>> image = np.zeros((6, 9))
        >>> image[1, 7] = 1.0
        >>> busiest_square(image, 3)
        (slice(0, 3, None), slice(6, 9, None))
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
    """Rows and columns around a pixel, no more than are shown of the centre view.

    Example:
        >>> window(700, 10, (1000, 400))
        (slice(444, 956, None), slice(0, 400, None))
    """
    shown = [min(WIDEST, length) for length in size]
    starts = [
        min(max(0, place - part // 2), length - part)
        for place, part, length in zip((y, x), shown, size, strict=True)
    ]
    return slice(starts[0], starts[0] + shown[0]), slice(starts[1], starts[1] + shown[1])
