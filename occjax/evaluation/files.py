"""Comparing disparity maps that lie in files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from occjax.errors import InputError
from occjax.evaluation.metrics import BORDER, THRESHOLDS, Metrics, evaluate
from occjax.io.files import reading
from occjax.io.pfm import read_pfm


def evaluate_files(
    estimate_path: Path | str,
    ground_truth_path: Path | str,
    *,
    thresholds: tuple[float, ...] = THRESHOLDS,
    border: int = BORDER,
) -> Metrics:
    """Every measure of the paper's tables for two files.

    Args:
        estimate_path: Estimated disparity ``[H, W]``, PFM or NPY, pixels per view step.
        ground_truth_path: True disparity ``[H, W]``, PFM or NPY, pixels per view step.
        thresholds: Thresholds of BadPix, pixels per view step.
        border: Pixels left out at each side of the image.

    Returns:
        The measures; see :class:`occjax.evaluation.Metrics`.

    Raises:
        InputError: If a file cannot be read as a disparity map, or the maps cannot be compared; the
            message names the files.
    """
    estimate = read_disparity(estimate_path)
    ground_truth = read_disparity(ground_truth_path)
    try:
        return evaluate(estimate, ground_truth, thresholds=thresholds, border=border)
    except InputError as error:
        raise InputError(f"{estimate_path} against {ground_truth_path}: {error}") from None


def read_disparity(path: Path | str) -> np.ndarray:
    """Read one disparity map.

    Args:
        path: A ``.pfm`` or ``.npy`` file.

    Returns:
        ``[H, W]`` floating point, pixels per view step.

    Raises:
        InputError: If the file does not hold one map of real numbers.
    """
    path = Path(path)
    readers = {".pfm": read_pfm, ".npy": _read_npy}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"{path}: not a disparity map; pass a .pfm or .npy file")
    disparity = reader(path)
    if disparity.ndim != 2 or disparity.size == 0:
        raise InputError(
            f"{path}: holds {list(disparity.shape)}, not a disparity map [H, W]; pass one map"
        )
    return disparity


def _read_npy(path: Path) -> np.ndarray:
    try:
        with reading(path):
            array = np.load(path, allow_pickle=False)
    except (ValueError, EOFError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: not a complete NPY array of numbers; save it again") from error
    if not (isinstance(array, np.ndarray) and np.issubdtype(array.dtype, np.floating)):
        raise InputError(f"{path}: does not hold floating point disparities; save it as float32")
    return array
