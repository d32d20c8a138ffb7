"""Errors of surface normals.

A slightly tilted surface has small disparity errors everywhere, but its shading and reconstructions
from it are wrong. The HCI 4D benchmark therefore measures the angle between the estimated and the
true normal. Normals need metric depth, and that needs the camera's calibration.
"""

from __future__ import annotations

import math

import jax
import numpy as np

from occjax.errors import InputError
from occjax.evaluation.metrics import BORDER, compared_pixels
from occjax.lightfield import Calibration
from occjax.ops.geometry import back_project, depth_from_disparity, in_double, surface_normals


def angular_errors(
    estimate: np.ndarray,
    ground_truth: np.ndarray,
    calibration: Calibration,
    *,
    border: int = BORDER,
    mask: np.ndarray | None = None,
) -> np.ndarray:
    """Compute the angle between the estimated and the true normal at each compared pixel.

    Normals are computed from central differences of points, also across depth edges, so that false
    steps in an estimate are not hidden. A pixel without an estimated normal has an error of 90
    degrees; a pixel without a true normal is left out. The benchmark reports the median, on planes
    and on other smooth surfaces.

    Args:
        estimate: ``[H, W]`` estimated disparity, pixels per view step.
        ground_truth: ``[H, W]`` true disparity, pixels per view step.
        calibration: Camera parameters.
        border: Pixels left out on each side of the image.
        mask: ``[H, W]`` boolean, True on the surfaces; None for all pixels.

    Returns:
        ``[N]`` degrees, in row-major order of the compared pixels.

    Raises:
        InputError: If the maps do not fit each other, have fewer than 2 rows or columns, or no
            pixel is left to compare.

    Example:
        >>> camera = Calibration(100.0, 35.0, baseline_mm=50.0, focus_distance_m=7.0)
        >>> wall = np.zeros((5, 5))
        >>> angular_errors(wall + 0.3, wall, camera, border=2).round(6).tolist()
        [0.0]
    """
    compared_pixels(estimate, ground_truth, border=border, mask=mask)  # checks the sizes first
    if min(ground_truth.shape) < 2:
        raise InputError(
            f"a map of {list(ground_truth.shape)} has no normals; it needs at least 2 pixels in "
            "each direction"
        )
    true = in_double(_normals, ground_truth, calibration)
    known = np.isfinite(true).all(-1)
    pixels = compared_pixels(
        estimate, np.where(known, ground_truth, np.nan), border=border, mask=mask
    )
    true = true[pixels]
    estimated = in_double(_normals, estimate, calibration)[pixels]
    # The arc cosine of the scalar product would round small angles to zero.
    sine = np.linalg.norm(np.cross(estimated, true), axis=-1)
    angles = np.degrees(np.arctan2(sine, np.sum(estimated * true, axis=-1)))
    return np.where(np.isnan(angles), 90.0, angles)


def _normals(disparity: jax.Array, calibration: Calibration) -> jax.Array:
    depth = depth_from_disparity(disparity, calibration)
    return surface_normals(back_project(depth, calibration), edge=math.inf)
