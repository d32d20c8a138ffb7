"""What all views see of one point, and how much they differ with and without its occlusion map."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from experiments.figure_panels import Panel, panel_figure, rgb, shrink_step
from occjax.errors import InputError
from occjax.lightfield import LightField, to_grey, to_unit_float
from occjax.ops import occlusion_maps, occlusion_weights, warp_views
from occjax.viz.canvas import whole_zoom

BORDER = 15
"""Pixels at each side in which no point is chosen, at most an eighth of the image."""

AROUND = 4
"""Pixels within which an occluder must stand for a point to be chosen as occluded."""

STEP = 0.15
"""By how much it must be nearer, pixels per view step."""

CLEAR = 0.1
"""Value of an occlusion map beyond which a view is counted as occluded."""

OCCLUDED = (0.17, 0.45, 0.85)
"""Colour of occluded views where they are left out."""


class Patches(NamedTuple):
    """Light field seen from every point of the centre view.

    Attributes:
        colour: ``[v, u, h, w, c]`` views warped to the centre view by its disparity.
        occlusion: ``[v, u, h, w]`` occlusion maps M.
        weights: ``[v, u, h, w]`` weights of the views, ``(1 - M)^2``.
        deviation: ``[h, w]`` standard deviation of each point's grey over the views.
        weighted: ``[h, w]`` the same of the weighted views.
    """

    colour: np.ndarray
    occlusion: np.ndarray
    weights: np.ndarray
    deviation: np.ndarray
    weighted: np.ndarray


def angular_patches(light_field: LightField, disparity: np.ndarray) -> Patches:
    """Refocus every point of the centre view on its own disparity.

    Args:
        light_field: The views.
        disparity: ``[H, W]`` of the centre view, finite, pixels per view step.
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
    """Standard deviation over the views.

    Args:
        grey: ``[v, u, ...]`` values.
        weights: ``[v, u, ...]`` of the views; none for equal ones. Never all zero.

    Returns:
        ``[...]``.

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
    """An unoccluded point A and an occluded point B.

    B is where, behind something nearer, the occlusion map takes most away from the deviation. A is
    where the centre view has most texture, on a surface without a step nearby, among the points
    whose deviation is at most the median.

    Args:
        disparity: ``[H, W]`` of the centre view, finite.
        centre: ``[H, W]`` grey centre view.
        patches: Of :func:`angular_patches`.

    Returns:
        ``(row, column)`` of A and of B.

    Raises:
        InputError: If nothing stands in front of anything.
    """
    highest, lowest = _highest_around(disparity, AROUND), -_highest_around(-disparity, AROUND)
    border = min(BORDER, min(disparity.shape) // 8)
    inside = np.zeros(disparity.shape, bool)
    inside[border : disparity.shape[0] - border, border : disparity.shape[1] - border] = True
    behind = inside & (highest - disparity > STEP)
    free = inside & (highest - lowest < STEP)
    if not behind.any() or not free.any():
        raise InputError(
            "no point lies behind another one, so none is occluded; pass --points with two points"
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
    """Both points in the centre view, their angular patches, occlusion maps and deviations.

    Args:
        light_field: The views.
        patches: Of :func:`angular_patches`.
        points: ``(row, column)`` of A and of B.
        note: A line at the bottom.
    """
    centre = to_unit_float(light_field.centre)
    step = shrink_step(centre)
    marks = [(name, (y // step, x // step)) for name, (y, x) in zip("AB", points, strict=True)]
    shown = rgb(centre[::step, ::step])
    rows = [[Panel("Centre view", shown, whole_zoom(shown.shape[:2]), points=marks)]]
    scale = max(4, 220 // max(light_field.grid))
    for name, (y, x) in zip("AB", points, strict=True):
        seen, maps = patches.colour[:, :, y, x], patches.occlusion[:, :, y, x]
        share, plain = np.mean(maps > CLEAR), patches.deviation[y, x]
        kept = seen * patches.weights[:, :, y, x, None]
        clear = np.where((maps > CLEAR)[..., None], OCCLUDED, rgb(seen))
        remaining = deviation(to_grey(seen), (maps <= CLEAR).astype(np.float32))
        rows.append(
            [
                Panel(f"{name}: angular patch, STD {plain:.4f}", rgb(seen), scale),
                Panel(
                    f"{name}: occlusion map, > {CLEAR} in {share:.0%}", rgb(maps[..., None]), scale
                ),
                Panel(f"{name}: weighted, STD {patches.weighted[y, x]:.4f}", rgb(kept), scale),
                Panel(f"{name}: only M <= {CLEAR}, STD {remaining:.4f}", clear, scale),
            ]
        )
    return panel_figure(rows, note)


def _highest_around(values: np.ndarray, radius: int) -> np.ndarray:
    """Highest value in a square window around each pixel."""
    padded = np.pad(values, radius, mode="edge")
    for axis in (0, 1):
        padded = np.lib.stride_tricks.sliding_window_view(padded, 2 * radius + 1, axis).max(-1)
    return padded
