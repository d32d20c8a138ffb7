"""Angular patches of points, and their deviation with and without the occlusion map."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from experiments.blender.folder import local_maximum
from experiments.figure_panels import Panel, panel_figure, rgb, shrink_step
from occjax.errors import InputError
from occjax.lightfield import LightField, to_grey, to_unit_float
from occjax.ops import occlusion_maps, occlusion_weights, warp_views
from occjax.viz.canvas import whole_zoom

MARGIN_FRACTION = 1 / 8
"""Fraction of the image, at each side, in which no point is chosen."""

OCCLUDER_RADIUS_PX = 4
"""Maximum distance between an occluded point and its occluder, in pixels."""

MIN_OCCLUDER_STEP = 0.15
"""Minimum disparity step from an occluded point to its occluder, pixels per view step."""

MAX_VISIBLE = 0.1
"""Value of an occlusion map above which a view counts as occluded."""

MIN_VISIBLE_FRACTION = 0.5
"""Minimum fraction of views that see an occluded point; with fewer, the disparity is unreliable."""


class Patches(NamedTuple):
    """Views warped to the centre view, and their deviations.

    Attributes:
        colour: ``[v, u, h, w, c]`` views warped by the disparity of the centre view.
        occlusion: ``[v, u, h, w]`` occlusion maps M.
        weights: ``[v, u, h, w]`` weights of the views, ``(1 - M)^2``.
        deviation: ``[h, w]`` standard deviation of grey over the views.
        weighted: ``[h, w]`` weighted standard deviation of grey over the views.
    """

    colour: np.ndarray
    occlusion: np.ndarray
    weights: np.ndarray
    deviation: np.ndarray
    weighted: np.ndarray


def angular_patches(light_field: LightField, disparity: np.ndarray) -> Patches:
    """Warp all views to the centre view and compute occlusion maps and deviations.

    Args:
        light_field: The views.
        disparity: ``[H, W]`` finite disparity of the centre view, pixels per view step.
    """
    positions = light_field.positions
    offsets = None if positions is None else jnp.asarray(positions)
    refocused = jnp.asarray(disparity, jnp.float32)
    colour = np.asarray(
        jax.jit(lambda views: warp_views(views, refocused, offsets=offsets))(
            jnp.asarray(light_field.floating())
        )
    )
    maps = jax.jit(lambda views: occlusion_maps(views, refocused, offsets=offsets))(
        jnp.asarray(light_field.grey())[..., None]
    )
    grey, weights = to_grey(colour), np.asarray(occlusion_weights(maps))
    return Patches(colour, np.asarray(maps), weights, deviation(grey), deviation(grey, weights))


def deviation(grey: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
    """Return the standard deviation over the views.

    Args:
        grey: ``[v, u, ...]`` values.
        weights: ``[v, u, ...]`` weights of the views, not all zero; None for equal weights.

    Returns:
        ``[...]`` standard deviation.

    Example:
        >>> grey = np.array([[0.0, 0.0, 1.0, 1.0]])
        >>> float(deviation(grey)), float(deviation(grey, np.array([[1.0, 1.0, 0.0, 0.0]])))
        (0.5, 0.0)
    """
    weights = np.ones_like(grey) if weights is None else weights
    total = weights.sum((0, 1))
    mean = (weights * grey).sum((0, 1)) / total
    return np.sqrt((weights * np.square(grey - mean)).sum((0, 1)) / total)


def choose_points(
    disparity: np.ndarray, centre: np.ndarray, patches: Patches
) -> tuple[tuple[int, int], tuple[int, int]]:
    """Choose an unoccluded point A and an occluded point B.

    B is the point next to an occluder, visible in half of the views or more, whose deviation the
    occlusion map reduces most. A is the point with most texture in the centre view among those
    without a disparity step nearby whose deviation is at most the median.

    Args:
        disparity: ``[H, W]`` finite disparity of the centre view, pixels per view step.
        centre: ``[H, W]`` grey centre view.
        patches: Result of :func:`angular_patches`.

    Returns:
        ``(row, column)`` of A and of B.

    Raises:
        InputError: If no point is occluded.
    """
    highest, lowest = (
        local_maximum(disparity, OCCLUDER_RADIUS_PX),
        -local_maximum(-disparity, OCCLUDER_RADIUS_PX),
    )
    top, left = (int(MARGIN_FRACTION * length) for length in disparity.shape)
    inside = np.zeros(disparity.shape, bool)
    inside[top : disparity.shape[0] - top, left : disparity.shape[1] - left] = True
    seen = np.mean(patches.occlusion <= MAX_VISIBLE, axis=(0, 1)) >= MIN_VISIBLE_FRACTION
    behind = inside & seen & (highest - disparity > MIN_OCCLUDER_STEP)
    free = inside & (highest - lowest < MIN_OCCLUDER_STEP)
    if not behind.any() or not free.any():
        raise InputError(
            "no point lies behind another one, so none is occluded; pass two points with --points"
        )
    gain = patches.deviation - patches.weighted
    occluded = np.argmax(np.where(behind, gain, -1.0))
    texture = sum(np.abs(slope) for slope in np.gradient(centre))
    steady = free & (patches.deviation <= np.median(patches.deviation[free]))
    clear = np.argmax(np.where(steady, texture, -1.0))
    first, second = (np.unravel_index(index, disparity.shape) for index in (clear, occluded))
    return (int(first[0]), int(first[1])), (int(second[0]), int(second[1]))


def patches_figure(
    light_field: LightField,
    patches: Patches,
    points: tuple[tuple[int, int], tuple[int, int]],
    note: str = "",
) -> Figure:
    """Draw both points in the centre view, their angular patches, occlusion maps and deviations.

    Args:
        light_field: The views.
        patches: Result of :func:`angular_patches`.
        points: ``(row, column)`` of A and of B.
        note: Text at the bottom.
    """
    centre = to_unit_float(light_field.centre)
    step = shrink_step(centre)
    marks = [(name, (y // step, x // step)) for name, (y, x) in zip("AB", points, strict=True)]
    shown = rgb(centre[::step, ::step])
    scale = max(4, 230 // max(light_field.grid))
    white = white_level(np.stack([patches.occlusion[:, :, y, x] for y, x in points]))
    rows = []
    for name, (y, x) in zip("AB", points, strict=True):
        seen, maps = patches.colour[:, :, y, x], patches.occlusion[:, :, y, x]
        clear = maps <= MAX_VISIBLE
        plain, weighted = patches.deviation[y, x], patches.weighted[y, x]
        alone = deviation(to_grey(seen), clear.astype(np.float32))
        kept = seen * patches.weights[:, :, y, x, None]
        rows.append(
            [
                Panel(f"{name}: angular patch, STD {plain:.4f}", rgb(seen), scale, framed=clear),
                Panel(
                    f"{name}: occlusion map M, 0 to {white:.2f}",
                    rgb(np.clip(maps / white, 0.0, 1.0)[..., None]),
                    scale,
                ),
                Panel(f"{name}: times (1 - M)^2, STD {weighted:.4f}", rgb(kept), scale),
                Panel(
                    f"{name}: only M <= {MAX_VISIBLE}, STD {alone:.4f}",
                    np.where(clear[..., None], rgb(seen), 1.0),
                    scale,
                    framed=clear,
                ),
            ]
        )
    frame = f"Blue frame: views with M <= {MAX_VISIBLE}. STD: standard deviation. {note}".rstrip()
    return panel_figure(
        rows,
        frame,
        left_panel=Panel("centre view", shown, whole_zoom(shown.shape[:2]), points=marks),
    )


def white_level(maps: np.ndarray) -> float:
    """Return the value of occlusion maps to draw as white: a high percentile, but not noise.

    Args:
        maps: ``[...]`` occlusion maps in [0, 1].

    Example:
        >>> round(white_level(np.linspace(0.0, 0.5, 1001)), 4), white_level(np.zeros(3))
        (0.4995, 0.1)
    """
    return max(MAX_VISIBLE, float(np.percentile(maps, 99.9)))
