"""Conversion between disparity, depth, points in space and normals of one scene.

The formulas are those of :class:`occjax.lightfield.Calibration` and :mod:`occjax.ops.geometry`,
computed in double precision.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from occjax.errors import InputError
from occjax.io.maps import Map, Quantity
from occjax.io.ply import write_ply
from occjax.lightfield import Calibration

METRES = "metres; x right, y up, z to the viewer; centre camera at the origin"
PIXELS = "pixels; x right, y up, z = disparity * max(H, W) / 8 to the viewer"


class PointCloud(NamedTuple):
    """Points in space of the pixels of the centre view.

    Attributes:
        points: ``[H, W, 3]`` x to the right, y up, z to the viewer; NaN is no point.
        unit: Unit of the coordinates, in words: :data:`METRES` or :data:`PIXELS`.
    """

    points: np.ndarray
    unit: str


def convert_map(content: Map, to: Quantity, calibration: Calibration) -> Map:
    """Convert disparity to depth or depth to disparity.

    Args:
        content: The map ``[H, W]``. Infinite disparities, with which some data sets mark pixels
            without a value, count as no value.
        to: Quantity of the result.
        calibration: Camera parameters.

    Returns:
        The converted map, or ``content`` if it already has that quantity. Depth is infinite where
        the disparity is at most that of infinitely distant points; NaN where there is no disparity,
        or no positive depth.

    Example:
        >>> camera = Calibration(100.0, 35.0, baseline_mm=50.0, focus_distance_m=7.0)
        >>> disparity = Map(np.array([[0.0, -5.0, np.nan]]), "disparity")
        >>> depth = convert_map(disparity, "depth", camera)
        >>> depth.values.round(6).tolist()
        [[7.0, inf, nan]]
    """
    if content.quantity == to:
        return content
    values = np.asarray(content.values, np.float64)
    height, width = values.shape
    if to == "depth":
        known = np.where(np.isinf(values), np.nan, values)
        return Map(calibration.depth(known, (height, width)), to)
    positive = np.where(values > 0.0, values, np.nan)
    return Map(calibration.disparity(positive, (height, width)), to)


def normals(content: Map, calibration: Calibration) -> np.ndarray:
    """Compute unit normals of the surfaces with :func:`occjax.ops.surface_normals`.

    Args:
        content: Disparity or depth ``[H, W]`` of the centre view.
        calibration: Camera parameters.

    Returns:
        ``[H, W, 3]`` x to the right, y up, z to the viewer; NaN is no normal.

    Example:
        >>> camera = Calibration(100.0, 35.0, baseline_mm=50.0, focus_distance_m=7.0)
        >>> normals(Map(np.zeros((3, 3)), "disparity"), camera)[1, 1, 2].round(6).item()
        1.0
    """
    # Imported in the functions that need JAX, since points in pixels need none.
    from occjax.ops.geometry import back_project, in_double, surface_normals

    depth = convert_map(content, "depth", calibration)
    return in_double(
        lambda depth, camera: surface_normals(back_project(depth, camera)),
        depth.values,
        calibration,
    )


def point_cloud(content: Map, calibration: Calibration | None) -> PointCloud:
    """Compute the points in space of the pixels of the centre view.

    With a calibration they are in metres from the centre camera
    (:func:`occjax.ops.back_project`). Without one they are in pixels,
    ``(x - x0, y0 - y, disparity * max(H, W) / 8)``: nearer points are in front, and the scale of
    depth is arbitrary.

    Args:
        content: Disparity or depth ``[H, W]`` of the centre view.
        calibration: Camera parameters, if known.

    Returns:
        The points and their unit.

    Raises:
        InputError: For depth without a calibration, since its focal length is needed.

    Example:
        >>> cloud = point_cloud(Map(np.array([[0.0, 0.5], [0.0, 0.0]]), "disparity"), None)
        >>> cloud.points[0, 1].tolist()
        [0.5, 0.5, 0.125]
    """
    if calibration is not None:
        from occjax.ops.geometry import back_project, in_double

        depth = convert_map(content, "depth", calibration)
        return PointCloud(in_double(back_project, depth.values, calibration), METRES)
    if content.quantity == "depth":
        raise InputError("points of a depth map need the camera's focal length; pass a calibration")
    values = np.asarray(content.values, np.float64)
    pixels = np.indices(values.shape).astype(np.float64)
    return PointCloud(points_at(pixels[0], pixels[1], values, None, values.shape), PIXELS)


def points_at(
    y: np.ndarray,
    x: np.ndarray,
    disparity: np.ndarray,
    calibration: Calibration | None,
    image_size: tuple[int, int],
) -> np.ndarray:
    """Compute points in space, as :func:`point_cloud`, from their places in the centre view.

    Args:
        y: ``[N]`` rows in the centre view, in pixels; they may lie between or beyond its pixels.
        x: ``[N]`` columns in the centre view.
        disparity: ``[N]`` pixels per view step.
        calibration: Camera parameters, if known.
        image_size: ``(H, W)`` of the centre view.

    Returns:
        ``[N, 3]`` float64, in metres or, without a calibration, in pixels; infinite beyond the
        disparity of infinitely distant points.

    Example:
        >>> points_at(np.array([0]), np.array([1]), np.array([0.5]), None, (2, 2)).tolist()
        [[0.5, 0.5, 0.125]]
    """
    height, width = image_size
    right, up = x - 0.5 * (width - 1), 0.5 * (height - 1) - y
    if calibration is None:
        return np.stack([right, up, disparity * max(image_size) / 8.0], axis=-1)
    focal_length = calibration.focal_length_pixels(image_size)
    depth = calibration.depth(disparity, image_size)
    directions = np.stack([right / focal_length, up / focal_length, -np.ones_like(right)], axis=-1)
    return depth[..., None] * directions


def flying_pixels(disparity: np.ndarray, *, max_step: float = 0.02) -> np.ndarray:
    """Find pixels between two surfaces, which belong to neither.

    At a depth edge an estimate may pass through disparities at which there is no surface. A pixel
    is such a flying pixel if fewer than half of its eight neighbours have a similar disparity.

    Args:
        disparity: ``[H, W]``, pixels per view step.
        max_step: Largest difference of neighbours on one surface, as a fraction of the range of the
            map.

    Returns:
        ``[H, W]`` booleans; pixels without a value are flying pixels.

    Example:
        >>> edge = np.repeat([[0.0, 0.0, 0.5, 1.0, 1.0]], 4, axis=0)
        >>> flying_pixels(edge)[1].tolist()
        [False, False, True, False, False]
    """
    finite = disparity[np.isfinite(disparity)]
    if not finite.size:
        return np.ones(disparity.shape, bool)
    low, high = np.percentile(finite, (0.1, 99.9))
    height, width = disparity.shape
    padded = np.pad(disparity, 1, mode="edge")
    similar = np.zeros(disparity.shape, int)
    for y, x in np.ndindex(3, 3):
        neighbour = padded[y : y + height, x : x + width]
        similar += np.abs(neighbour - disparity) <= max_step * (high - low)
    similar_neighbours = similar - 1  # without the pixel itself
    return similar_neighbours < 8 / 2


def write_points(
    path: str | Path,
    cloud: PointCloud,
    *,
    centre: np.ndarray | None = None,
    mask: np.ndarray | None = None,
) -> int:
    """Write the finite points as PLY in the colours of the centre view, atomically.

    Args:
        path: File to write; an existing file is replaced.
        cloud: Points ``[H, W, 3]``.
        centre: ``[H, W, C]`` centre view as stored; without it the points have no colour.
        mask: ``[H, W]`` pixels whose points are written; all by default.

    Returns:
        The number of points.

    Raises:
        InputError: If the view has another size, or the file cannot be written.

    Example:
        >>> import tempfile
        >>> cloud = point_cloud(Map(np.array([[0.0, np.nan]]), "disparity"), None)
        >>> write_points(Path(tempfile.mkdtemp()) / "points.ply", cloud)
        1
    """
    written = np.isfinite(cloud.points).all(axis=-1)
    written = written if mask is None else written & mask
    colours = None
    if centre is not None:
        from occjax.viz.pictures import view_picture

        if centre.shape[:2] != written.shape:
            raise InputError(
                f"{path}: the centre view is {list(centre.shape[:2])} but the map is "
                f"{list(written.shape)} (rows, columns); use the views that the map belongs to"
            )
        colours = view_picture(centre)[written]
    write_ply(path, cloud.points[written], colours, comment=cloud.unit)
    return int(written.sum())
