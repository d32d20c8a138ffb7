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
from occjax.render.folder import largest_around
from occjax.viz.canvas import whole_zoom

BORDER = 1 / 8
"""Share of the image, at each side, in which no point is chosen."""

AROUND = 4
"""Pixels within which an occluder must stand for a point to be chosen as occluded."""

STEP = 0.15
"""By how much it must be nearer, pixels per view step."""

CLEAR = 0.1
"""Value of an occlusion map beyond which a view is counted as occluded."""


SEEN = 0.5
"""Share of the views that see a point at least, for it to be chosen as occluded: where hardly any
agree, the disparity is wrong."""


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

    B is where, behind something nearer but seen by half of the views, the occlusion map takes most
    away from the deviation. A is where the centre view has most texture, on a surface without a
    step nearby, among the points whose deviation is at most the median.

    Args:
        disparity: ``[H, W]`` of the centre view, finite.
        centre: ``[H, W]`` grey centre view.
        patches: Of :func:`angular_patches`.

    Returns:
        ``(row, column)`` of A and of B.

    Raises:
        InputError: If nothing stands in front of anything.
    """
    highest, lowest = largest_around(disparity, AROUND), -largest_around(-disparity, AROUND)
    top, left = (int(BORDER * length) for length in disparity.shape)
    inside = np.zeros(disparity.shape, bool)
    inside[top : disparity.shape[0] - top, left : disparity.shape[1] - left] = True
    seen = np.mean(patches.occlusion <= CLEAR, axis=(0, 1)) >= SEEN
    behind = inside & seen & (highest - disparity > STEP)
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
        note: Words at the bottom.
    """
    centre = to_unit_float(light_field.centre)
    step = shrink_step(centre)
    marks = [(name, (y // step, x // step)) for name, (y, x) in zip("AB", points, strict=True)]
    shown = rgb(centre[::step, ::step])
    scale = max(4, 230 // max(light_field.grid))
    brightest = brightest_of(np.stack([patches.occlusion[:, :, y, x] for y, x in points]))
    rows = []
    for name, (y, x) in zip("AB", points, strict=True):
        seen, maps = patches.colour[:, :, y, x], patches.occlusion[:, :, y, x]
        clear = maps <= CLEAR
        plain, weighted = patches.deviation[y, x], patches.weighted[y, x]
        alone = deviation(to_grey(seen), clear.astype(np.float32))
        kept = seen * patches.weights[:, :, y, x, None]
        rows.append(
            [
                Panel(f"{name}: angular patch, STD {plain:.4f}", rgb(seen), scale, framed=clear),
                Panel(
                    f"{name}: occlusion map M, 0 to {brightest:.2f}",
                    rgb(np.clip(maps / brightest, 0.0, 1.0)[..., None]),
                    scale,
                ),
                Panel(f"{name}: times (1 - M)^2, STD {weighted:.4f}", rgb(kept), scale),
                Panel(
                    f"{name}: M <= {CLEAR} alone, STD {alone:.4f}",
                    np.where(clear[..., None], rgb(seen), 1.0),
                    scale,
                    framed=clear,
                ),
            ]
        )
    frame = f"Blue frame: views with M <= {CLEAR}. STD: standard deviation of grey. {note}".rstrip()
    return panel_figure(
        rows,
        frame,
        beside=Panel("centre view", shown, whole_zoom(shown.shape[:2]), points=marks),
    )


def brightest_of(maps: np.ndarray) -> float:
    """Value of occlusion maps to show as white: few are above it, and no noise is stretched to it.

    Args:
        maps: In [0, 1], of any shape.

    Example:
        >>> round(brightest_of(np.linspace(0.0, 0.5, 1001)), 4), brightest_of(np.zeros(3))
        (0.4995, 0.1)
    """
    return max(CLEAR, float(np.percentile(maps, 99.9)))
