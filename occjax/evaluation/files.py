"""Evaluation of disparity maps in files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from occjax.errors import InputError, warn
from occjax.evaluation.metrics import (
    BAD_PIXEL_THRESHOLD,
    THRESHOLDS,
    Metrics,
    default_border,
    evaluate,
)
from occjax.evaluation.scene_files import is_scene
from occjax.io.config import ReadingConfig
from occjax.io.containers import CONTAINER_SUFFIXES, read_container
from occjax.io.hci_config import GROUND_TRUTH
from occjax.io.maps import (
    MAP_FILE,
    RESULTS,
    flipped_and_negated_maps,
    map_of_results,
    read_map,
    view_of_map,
)
from occjax.lightfield import view_name


def evaluate_files(
    estimate_path: Path | str,
    ground_truth_path: Path | str,
    *,
    thresholds: tuple[float, ...] = THRESHOLDS,
    border: int | None = None,
) -> Metrics:
    """Compute the metrics of an estimated disparity map; both maps are read from files.

    Args:
        estimate_path: Estimated disparity ``[H, W]``, pixels per view step: a PFM, NPY or PNG file
            (:func:`occjax.io.read_map`), or a folder of results.
        ground_truth_path: True disparity ``[H, W]``: a PFM, NPY or PNG file, a folder of results,
            the folder of a scene with ``gt_disp_lowres.pfm``, or an HDF5 file of a scene with
            ``GT_DEPTH`` (:func:`occjax.io.containers.read_container`).
        thresholds: Thresholds of BadPix, pixels per view step.
        border: Pixels left out on each side of the image; by default
            :func:`occjax.evaluation.default_border`.

    Returns:
        The :class:`occjax.evaluation.Metrics`.

    Raises:
        InputError: If a file cannot be read as a disparity map, or the maps cannot be compared,
            for instance because they belong to different views; the message names the files.

    Warns:
        UserWarning: If the maps agree better after one of them is flipped or negated, or if they
            are identical.

    Example:
        >>> import tempfile
        >>> folder = Path(tempfile.mkdtemp())
        >>> np.save(folder / "truth.npy", np.zeros((4, 5)))
        >>> np.save(folder / "estimate.npy", np.full((4, 5), 0.5))
        >>> evaluate_files(folder / "estimate.npy", folder / "truth.npy", border=0).mse_x100
        25.0
    """
    estimate = read_disparity(estimate_path)
    ground_truth_path = Path(ground_truth_path)
    if is_scene(ground_truth_path):
        ground_truth_path = ground_truth_path / GROUND_TRUTH
    elif ground_truth_path.is_dir():
        accepted = f"the folder of a scene with {GROUND_TRUTH}, {RESULTS}, or a {MAP_FILE}"
        ground_truth_path = map_of_results(ground_truth_path, accepted=accepted)
    check_same_view(Path(estimate_path), ground_truth_path)
    ground_truth = _read_ground_truth(ground_truth_path)
    if np.array_equal(estimate, ground_truth, equal_nan=True):
        warn(
            f"{estimate_path} and {ground_truth_path} are identical, so all errors are 0; "
            "check the paths"
        )
    _warn_if_flipped_or_negated(
        f"{estimate_path} against {ground_truth_path}", estimate, ground_truth
    )
    border = default_border(ground_truth.shape) if border is None else border
    try:
        return evaluate(estimate, ground_truth, thresholds=thresholds, border=border)
    except InputError as error:
        raise InputError(f"{estimate_path} against {ground_truth_path}: {error}") from None


def _read_ground_truth(path: Path) -> np.ndarray:
    """Read the true disparity ``[H, W]`` from a map or from the HDF5 file of a scene."""
    if path.suffix.lower() in CONTAINER_SUFFIXES:
        truth = read_container(path).ground_truth
        if truth is None:
            raise InputError(f"{path}: has no ground truth; name a file of the true disparity")
        return truth
    return read_disparity(path)


def check_same_view(estimate: Path, ground_truth: Path) -> None:
    """Raise an :class:`InputError` if two maps are known to belong to different views.

    Args:
        estimate: File of a disparity map, or folder of results.
        ground_truth: The same, or the ground truth of a scene (``gt_disp_lowres.pfm`` or an HDF5
            file), which always belongs to the centre view.
    """
    estimated, true = view_of_map(estimate), view_of_map(ground_truth)
    if ground_truth.name == GROUND_TRUTH or ground_truth.suffix.lower() in CONTAINER_SUFFIXES:
        true = view_name(None)
    if None not in (estimated, true) and estimated != true:
        raise InputError(
            f"{estimate}: shows the {estimated}, but {ground_truth} shows the {true}; pass two "
            "maps of the same view"
        )


def _warn_if_flipped_or_negated(
    names: str,
    estimate: np.ndarray,
    ground_truth: np.ndarray,
    config: ReadingConfig = ReadingConfig(),
) -> None:
    """Warn if the maps agree much better after one of them is flipped or negated."""
    if estimate.shape != ground_truth.shape:
        return
    unchanged = ""
    readings = {unchanged: ground_truth, **flipped_and_negated_maps(ground_truth)}
    errors = {words: np.abs(estimate - truth) for words, truth in readings.items()}
    errors = {words: error[np.isfinite(error)] for words, error in errors.items()}
    medians = {words: float(np.median(error)) for words, error in errors.items() if error.size}
    if unchanged not in medians:
        return
    best = min(medians, key=medians.__getitem__)
    median, changed = medians[unchanged], medians[best]
    if median > BAD_PIXEL_THRESHOLD and changed < config.max_changed_error_ratio * median:
        warn(
            f"{names}: the maps agree better if in one of them the {best} (median error "
            f"{changed:.3g} instead of {median:.3g}); correct the map that is wrong"
        )


def read_disparity(path: Path | str) -> np.ndarray:
    """Read a disparity map.

    Args:
        path: A ``.pfm``, ``.npy`` or ``.png`` file (:func:`occjax.io.read_map`), or a folder of
            results, whose ``disparity.pfm`` is read.

    Returns:
        ``[H, W]`` floating point, pixels per view step.

    Raises:
        InputError: If the file does not contain one map of real numbers, or if these are too large
            for disparities.

    Example:
        >>> import tempfile
        >>> path = Path(tempfile.mkdtemp()) / "disparity.npy"
        >>> np.save(path, np.array([[1, 2]]))
        >>> read_disparity(path).tolist()
        [[1.0, 2.0]]
    """
    if is_scene(path) and not (Path(path) / "disparity.pfm").is_file():
        raise InputError(
            f"{path}: is the folder of a scene; to compare an estimate with its ground truth, pass "
            f"{RESULTS} or a {MAP_FILE} as well"
        )
    values = read_map(path, quantity="disparity").values
    largest = np.abs(values[np.isfinite(values)]).max(initial=0.0)
    # A disparity larger than the sides of the map moves every point out of the neighbouring view.
    # The factor of ten leaves room for outliers of an estimate, but none for byte-swapped files and
    # other units.
    if largest > 10.0 * max(values.shape):
        raise InputError(
            f"{path}: disparities reach {largest:.4g} pixels per view step in a map of "
            f"{values.shape[0]}x{values.shape[1]} pixels; the file may be byte-swapped or in "
            "another unit"
        )
    return values
