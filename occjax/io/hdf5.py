"""HDF5 files of the old HCI benchmark (Wanner, Meister and Goldluecke, 2013).

The data set ``LF`` ``[V, U, H, W, C]`` contains the views; attributes of the file describe the
camera. ``GT_DEPTH`` is metric depth, which is related to disparity by ``Z = B f / (d + shift)``:
baseline ``dH``, focal length ``focalLength`` in pixels. The shift puts zero disparity at the
distance ``camDistance`` where the cameras converge.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from occjax.errors import InputError
from occjax.io.arrays import check_views
from occjax.io.files import decoding
from occjax.lightfield import Calibration, LightField, centre_index


def read_hdf5(path: str | Path) -> LightField:
    """Read a light field of the old HCI benchmark.

    Args:
        path: HDF5 file with the data set ``LF``. If it has the attributes ``dH``, ``focalLength``
            and ``camDistance``, the light field has a calibration, and a ground truth if there is
            also a data set ``GT_DEPTH``.

    Returns:
        The light field, named after the file.

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
    with decoding(path, "an HDF5 file"), h5py.File(path, "r") as file:
        if "LF" not in file:
            raise InputError(
                f"{path}: has no data set 'LF' (it has: {', '.join(file) or 'none'}); "
                "give a light field of the old HCI benchmark"
            )
        views = check_views(path, np.asarray(file["LF"]))
        attributes = {**dict(file["LF"].attrs), **dict(file.attrs)}
        depth = np.asarray(file["GT_DEPTH"]) if "GT_DEPTH" in file else None
    baseline, focal_pixels, focus = (
        _positive_number(attributes.get(name)) for name in ("dH", "focalLength", "camDistance")
    )
    if baseline is None or focal_pixels is None or focus is None:
        return LightField(views=views, name=path.stem, source=path)
    # Lengths in these files are in metres. One pixel is taken as one millimetre of the sensor.
    calibration = Calibration(
        focal_length_mm=focal_pixels,
        sensor_size_mm=float(max(views.shape[2:4])),
        baseline_mm=baseline * 1000.0,
        focus_distance_m=focus,
    )
    return LightField(
        views=views,
        name=path.stem,
        source=path,
        calibration=calibration,
        ground_truth=_disparity(depth, calibration, views.shape[:4]),
    )


def _positive_number(value: Any) -> float | None:
    """Return an attribute, stored as a number or an array of one, if it is a positive number."""
    try:
        number = float(np.asarray(value, np.float64).reshape(-1)[0])
    except (TypeError, ValueError, IndexError):
        return None
    return number if number > 0.0 else None


def _disparity(
    depth: np.ndarray | None, calibration: Calibration, shape: tuple[int, ...]
) -> np.ndarray | None:
    """Return the disparity of the centre view, if its depth is known and positive."""
    if depth is None:
        return None
    if depth.shape == shape:
        depth = depth[centre_index(shape[:2])]
    if depth.shape != shape[2:] or not np.all(depth > 0.0):
        return None
    return calibration.disparity(depth.astype(np.float64), depth.shape).astype(np.float32)
