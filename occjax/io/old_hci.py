"""Camera and ground truth of the old HCI benchmark (Wanner, Meister and Goldluecke, 2013).

Attributes of its HDF5 files describe the camera. ``GT_DEPTH`` is metric depth, which is related to
disparity by ``d = B f / Z - shift``: baseline ``B`` (``dH``), focal length ``f`` (``focalLength``)
in pixels. The cameras converge at the distance ``B f / shift``, which ``camDistance`` gives if
there is no ``shift``.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from occjax.io.arrays import check_ground_truth
from occjax.lightfield import Calibration, centre_index


def old_hci_camera(
    attributes: Mapping[str, Any], size: tuple[int, ...]
) -> tuple[Calibration | None, tuple[str, ...]]:
    """Read the camera from the attributes of a file.

    Args:
        attributes: Attributes, numbers or arrays of one number; lengths in metres.
        size: ``(H, W)`` of the views, in pixels.

    Returns:
        The camera, with one pixel taken as one millimetre of the sensor, and the names of the
        missing attributes, without which it is None.

    Example:
        >>> old_hci_camera({"dH": 0.1, "focalLength": 500, "shift": [10]}, (4, 6))[0]
        Calibration(focal_length_mm=500.0, sensor_size_mm=6.0, baseline_mm=100.0, \
focus_distance_m=5.0)
    """
    baseline, focal_pixels, shift, focus = (
        _number(attributes.get(name)) for name in ("dH", "focalLength", "shift", "camDistance")
    )
    missing = []
    if baseline is None or baseline <= 0.0:
        missing.append("dH")
    if focal_pixels is None or focal_pixels <= 0.0:
        missing.append("focalLength")
    if shift is None and (focus is None or focus <= 0.0):
        missing.append("shift (or camDistance)")
    if missing or baseline is None or focal_pixels is None:
        return None, tuple(missing)
    if shift is not None:
        focus = baseline * focal_pixels / shift if shift else np.inf
    calibration = Calibration(
        focal_length_mm=focal_pixels,
        sensor_size_mm=float(max(size)),
        baseline_mm=baseline * 1000.0,
        focus_distance_m=float(focus or np.inf),
    )
    return calibration, ()


def old_hci_disparity(
    path: Path, depth: np.ndarray, calibration: Calibration, shape: tuple[int, ...]
) -> np.ndarray:
    """Return the disparity of the centre view.

    Args:
        path: File, for messages.
        depth: ``[V, U, H, W]`` or ``[H, W]`` metric depth.
        calibration: Camera of the file.
        shape: ``(V, U, H, W)`` of the views.

    Returns:
        ``[H, W]`` float32, NaN where the depth is not positive or marks a pixel without depth.
    """
    if depth.shape == tuple(shape):
        depth = depth[centre_index(shape[:2])]
    # Blender writes 1e10 m at pixels without depth.
    depth = np.where((depth > 0.0) & (depth < 1e9), depth, np.nan).astype(np.float64)
    with np.errstate(over="ignore"):  # a depth of almost zero has an infinite disparity
        disparity = calibration.disparity(depth, (shape[2], shape[3]))
    return check_ground_truth(path, disparity, shape[2:])


def _number(value: Any) -> float | None:
    """Return an attribute, stored as a number or an array of one, if it is a finite number."""
    try:
        number = float(np.asarray(value, np.float64).reshape(-1)[0])
    except (TypeError, ValueError, IndexError):
        return None
    return number if np.isfinite(number) else None
