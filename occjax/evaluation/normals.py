"""How far surfaces are turned away from the true ones.

A slightly tilted surface has small errors of disparity everywhere, but its shading, and whatever is
reconstructed from it, is wrong. So the HCI 4D benchmark measures the angle between the estimated
and the true normal. Normals need metric depth, that is the camera's calibration.
"""

from __future__ import annotations

import math

import jax
import numpy as np

from occjax.errors import InputError
from occjax.evaluation.metrics import BORDER, compared_pixels
from occjax.lightfield import Calibration
from occjax.ops.depth import back_project, depth_from_disparity
from occjax.ops.normals import surface_normals
from occjax.ops.precision import in_double

EDGE_ON = 90.0
"""Angle in degrees for a pixel without an estimated surface: as if it were seen edge-on."""


def angular_errors(
    estimate: np.ndarray,
    ground_truth: np.ndarray,
    calibration: Calibration,
    *,
    border: int = BORDER,
    mask: np.ndarray | None = None,
) -> np.ndarray:
    """Angle between the estimated and the true normal at each pixel that is compared.

    Normals are those of plain differences of neighbouring points, also where a surface ends: an
    estimate must not gain by what its own steps hide. A pixel without an estimate counts as 90
    degrees off; one without a true normal is left out. The benchmark prints the median, on planes
    and on other smooth surfaces.

    Args:
        estimate: ``[H, W]`` estimated disparity, pixels per view step.
        ground_truth: ``[H, W]`` true disparity, pixels per view step.
        calibration: Of the cameras.
        border: Pixels left out at each side of the image.
        mask: ``[H, W]`` of booleans: True on the surfaces. None is everywhere.

    Returns:
        ``[N]`` degrees, row by row.

    Raises:
        InputError: If the maps do not fit each other, are too small to have neighbours in both
            directions, or nothing is left to compare.

    Example:
        >>> camera = Calibration(100.0, 35.0, baseline_mm=50.0, focus_distance_m=7.0)
        >>> wall = np.zeros((5, 5))
        >>> angular_errors(wall + 0.3, wall, camera, border=2).round(6).tolist()
        [0.0]
    """
    compared_pixels(estimate, ground_truth, border=border, mask=mask)  # the sizes, first of all
    if min(ground_truth.shape) < 2:
        raise InputError(
            f"a map of {list(ground_truth.shape)} has no normals; it needs 2 pixels in each "
            "direction"
        )
    true = in_double(_normals, ground_truth, calibration)
    known = np.isfinite(true).all(-1)
    pixels = compared_pixels(
        estimate, np.where(known, ground_truth, np.nan), border=border, mask=mask
    )
    true = true[pixels]
    estimated = in_double(_normals, estimate, calibration)[pixels]
    # The arc cosine of the product would lose small angles to rounding.
    sine = np.linalg.norm(np.cross(estimated, true), axis=-1)
    angles = np.degrees(np.arctan2(sine, np.sum(estimated * true, axis=-1)))
    return np.where(np.isnan(angles), EDGE_ON, angles)


def _normals(disparity: jax.Array, calibration: Calibration) -> jax.Array:
    depth = depth_from_disparity(disparity, calibration)
    return surface_normals(back_project(depth, calibration), edge=math.inf)
