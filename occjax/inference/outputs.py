"""The folder of files that an estimate becomes.

====================  ==========================================================================
``disparity.pfm``     disparity, pixels per view step, as this field exchanges it
``disparity.npy``     the same, ``[H, W]`` float32
``disparity.png``     the same as a picture
``confidence.png``    confidence in [0, 1]
``occlusion.png``     occlusion map of each view, if the estimator has them; white is occluded
``depth.npy``         ``[H, W]`` float32 metres, if the light field is calibrated
``points.ply``        coloured points: metres if calibrated, else a relief in pixels
``error.png``         signed error, if there is ground truth
``comparison.png``    centre view, ground truth, estimate and error side by side
``summary.json``      everything in numbers and words
====================  ==========================================================================
"""

from __future__ import annotations

import json
import math
import platform
import resource
import sys
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from occjax.evaluation.metrics import BORDER, THRESHOLDS, Metrics, evaluate
from occjax.inference.result import Estimate
from occjax.io.atomic import atomic_folder
from occjax.io.pfm import write_pfm
from occjax.io.ply import write_ply
from occjax.lightfield import Calibration, LightField, to_unit_float
from occjax.viz.canvas import save
from occjax.viz.figures import (
    comparison_figure,
    confidence_figure,
    disparity_figure,
    error_figure,
    occlusion_figure,
)


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
        folder: Where the files shall be. If it is there already, files of the same name are
            replaced and others left alone.

    Returns:
        What was written; see the table at the top of this module.

    Raises:
        InputError: If the folder cannot be written.
    """
    folder = Path(folder)
    metrics = compare(estimate.disparity, light_field.ground_truth)
    notes = (*estimate.notes, *_notes(light_field, metrics))
    with atomic_folder(folder) as temporary:
        _write_maps(estimate, temporary)
        _write_geometry(estimate.disparity, light_field, temporary)
        _write_comparison(estimate.disparity, light_field, metrics, temporary)
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


def back_project(
    disparity: np.ndarray, calibration: Calibration | None
) -> tuple[np.ndarray, np.ndarray]:
    """Where the pixels of the centre view are in space: x to the right, y up, z to the viewer.

    With a calibration in metres from the centre camera, by the pinhole model and the depth formula
    of the HCI benchmark: ``(X, Y, Z) = depth * ((x - x0) / f, (y0 - y) / f, -1)`` with
    ``f = focal_length / sensor_size * max(H, W)`` pixels. Without one, a relief in pixels:
    ``(x - x0, y0 - y, disparity * max(H, W) / 8)``; in front and behind are right, the depth's
    scale is arbitrary.

    Args:
        disparity: ``[H, W]`` pixels per view step.
        calibration: Camera parameters, if known.

    Returns:
        ``[H, W, 3]`` points, not finite where the disparity or the depth is not; and ``[H, W]``
        whether each of them is finite.

    Example:
        >>> points, _ = back_project(np.array([[0.0, 0.5], [0.0, 0.0]]), None)
        >>> points[0, 1].tolist()
        [0.5, 0.5, 0.125]
    """
    height, width = disparity.shape
    y, x = np.mgrid[:height, :width].astype(np.float64)
    right, up = x - 0.5 * (width - 1), 0.5 * (height - 1) - y
    if calibration is None:
        relief = np.asarray(disparity, np.float64) * max(height, width) / 8.0
        points = np.stack([right, up, relief], axis=-1)
    else:
        focal = calibration.focal_length_mm / calibration.sensor_size_mm * max(height, width)
        depth = calibration.depth(disparity, (height, width))
        depth = np.where(np.isfinite(depth), depth, np.nan)
        points = np.stack([right / focal * depth, up / focal * depth, -depth], axis=-1)
    return points, np.isfinite(points).all(axis=-1)


def summary(
    estimate: Estimate, light_field: LightField, metrics: Metrics | None, notes: tuple[str, ...]
) -> dict[str, Any]:
    """What ``summary.json`` holds; values that do not exist are null.

    Args:
        estimate: What an estimator returned.
        light_field: What it was estimated from.
        metrics: Comparison with the ground truth.
        notes: Sentences the user should hear.
    """
    return {
        "scene": light_field.name,
        "source": None if light_field.source is None else str(light_field.source),
        "grid": list(light_field.grid),
        "image_size": list(light_field.image_size),
        "model": estimate.model,
        "weights": estimate.weights,
        "searched_disparity_range": [float(value) for value in estimate.disparity_range],
        "disparity": _statistics(estimate.disparity),
        "confidence": _statistics(estimate.confidence),
        "metrics": None if metrics is None else metrics.as_dict(),
        "seconds": {phase: round(float(time), 3) for phase, time in estimate.seconds.items()},
        "peak_memory_mb": round(peak_memory_bytes() / 1e6, 1),
        "versions": {
            "occjax": metadata.version("occjax"),
            "jax": metadata.version("jax"),
            "numpy": np.__version__,
            "python": platform.python_version(),
        },
        "notes": list(notes),
    }


def peak_memory_bytes() -> int:
    """Largest memory that this process has had so far; that of a GPU does not count."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


