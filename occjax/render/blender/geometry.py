"""From the depth of a scene to its cameras: baseline, focus and shifted sensors."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

SENSOR_SIZE_MM = 36.0
"""Longer side of the sensor."""


class Rig(NamedTuple):
    """A grid of parallel cameras whose pictures coincide at one distance.

    Attributes:
        focal_length_mm: Of each camera.
        sensor_size_mm: Longer side of each sensor.
        baseline_mm: Distance of neighbouring cameras.
        focus_distance_m: Distance of the plane whose disparity is zero.
    """

    focal_length_mm: float
    sensor_size_mm: float
    baseline_mm: float
    focus_distance_m: float

    def offset(self, row_step: float | int, column_step: float | int) -> tuple[float, float]:
        """Metres to the right and up of the centre camera, for steps down and to the right."""
        return column_step * self.baseline_mm / 1000.0, -row_step * self.baseline_mm / 1000.0

    def sensor_shift(self, right: float, up: float) -> tuple[float, float]:
        """Shift of the sensor of a camera at an offset, in units of its longer side.

        A point at the focus distance that the centre camera has in its middle lies ``-offset`` from
        the axis of the other camera, and the middle of that one's sensor has to be there.
        """
        factor = self.focal_length_mm / (self.focus_distance_m * self.sensor_size_mm)
        return -right * factor, -up * factor


def fit_rig(depth: np.ndarray, disparity_range: tuple[float, float], focal_length_mm: float) -> Rig:
    """Baseline and focus that spread a depth map over a range of disparities.

    Disparity is linear in inverse depth, ``d = f * b * (1 / depth - 1 / focus)`` with the focal
    length ``f`` in pixels, so the two ends of the range determine both.

    Args:
        depth: ``[h, w]`` of the centre view, metres along its axis.
        disparity_range: Least and greatest disparity in pixels per view step.
        focal_length_mm: On the sensor of :data:`SENSOR_SIZE_MM`.
    """
    low, high = disparity_range
    far, near = 1.0 / float(depth.max()), 1.0 / float(depth.min())
    # A picture of one plane: as if its depth varied by a thousandth, all of it at the far end.
    spread = max(near - far, 1e-3 * near)
    focal_length_pixels = focal_length_mm / SENSOR_SIZE_MM * max(depth.shape)
    baseline = (high - low) / (focal_length_pixels * spread)
    focus = 1.0 / (far - low / (focal_length_pixels * baseline))
    return Rig(focal_length_mm, SENSOR_SIZE_MM, 1000.0 * baseline, focus)
