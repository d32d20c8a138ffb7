"""The HDF5 files of the old HCI benchmark (Wanner, Meister and Goldluecke, 2013).

The views are in the data set ``LF`` ``[V, U, H, W, C]``; attributes of the file describe the
camera. ``GT_DEPTH`` is metric depth, which its authors relate to disparity by
``Z = B f / (d + shift)``: baseline ``dH``, focal length ``focalLength`` in pixels. The shift puts
zero disparity at the distance ``camDistance`` where the cameras converge.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from occjax.errors import InputError
from occjax.io.arrays import check_views
from occjax.io.files import reading
from occjax.lightfield import Calibration, LightField


def read_hdf5(path: str | Path) -> LightField:
    """Read a light field of the old HCI benchmark.

    Args:
        path: HDF5 file with the data set ``LF``. With the attributes ``dH``, ``focalLength`` and
            ``camDistance`` it gives a calibration, and its ``GT_DEPTH``, if there, the disparity of
            the centre view.

    Raises:
        InputError: If h5py is not installed, or the file is not such a file.
    """
    path = Path(path)
    try:
        import h5py
    except ImportError as error:
        raise InputError(
            f"{path}: reading HDF5 needs h5py; run pip install 'occjax[published]'"
        ) from error
    with reading(path):
        path.open("rb").close()
    try:
        with h5py.File(path, "r") as file:
            if "LF" not in file:
                raise InputError(
                    f"{path}: has no data set 'LF' (it has: {', '.join(file) or 'none'}); "
                    "give a light field of the old HCI benchmark"
                )
            views = check_views(path, np.asarray(file["LF"]))
            attributes = {**dict(file["LF"].attrs), **dict(file.attrs)}
            depth = np.asarray(file["GT_DEPTH"]) if "GT_DEPTH" in file else None
    except OSError as error:
        raise InputError(f"{path}: not a whole HDF5 file; copy it again") from error
    camera = {name: _scalar(attributes.get(name)) for name in ("dH", "focalLength", "camDistance")}
    if None in camera.values():
        return LightField(views=views, name=path.stem, source=path)
    baseline, focal_pixels, focus = (float(value) for value in camera.values() if value is not None)
    calibration = _calibration(baseline, focal_pixels, focus, views.shape[2:4])
    return LightField(
        views=views,
        name=path.stem,
        source=path,
        calibration=calibration,
        ground_truth=_disparity(depth, calibration, views.shape[:4]),
    )


def _scalar(value: Any) -> float | None:
    """An attribute stored as a number or as an array of one, if it is a positive number."""
    try:
        number = float(np.asarray(value, np.float64).reshape(-1)[0])
    except (TypeError, ValueError, IndexError):
        return None
    return number if number > 0.0 else None


def _calibration(
    baseline: float, focal_pixels: float, focus: float, size: tuple[int, ...]
) -> Calibration:
    """Lengths of these files are in metres; a pixel counts as a millimetre of the sensor."""
    return Calibration(
        focal_length_mm=focal_pixels,
        sensor_size_mm=float(max(size)),
        baseline_mm=baseline * 1000.0,
        focus_distance_m=focus,
    )


def _disparity(
    depth: np.ndarray | None, calibration: Calibration, shape: tuple[int, ...]
) -> np.ndarray | None:
    """Disparity of the centre view, if its depth is there and positive."""
    if depth is None:
        return None
    v, u, h, w = shape
    if depth.shape == (v, u, h, w):
        depth = depth[v // 2, u // 2]
    if depth.shape != (h, w) or not np.all(depth > 0.0):
        return None
    return calibration.disparity(depth.astype(np.float64), (h, w)).astype(np.float32)
