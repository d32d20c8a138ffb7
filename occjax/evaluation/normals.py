"""How far surfaces are turned away from the true ones.

A slightly tilted surface has small errors of disparity everywhere, but its shading, and whatever is
reconstructed from it, is wrong. So the HCI 4D benchmark measures the angle between the estimated
and the true normal. Normals need metric depth, that is the camera's calibration.
"""

from __future__ import annotations

import numpy as np

from occjax.errors import InputError
from occjax.evaluation.metrics import BORDER, compared_pixels
from occjax.lightfield import Calibration

EDGE_ON = 90.0
"""Angle in degrees for a pixel without an estimated surface: as if it were seen edge-on."""


def surface_points(disparity: np.ndarray, calibration: Calibration) -> np.ndarray:
    """Where the surface lies that each pixel sees.

    Args:
        disparity: ``[H, W]`` pixels per view step.
        calibration: Of the cameras.

    Returns:
        ``[H, W, 3]`` metres from the centre camera: to the right, down, and away from it. NaN where
        the disparity is not finite or that of no point at a finite distance.

    Example:
        >>> camera = Calibration(100.0, 35.0, baseline_mm=50.0, focus_distance_m=7.0)
        >>> surface_points(np.zeros((3, 3)), camera)[0, 2].round(3).tolist()
        [0.817, -0.817, 7.0]
    """
    h, w = disparity.shape
    depth = calibration.depth(np.where(np.isfinite(disparity), disparity, -np.inf), (h, w))
    depth = np.where(np.isfinite(depth), depth, np.nan)
    focal_length_pixels = calibration.focal_length_mm / calibration.sensor_size_mm * max(h, w)
    down, right = np.mgrid[:h, :w]
    across = (right - 0.5 * (w - 1)) / focal_length_pixels
    downwards = (down - 0.5 * (h - 1)) / focal_length_pixels
    return np.stack([across * depth, downwards * depth, depth], axis=-1)


def surface_normals(disparity: np.ndarray, calibration: Calibration) -> np.ndarray:
    """Unit normals of the surface, on the side of the camera, from differences of neighbours.

    Args:
        disparity: ``[H, W]`` pixels per view step; at least 2 pixels in each direction.
        calibration: Of the cameras.

    Returns:
        ``[H, W, 3]`` in the axes of :func:`surface_points`; NaN where that is, or a neighbour's.

    Raises:
        InputError: If the map is too small to have neighbours in both directions.

    Example:
        >>> camera = Calibration(100.0, 35.0, baseline_mm=50.0, focus_distance_m=7.0)
        >>> surface_normals(np.zeros((3, 3)), camera)[1, 1].round(6).tolist()
        [0.0, 0.0, -1.0]
    """
    if min(disparity.shape) < 2:
        raise InputError(
            f"a map of {list(disparity.shape)} has no normals; it needs 2 pixels in each direction"
        )
    points = surface_points(disparity, calibration)
    downwards, across = np.gradient(points, axis=0), np.gradient(points, axis=1)
    normals = np.cross(downwards, across)
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    # Central differences skip the pixel itself, which must have a point too.
    known = (length > 0.0) & np.isfinite(points)
    return np.divide(normals, length, out=np.full(normals.shape, np.nan), where=known)


def angular_errors(
    estimate: np.ndarray,
    ground_truth: np.ndarray,
    calibration: Calibration,
    *,
    border: int = BORDER,
    mask: np.ndarray | None = None,
) -> np.ndarray:
    """Angle between the estimated and the true normal at each pixel that is compared.

    A pixel without an estimated normal counts as 90 degrees off; one without a true normal is left
    out. The benchmark prints the median, on planes and on other smooth surfaces.

    Args:
        estimate: ``[H, W]`` estimated disparity, pixels per view step.
        ground_truth: ``[H, W]`` true disparity, pixels per view step.
        calibration: Of the cameras.
        border: Pixels left out at each side of the image.
        mask: ``[H, W]`` of booleans: True on the surfaces. None is everywhere.

    Returns:
        ``[N]`` degrees, row by row.

    Raises:
        InputError: If the maps do not fit each other or nothing is left to compare.

    Example:
        >>> camera = Calibration(100.0, 35.0, baseline_mm=50.0, focus_distance_m=7.0)
        >>> wall = np.zeros((5, 5))
        >>> angular_errors(wall + 0.3, wall, camera, border=2).round(6).tolist()
        [0.0]
    """
    compared_pixels(estimate, ground_truth, border=border, mask=mask)  # the sizes, first of all
    true = surface_normals(np.asarray(ground_truth), calibration)
    known = np.isfinite(true).all(-1)
    pixels = compared_pixels(
        estimate, np.where(known, ground_truth, np.nan), border=border, mask=mask
    )
    true = true[pixels]
    estimated = surface_normals(np.asarray(estimate), calibration)[pixels]
    # The arc cosine of the product would lose small angles to rounding.
    sine = np.linalg.norm(np.cross(estimated, true), axis=-1)
    angles = np.degrees(np.arctan2(sine, np.sum(estimated * true, axis=-1)))
    return np.where(np.isnan(angles), EDGE_ON, angles)
