"""Disparity, depth, points in space and normals of one scene, made of one another.

The formulas are those of :mod:`occjax.ops.depth` and :mod:`occjax.ops.normals`, computed in double
precision.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from occjax.errors import InputError
from occjax.io.maps import Map, Quantity
from occjax.io.ply import write_ply
from occjax.lightfield import Calibration, to_unit_float
from occjax.ops.depth import back_project, depth_from_disparity, disparity_from_depth
from occjax.ops.normals import surface_normals
from occjax.ops.precision import in_double

METRES = "metres; x right, y up, z to the viewer; centre camera at the origin"
RELIEF = "pixels; x right, y up, z = disparity * max(H, W) / 8 to the viewer"


class PointCloud(NamedTuple):
    """Where the pixels of the centre view are in space.

    Attributes:
        points: ``[H, W, 3]`` x to the right, y up, z to the viewer; NaN where there is no point.
        unit: Of the coordinates, in words: :data:`METRES` or :data:`RELIEF`.
    """

    points: np.ndarray
    unit: str


def convert_map(content: Map, to: Quantity, calibration: Calibration) -> Map:
    """Depth of disparity, or disparity of depth.

    Args:
        content: The map. Infinite disparities, by which some data sets mark pixels without one, are
            taken for none.
        to: What to make of it.
        calibration: Camera parameters.

    Returns:
        The map of the other quantity, or an equal one if it is that quantity already. Depth is
        infinite where the disparity is at or below that of infinitely distant points; NaN is where
        there is no disparity, or no positive depth.

    Example:
        >>> camera = Calibration(100.0, 35.0, baseline_mm=50.0, focus_distance_m=7.0)
        >>> disparity = Map(np.array([[0.0, -5.0, np.nan]]), "disparity")
        >>> depth = convert_map(disparity, "depth", camera)
        >>> depth.values.round(6).tolist()
        [[7.0, inf, nan]]
    """
    if content.quantity == to:
        return content
    if to == "depth":
        known = np.where(np.isinf(content.values), np.nan, content.values)
        return Map(in_double(depth_from_disparity, known, calibration), to)
    return Map(in_double(disparity_from_depth, content.values, calibration), to)


def normals(content: Map, calibration: Calibration) -> np.ndarray:
    """Unit normals of the surfaces, see :func:`occjax.ops.surface_normals`.

    Args:
        content: Disparity or depth of the centre view.
        calibration: Camera parameters.

    Returns:
        ``[H, W, 3]`` x to the right, y up, z to the viewer; NaN where there is no normal.
    """
    depth = convert_map(content, "depth", calibration)
    return in_double(_normals_of_depth, depth.values, calibration)


def point_cloud(content: Map, calibration: Calibration | None) -> PointCloud:
    """Where the pixels of the centre view are in space.

    In metres from the centre camera (:func:`occjax.ops.back_project`); without a calibration a
    relief of the disparity in pixels, ``(x - x0, y0 - y, disparity * max(H, W) / 8)``, in which in
    front and behind are right and the depth's scale is arbitrary.

    Args:
        content: Disparity or depth of the centre view.
        calibration: Camera parameters, if known.

    Raises:
        InputError: For depth without a calibration, which says nothing about left and right.

    Example:
        >>> cloud = point_cloud(Map(np.array([[0.0, 0.5], [0.0, 0.0]]), "disparity"), None)
        >>> cloud.points[0, 1].tolist()
        [0.5, 0.5, 0.125]
    """
    if calibration is not None:
        depth = convert_map(content, "depth", calibration)
        return PointCloud(in_double(back_project, depth.values, calibration), METRES)
    if content.quantity == "depth":
        raise InputError("points of a depth map need the camera's focal length; pass a calibration")
    height, width = content.values.shape
    y, x = np.mgrid[:height, :width].astype(np.float64)
    towards_viewer = np.asarray(content.values, np.float64) * max(height, width) / 8.0
    relief = np.stack([x - 0.5 * (width - 1), 0.5 * (height - 1) - y, towards_viewer], axis=-1)
    return PointCloud(relief, RELIEF)


def write_points(
    path: str | Path,
    cloud: PointCloud,
    *,
    centre: np.ndarray | None = None,
    shown: np.ndarray | None = None,
) -> int:
    """Write the points that are somewhere as PLY, in the colours of the centre view.

    Args:
        path: File to write; one that is there is replaced.
        cloud: What to write.
        centre: ``[H, W, C]`` centre view as stored; without it the points have no colour.
        shown: ``[H, W]`` pixels that may be written; all by default.

    Returns:
        The number of points.

    Raises:
        InputError: If the view is of another size, or the file cannot be written.
    """
    there = np.isfinite(cloud.points).all(axis=-1)
    there = there if shown is None else there & shown
    colours = None
    if centre is not None:
        if centre.shape[:2] != there.shape:
            raise InputError(
                f"{path}: the centre view is {list(centre.shape[:2])} but the map is "
                f"{list(there.shape)} (rows, columns); use the views that the map belongs to"
            )
        levels = np.floor(np.clip(to_unit_float(centre), 0.0, 1.0) * 255.0 + 0.5)
        colours = np.broadcast_to(levels, cloud.points.shape).astype(np.uint8)[there]
    write_ply(path, cloud.points[there], colours, comment=cloud.unit)
    return int(there.sum())


def _normals_of_depth(depth: jax.Array, calibration: Calibration) -> jax.Array:
    return surface_normals(back_project(depth, calibration))
