"""One pixel of the centre view: what the views see there, and how well they agree.

A point of the centre view at ``(y, x)`` with disparity ``d`` is seen by each view where
:func:`occjax.lightfield.project` says. These functions sample the views at those places.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.ndimage import map_coordinates

from occjax.lightfield import LightField, centre_index, project, to_grey, to_unit_float
from occjax.models.proposal.aperture import SECTORS, sector_of
from occjax.models.proposal.costs import best_part

Line = Literal["row", "column"]
"""Line of views, and of pixels, of an epipolar plane image."""


class CostCurve(NamedTuple):
    """Matching cost of a pixel at each disparity candidate.

    Attributes:
        candidates: ``[D]``, pixels per view step.
        all_views: ``[D]`` mean absolute difference from the centre view, over all views.
        best_part: ``[D]`` the smallest of that and of the means over the quarters of the aperture:
            low at the true disparity even if an occluder hides the point from the other views.
    """

    candidates: np.ndarray
    all_views: np.ndarray
    best_part: np.ndarray


class EpipolarImage(NamedTuple):
    """Part of an epipolar plane image: one row (or column) of pixels in each view of a line.

    Attributes:
        pixels: ``[N, 2 * radius + 1, C]`` float32 in [0, 1], a line of pixels of each of N views;
            NaN outside the image.
        offsets: ``[N]`` offset of each view from the centre view, in view steps.
        first: Row or column of the first pixel.
    """

    pixels: np.ndarray
    offsets: np.ndarray
    first: int


def sample_views(
    light_field: LightField, y: np.ndarray, x: np.ndarray, disparity: np.ndarray
) -> np.ndarray:
    """Sample all views where they see points of the centre view, bilinearly.

    Args:
        light_field: The views.
        y: ``[N]`` rows in the centre view, in pixels.
        x: ``[N]`` columns in the centre view, in pixels.
        disparity: ``[N]`` disparity of each point, pixels per view step.

    Returns:
        ``[V, U, N, C]`` float32; the border of a view is repeated outwards.

    Example:
        >>> views = np.tile(np.arange(8.0) / 8, (1, 3, 4, 1))
        >>> sample_views(LightField(views), *np.array([[1], [4], [0.5]]))[0, :, 0, 0].tolist()
        [0.5625, 0.5, 0.4375]
    """
    height, width = light_field.image_size
    channels = light_field.views.shape[-1]
    sampled = np.empty((*light_field.grid, y.size, channels), np.float32)
    for view in np.ndindex(*light_field.grid):
        row, column = project(y, x, disparity, light_field.offsets[view])
        row, column = np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)
        top, left = int(row.min()), int(column.min())
        part = np.s_[top : int(row.max()) + 2, left : int(column.max()) + 2]
        image = to_unit_float(light_field.views[view][part])
        for channel in range(channels):
            sampled[(*view, slice(None), channel)] = map_coordinates(
                image[..., channel], (row - top, column - left), order=1, mode="nearest"
            )
    return sampled


def angular_patch(light_field: LightField, y: int, x: int, disparity: float) -> np.ndarray:
    """Return the colour in which each view sees a point, ``[V, U, C]`` float32.

    The colour is NaN in views that are not usable.

    Args:
        light_field: The views.
        y: Row in the centre view.
        x: Column in the centre view.
        disparity: Disparity of the point, pixels per view step.
    """
    patch = sample_views(light_field, *np.array([[y], [x], [disparity]], np.float64))[:, :, 0]
    if light_field.usable is not None:
        patch[~light_field.usable] = np.nan
    return patch


def patch_occlusion(patch: np.ndarray) -> np.ndarray:
    """Return the occlusion map of a pixel: eq. 5 of OccCasNet for its angular patch.

    Args:
        patch: ``[V, U, C]`` from :func:`angular_patch`.

    Returns:
        ``[V, U]`` in [0, 1]: 0 where a view sees the same grey as the centre view.

    Example:
        >>> patch_occlusion(np.array([[[0.5], [0.5], [0.25]]])).tolist()
        [[0.0, 0.0, 0.25]]
    """
    grey = to_grey(patch)
    return np.clip(np.abs(grey - grey[centre_index(grey.shape)]), 0.0, 1.0)


def cost_curve(
    light_field: LightField, y: int, x: int, candidates: np.ndarray, *, radius_px: int = 2
) -> CostCurve:
    """Compute the matching cost of a pixel at each candidate.

    Args:
        light_field: The views.
        y: Row in the centre view.
        x: Column in the centre view.
        candidates: ``[D]`` disparities, pixels per view step.
        radius_px: Radius of the square window over which differences are averaged.

    Returns:
        The costs, as fractions of the white level.
    """
    window = np.arange(-radius_px, radius_px + 1)
    height, width = light_field.image_size
    rows, columns = np.clip(y + window, 0, height - 1), np.clip(x + window, 0, width - 1)
    points = np.meshgrid(candidates, rows, columns, indexing="ij")
    d, py, px = (axis.astype(np.float64).ravel() for axis in points)
    seen = sample_views(light_field, py, px, d)
    centre = centre_index(light_field.grid)
    difference = np.abs(seen - seen[centre]).mean(-1)
    cost = difference.reshape(*light_field.grid, candidates.size, -1).mean(-1)
    offsets = light_field.offsets
    compared = np.any(offsets != 0.0, axis=-1)
    if light_field.usable is not None:
        compared &= light_field.usable
    sector = np.asarray(sector_of(offsets))
    parts = [compared & (sector == number) for number in range(SECTORS)]
    sums = np.stack([cost[part].sum(0) for part in parts])
    counts = np.array([part.sum() for part in parts], np.float32)
    best = np.asarray(best_part(jnp.asarray(sums[..., None]), jnp.asarray(counts)))[:, 0]
    return CostCurve(np.asarray(candidates), sums.sum(0) / max(counts.sum(), 1.0), best)


def epipolar_image(
    light_field: LightField, y: int, x: int, line: Line, *, radius_px: int
) -> EpipolarImage:
    """Return the epipolar plane image through a pixel.

    Args:
        light_field: The views.
        y: Row in the centre view.
        x: Column in the centre view.
        line: ``"row"``: the centre row of views, and the pixel row ``y`` of each; ``"column"``: the
            centre column of views, and the pixel column ``x``.
        radius_px: Number of pixels on each side of the picked one.

    Returns:
        The lines of pixels of the usable views, in the order of their positions.
    """
    v0, u0 = centre_index(light_field.grid)
    usable = np.ones(light_field.grid, bool) if light_field.usable is None else light_field.usable
    if line == "row":
        strip, offsets = light_field.views[v0, :, y], light_field.offsets[v0, :, 1]
        usable, picked = usable[v0], x
    else:
        strip, offsets = light_field.views[:, u0, :, x], light_field.offsets[:, u0, 0]
        usable, picked = usable[:, u0], y
    strip, offsets = strip[usable], offsets[usable]
    first = picked - radius_px
    indices = np.arange(first, picked + radius_px + 1)
    inside = (indices >= 0) & (indices < strip.shape[1])
    pixels = to_unit_float(strip[:, np.clip(indices, 0, strip.shape[1] - 1)]).copy()
    pixels[:, ~inside] = np.nan
    order = np.argsort(offsets, kind="stable")
    return EpipolarImage(pixels[order], offsets[order], first)
