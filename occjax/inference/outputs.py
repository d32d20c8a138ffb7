"""The folder of files that an estimate becomes.

====================  ==========================================================================
``disparity.pfm``     disparity, pixels per view step, as this field exchanges it
``disparity.npy``     the same, ``[H, W]`` float32
``disparity.png``     the same as a picture
``confidence.png``    confidence in [0, 1]
``occlusion.png``     occlusion map of each view, if the estimator has them; white is occluded
``depth.npy``         ``[H, W]`` float32 metres, if the light field is calibrated
``points.ply``        coloured points: metres if calibrated, else a relief in pixels; without those
                      pixels that have no signal (:func:`has_signal`)
``error.png``         signed error, if there is ground truth
``comparison.png``    centre view, ground truth, estimate and error side by side
``summary.json``      everything in numbers and words, see :mod:`occjax.inference.summary`
====================  ==========================================================================
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from occjax.evaluation.metrics import BORDER, THRESHOLDS, Metrics, evaluate
from occjax.inference.conversion import convert_map, point_cloud, write_points
from occjax.inference.result import Estimate
from occjax.inference.summary import summary
from occjax.io.atomic import atomic_folder
from occjax.io.maps import Map
from occjax.io.pfm import write_pfm
from occjax.lightfield import LightField, to_unit_float
from occjax.viz.canvas import save
from occjax.viz.figures import (
    comparison_figure,
    confidence_figure,
    disparity_figure,
    error_figure,
    occlusion_figure,
)

FILES = (
    "comparison.png",
    "confidence.png",
    "depth.npy",
    "disparity.npy",
    "disparity.pfm",
    "disparity.png",
    "error.png",
    "occlusion.png",
    "points.ply",
    "summary.json",
)
"""Every name that an estimate may write."""

LEAST_CONFIDENCE = 1e-3
"""Confidence below which all candidates are as good as equally probable."""


@dataclass(frozen=True)
class Outputs:
    """What was written.

    Attributes:
        folder: The folder of the scene.
        paths: The files in it that were written now, in alphabetical order.
        notes: Sentences the user should hear: those of the estimate, and what the files assume.
        metrics: Comparison with the ground truth, if there is one.
    """

    folder: Path
    paths: tuple[Path, ...]
    notes: tuple[str, ...]
    metrics: Metrics | None


def write_outputs(estimate: Estimate, light_field: LightField, folder: str | Path) -> Outputs:
    """Write an estimate as files, all of them or none.

    Args:
        estimate: What an estimator returned.
        light_field: What it was estimated from.
        folder: Where the files shall be. If it is there already, files of the names in the table
            are replaced, or removed if this estimate has none of them, so that all results in it
            belong together; other files are left alone.

    Returns:
        What was written; see the table at the top of this module.

    Raises:
        InputError: If the folder cannot be written.
    """
    folder = Path(folder)
    metrics = compare(estimate.disparity, light_field.ground_truth)
    signal = has_signal(light_field, estimate.confidence)
    notes = (*estimate.notes, *_notes(light_field, metrics, signal))
    with atomic_folder(folder, owned=FILES) as temporary:
        _write_maps(estimate, light_field.ground_truth, temporary)
        _write_geometry(estimate.disparity, light_field, signal, temporary)
        _write_comparison(estimate, light_field, metrics, temporary)
        text = json.dumps(summary(estimate, light_field, metrics, notes), indent=2)
        (temporary / "summary.json").write_text(text + "\n", encoding="utf-8")
        names = sorted(path.name for path in temporary.iterdir())
    return Outputs(folder, tuple(folder / name for name in names), notes, metrics)


def compare(disparity: np.ndarray, ground_truth: np.ndarray | None) -> Metrics | None:
    """Metrics against the ground truth, if there is any to compare with.

    Images too small to leave out the benchmark's border of 15 pixels are compared as a whole.

    Args:
        disparity: ``[H, W]`` estimate, pixels per view step.
        ground_truth: ``[H, W]`` pixels per view step, or None.
    """
    if ground_truth is None:
        return None
    border = BORDER if min(disparity.shape) > 2 * BORDER else 0
    inside = np.s_[border : disparity.shape[0] - border, border : disparity.shape[1] - border]
    if not np.isfinite(ground_truth[inside]).any():
        return None
    return evaluate(disparity, ground_truth, border=border)


def has_signal(light_field: LightField, confidence: np.ndarray) -> np.ndarray:
    """Where there is anything that a disparity can be measured from.

    A pixel has no signal if the centre view is black there (below half a step of 8 bits in every
    channel), as in the corners of a camera's vignetted views, or if its confidence is below
    :data:`LEAST_CONFIDENCE`.

    Args:
        light_field: What the disparity was estimated from.
        confidence: ``[H, W]`` in [0, 1].

    Returns:
        ``[H, W]`` booleans.
    """
    lit = to_unit_float(light_field.centre).max(axis=-1) >= 0.5 / 255.0
    return lit & ~(confidence < LEAST_CONFIDENCE)


def _notes(light_field: LightField, metrics: Metrics | None, signal: np.ndarray) -> list[str]:
    """What the files assume."""
    notes = []
    if light_field.calibration is None:
        notes.append(
            "no calibration: points.ply is a relief in pixels whose depth has no true scale, "
            "and there is no depth.npy"
        )
    if not signal.all():
        notes.append(
            f"points.ply leaves out {np.sum(~signal)} of {signal.size} pixels without signal "
            f"(centre view black, or confidence below {LEAST_CONFIDENCE:g})"
        )
    if light_field.ground_truth is not None:
        if metrics is None:
            notes.append("the ground truth has no finite value to compare with")
        elif metrics.border == 0:
            notes.append(f"the image is too small to leave out a border of {BORDER} pixels")
    return notes


def _write_maps(estimate: Estimate, truth: np.ndarray | None, folder: Path) -> None:
    """Disparity, confidence and occlusion."""
    disparity = np.asarray(estimate.disparity, np.float32)
    write_pfm(folder / "disparity.pfm", disparity)
    np.save(folder / "disparity.npy", disparity)
    confidence = estimate.confidence
    picture = disparity_figure(disparity, confidence=confidence, ground_truth=truth)
    save(picture, folder / "disparity.png")
    save(confidence_figure(confidence), folder / "confidence.png")
    if estimate.occlusion is not None:
        save(occlusion_figure(estimate.occlusion), folder / "occlusion.png")


def _write_geometry(
    disparity: np.ndarray, light_field: LightField, signal: np.ndarray, folder: Path
) -> None:
    """Depth of all pixels, and points of those with signal."""
    content, calibration = Map(disparity, "disparity"), light_field.calibration
    if calibration is not None:
        depth = convert_map(content, "depth", calibration).values
        np.save(folder / "depth.npy", depth.astype(np.float32))
    cloud = point_cloud(content, calibration)
    write_points(folder / "points.ply", cloud, centre=light_field.centre, shown=signal)


def _write_comparison(
    estimate: Estimate, light_field: LightField, metrics: Metrics | None, folder: Path
) -> None:
    """Error map and the overview."""
    disparity, confidence = estimate.disparity, estimate.confidence
    centre, truth = light_field.centre, light_field.ground_truth
    if metrics is None or truth is None:
        overview = comparison_figure(centre, disparity, confidence=confidence)
        save(overview, folder / "comparison.png")
        return
    threshold = THRESHOLDS[0]
    bad = f"BadPix {threshold:g}: {metrics.badpix[threshold]:.2f} %"
    border = metrics.border
    title = f"Error   {bad}   MSE x100: {metrics.mse_x100:.3f}"
    error = error_figure(disparity, truth, title=title, bad=threshold, border=border)
    save(error, folder / "error.png")
    overview = comparison_figure(
        centre, disparity, truth, confidence=confidence, score=bad, bad=threshold, border=border
    )
    save(overview, folder / "comparison.png")
