"""Comparing disparity maps that lie in files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from occjax.errors import InputError
from occjax.evaluation.metrics import BORDER, THRESHOLDS, Metrics, evaluate
from occjax.evaluation.scene_files import GROUND_TRUTH, is_scene
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
        estimate_path: Estimated disparity ``[H, W]``, pixels per view step: a PFM or NPY file, or
            a folder of results.
        ground_truth_path: True disparity ``[H, W]``: a PFM or NPY file, a folder of results, or the
            folder of a scene with ``gt_disp_lowres.pfm``.
        thresholds: Thresholds of BadPix, pixels per view step.
        border: Pixels left out at each side of the image.

    Returns:
        The measures; see :class:`occjax.evaluation.Metrics`.

    Raises:
        InputError: If a file cannot be read as a disparity map, or the maps cannot be compared; the
            message names the files.
    """
    estimate = read_disparity(estimate_path)
    if is_scene(ground_truth_path):
        ground_truth_path = Path(ground_truth_path) / GROUND_TRUTH
    ground_truth = read_disparity(ground_truth_path)
    try:
        return evaluate(estimate, ground_truth, thresholds=thresholds, border=border)
    except InputError as error:
        raise InputError(f"{estimate_path} against {ground_truth_path}: {error}") from None


def read_disparity(path: Path | str) -> np.ndarray:
    """Read one disparity map.

    Args:
        path: A ``.pfm`` or ``.npy`` file, or a folder of results, whose ``disparity.pfm`` is read.

    Returns:
        ``[H, W]`` floating point, pixels per view step.

    Raises:
        InputError: If the file does not hold one map of real numbers.

    Example:
        >>> import tempfile
        >>> path = Path(tempfile.mkdtemp()) / "disparity.npy"
        >>> np.save(path, np.array([[1, 2]]))
        >>> read_disparity(path).tolist()
        [[1.0, 2.0]]
    """
    path = Path(path)
    if path.is_dir():
        path = _result_in(path)
    readers = {".pfm": read_pfm, ".npy": _read_npy, ".npz": _refuse_npz}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"{path}: not a disparity map; pass a .pfm or .npy file")
    disparity = reader(path)
    if disparity.ndim != 2 or disparity.size == 0:
        raise InputError(
            f"{path}: holds {list(disparity.shape)}, not a disparity map [H, W]; pass one map"
        )
    return disparity


def _result_in(folder: Path) -> Path:
    """The disparity map that an estimate wrote to a folder."""
    result = folder / "disparity.pfm"
    if not result.is_file():
        raise InputError(
            f"{folder}: a folder without a disparity.pfm, so not one of results; "
            "name a .pfm or .npy file"
        )
    return result


def _read_npy(path: Path) -> np.ndarray:
    try:
        with reading(path):
            array = np.load(path, allow_pickle=False)
    except InputError:
        raise
    # A damaged header may ask for more than any memory.
    except (ValueError, EOFError, MemoryError, OverflowError) as error:
        raise InputError(f"{path}: not a complete NPY array of numbers; save it again") from error
    if isinstance(array, np.ndarray) and np.issubdtype(array.dtype, np.integer):
        return array.astype(np.float64)
    if not (isinstance(array, np.ndarray) and np.issubdtype(array.dtype, np.floating)):
        raise InputError(f"{path}: does not hold real numbers; save the disparities as float32")
    return array


def _refuse_npz(path: Path) -> np.ndarray:
    raise InputError(
        f"{path}: an archive of arrays; save the disparity map alone, as a .npy file (numpy.save)"
    )