def _notes(light_field: LightField, metrics: Metrics | None) -> list[str]:
    """What the files assume."""
    notes = []
    if light_field.calibration is None:
        notes.append(
            "no calibration: points.ply is a relief in pixels whose depth has no true scale, "
            "and there is no depth.npy"
        )
    if light_field.ground_truth is not None:
        if metrics is None:
            notes.append("the ground truth has no finite value to compare with")
        elif metrics.border == 0:
            notes.append(f"the image is too small to leave out a border of {BORDER} pixels")
    return notes


def _write_maps(estimate: Estimate, folder: Path) -> None:
    """Disparity, confidence and occlusion."""
    disparity = np.asarray(estimate.disparity, np.float32)
    write_pfm(folder / "disparity.pfm", disparity)
    np.save(folder / "disparity.npy", disparity)
    save(disparity_figure(disparity), folder / "disparity.png")
    save(confidence_figure(estimate.confidence), folder / "confidence.png")
    if estimate.occlusion is not None:
        save(occlusion_figure(estimate.occlusion), folder / "occlusion.png")


def _write_geometry(disparity: np.ndarray, light_field: LightField, folder: Path) -> None:
    """Depth and points."""
    calibration = light_field.calibration
    if calibration is not None:
        depth = calibration.depth(disparity, light_field.image_size)
        np.save(folder / "depth.npy", depth.astype(np.float32))
    points, finite = back_project(disparity, calibration)
    colours = np.floor(np.clip(to_unit_float(light_field.centre), 0.0, 1.0) * 255.0 + 0.5)
    colours = np.broadcast_to(colours, points.shape).astype(np.uint8)
    unit = (
        "metres; x right, y up, z to the viewer; centre camera at the origin"
        if calibration is not None
        else "pixels; x right, y up, z = disparity * max(H, W) / 8 to the viewer"
    )
    write_ply(folder / "points.ply", points[finite], colours[finite], comment=unit)


def _write_comparison(
    disparity: np.ndarray, light_field: LightField, metrics: Metrics | None, folder: Path
) -> None:
    """Error map and the overview."""
    truth = light_field.ground_truth
    if metrics is None or truth is None:
        save(comparison_figure(light_field.centre, disparity), folder / "comparison.png")
        return
    threshold = THRESHOLDS[0]
    bad = f"BadPix {threshold:g}: {metrics.badpix[threshold]:.2f} %"
    border = metrics.border
    title = f"Error   {bad}   MSE x100: {metrics.mse_x100:.3f}"
    error = error_figure(disparity, truth, title=title, bad=threshold, border=border)
    save(error, folder / "error.png")
    overview = comparison_figure(
        light_field.centre, disparity, truth, score=bad, bad=threshold, border=border
    )
    save(overview, folder / "comparison.png")


def _statistics(values: np.ndarray) -> dict[str, float | int | None]:
    """Range and mean of the finite values; JSON has no NaN."""
    finite = np.asarray(values, np.float64)[np.isfinite(values)]
    numbers = (finite.min(), finite.max(), finite.mean()) if finite.size else (math.nan,) * 3
    smallest, largest, mean = (None if math.isnan(n) else round(float(n), 6) for n in numbers)
    return {
        "minimum": smallest,
        "maximum": largest,
        "mean": mean,
        "missing": int(values.size - finite.size),
    }
