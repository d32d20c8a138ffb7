"""Evaluation of disparity maps in files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from occjax.errors import InputError
from occjax.evaluation.metrics import BORDER, THRESHOLDS, Metrics, evaluate
from occjax.evaluation.scene_files import GROUND_TRUTH, is_scene
from occjax.io.maps import read_map


def evaluate_files(
    estimate_path: Path | str,
    ground_truth_path: Path | str,
    *,
    thresholds: tuple[float, ...] = THRESHOLDS,
    border: int = BORDER,
) -> Metrics:
    """Compute all measures of the paper's tables for two files.

    Args:
        estimate_path: Estimated disparity ``[H, W]``, pixels per view step: a PFM, NPY or PNG file
            (:func:`occjax.io.read_map`), or a folder of results.
        ground_truth_path: True disparity ``[H, W]``: such a file, a folder of results, or the
            folder of a scene with ``gt_disp_lowres.pfm``.
        thresholds: Thresholds of BadPix, pixels per view step.
        border: Pixels left out on each side of the image.

    Returns:
        The :class:`occjax.evaluation.Metrics`.

    Raises:
        InputError: If a file cannot be read as a disparity map, or the maps cannot be compared; the
            message names the files.

    Example:
        >>> import tempfile
        >>> folder = Path(tempfile.mkdtemp())
        >>> np.save(folder / "truth.npy", np.zeros((4, 5)))
        >>> np.save(folder / "estimate.npy", np.full((4, 5), 0.5))
        >>> evaluate_files(folder / "estimate.npy", folder / "truth.npy", border=0).mse_x100
        25.0
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
    """Read a disparity map.

    Args:
        path: A ``.pfm``, ``.npy`` or ``.png`` file (:func:`occjax.io.read_map`), or a folder of
            results, whose ``disparity.pfm`` is read.

    Returns:
        ``[H, W]`` floating point, pixels per view step.

    Raises:
        InputError: If the file does not contain one map of real numbers.

    Example:
        >>> import tempfile
        >>> path = Path(tempfile.mkdtemp()) / "disparity.npy"
        >>> np.save(path, np.array([[1, 2]]))
        >>> read_disparity(path).tolist()
        [[1.0, 2.0]]
    """
    return read_map(path, quantity="disparity").values
