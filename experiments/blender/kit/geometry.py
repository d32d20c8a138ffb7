"""Camera rig that fits a scene's depth: baseline, focus distance and sensor shifts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

SENSOR_SIZE_MM = 36.0
"""Length of the longer side of the sensor, in millimetres."""


class Rig(NamedTuple):
    """Grid of parallel cameras whose images coincide at the focus distance.

    Attributes:
        focal_length_mm: Focal length of each camera.
        sensor_size_mm: Longer side of each sensor.
        baseline_mm: Distance between neighbouring cameras.
        focus_distance_m: Distance of the plane of zero disparity.
    """

    focal_length_mm: float
    sensor_size_mm: float
    baseline_mm: float
    focus_distance_m: float

    def offset(self, row_step: float | int, column_step: float | int) -> tuple[float, float]:
        """Return metres right and up of the centre camera for view steps down and right."""
        return column_step * self.baseline_mm / 1000.0, -row_step * self.baseline_mm / 1000.0

    def sensor_shift(self, right: float, up: float) -> tuple[float, float]:
        """Return the sensor shift of a camera at an offset, in units of the longer side.

        The point at the focus distance on the axis of the centre camera lies at ``-offset`` from
        the axis of the other camera, whose sensor is shifted so that the point is in its centre.
        """
        factor = self.focal_length_mm / (self.focus_distance_m * self.sensor_size_mm)
        return -right * factor, -up * factor


def fit_rig(depth: np.ndarray, disparity_range: tuple[float, float], focal_length_mm: float) -> Rig:
    """Return the rig whose disparities of a depth map span a given range.

    Disparity is linear in inverse depth, ``d = f * b * (1 / depth - 1 / focus)`` with the focal
    length ``f`` in pixels, so the two ends of the range determine baseline and focus.

    Args:
        depth: ``[h, w]`` depth of the centre view, metres along its optical axis.
        disparity_range: Minimum and maximum disparity, pixels per view step.
        focal_length_mm: Focal length for a sensor of :data:`SENSOR_SIZE_MM`.
    """
    low, high = disparity_range
    far, near = 1.0 / float(depth.max()), 1.0 / float(depth.min())
    # A single plane has no spread: its inverse depth is taken to vary by a thousandth.
    spread = max(near - far, 1e-3 * near)
    focal_length_pixels = focal_length_mm / SENSOR_SIZE_MM * max(depth.shape)
    baseline = (high - low) / (focal_length_pixels * spread)
    focus = 1.0 / (far - low / (focal_length_pixels * baseline))
    return Rig(focal_length_mm, SENSOR_SIZE_MM, 1000.0 * baseline, focus)
