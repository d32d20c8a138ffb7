"""Reading the folder of files that an estimate was written to."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from occjax.errors import InputError
from occjax.io.arrays import read_npy
from occjax.io.files import decoding
from occjax.io.maps import read_map
from occjax.lightfield import Calibration
from occjax.results.summary import SUMMARY, read_calibration


class StoredResult(NamedTuple):
    """The arrays of a folder of results; None is a file that was not written.

    Attributes:
        disparity: ``[H, W]`` float, pixels per view step.
        confidence: ``[H, W]`` in [0, 1].
        occlusion: ``[V, U, H, W]`` in [0, 1].
        calibration: Camera parameters.
        summary: Content of ``summary.json`` (:mod:`occjax.results.summary`); empty without one.
    """

    disparity: np.ndarray
    confidence: np.ndarray | None
    occlusion: np.ndarray | None
    calibration: Calibration | None
    summary: dict[str, Any]


def read_result(path: str | Path) -> StoredResult:
    """Read a folder of results, or a single disparity map.

    Args:
        path: Folder that :func:`occjax.results.outputs.write_outputs` wrote, or a disparity map.

    Returns:
        The arrays.

    Raises:
        InputError: If there is no disparity map, or a file is damaged or has another size.

    Example:
        >>> import tempfile
        >>> folder = Path(tempfile.mkdtemp())
        >>> np.save(folder / "disparity.npy", np.zeros((4, 5), np.float32))
        >>> read_result(folder).disparity.shape
        (4, 5)
    """
    path = Path(path)
    if not path.exists():
        raise InputError(f"{path}: does not exist; pass a folder that occjax estimate wrote")
    folder = path if path.is_dir() else path.parent
    if not path.is_dir():
        return StoredResult(read_map(path, quantity="disparity").values, None, None, None, {})
    stored = folder / "disparity.npy"
    disparity = read_map(stored if stored.is_file() else folder).values
    confidence, occlusion = (
        read_npy(file) if file.is_file() else None
        for file in (folder / "confidence.npy", folder / "occlusion.npy")
    )
    for name, array in (("confidence", confidence), ("occlusion", occlusion)):
        if array is not None and array.shape[-2:] != disparity.shape:
            raise InputError(
                f"{folder / name}.npy is {list(array.shape)} but the disparity is "
                f"{list(disparity.shape)}; estimate again"
            )
    summary, calibration = {}, None
    if (folder / SUMMARY).is_file():
        with decoding(folder / SUMMARY, "a summary of results", remedy="estimate again"):
            summary = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
        calibration = read_calibration(folder / SUMMARY)
    return StoredResult(disparity, confidence, occlusion, calibration, summary)
