"""The folder of files that an estimate is written to.

====================  ==========================================================================
``disparity.pfm``     disparity, pixels per view step, in the exchange format of this field
``disparity.npy``     the same, ``[H, W]`` float32
``disparity.png``     the same as a figure
``confidence.png``    confidence in [0, 1]
``occlusion.png``     occlusion map of each view, if the estimate has them; white is occluded
``depth.npy``         ``[H, W]`` float32 metres, if the light field is calibrated
``points.ply``        coloured points: metres if calibrated, else pixels; image pixels
                      without signal (:func:`has_signal`) are left out
``error.png``         signed error, if there is ground truth
``comparison.png``    centre view, ground truth, estimate and error next to each other
``summary.json``      settings, scores and timings, see :mod:`occjax.results.summary`
====================  ==========================================================================
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from occjax.estimators import Estimate
from occjax.evaluation.metrics import BAD_PIXEL_THRESHOLD, Metrics, compare
from occjax.io.atomic import atomic_folder
from occjax.io.maps import Map
from occjax.io.pfm import write_pfm
from occjax.lightfield import LightField, to_unit_float
from occjax.results.conversion import convert_map, point_cloud, write_points
from occjax.results.summary import summary
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
"""All file names that an estimate may be written to."""

MIN_CONFIDENCE = 1e-3
"""Confidence below which all candidates are practically equally probable."""


@dataclass(frozen=True)
class Outputs:
    """The files that were written.

    Attributes:
        folder: The folder of the scene.
        paths: The files that were written now, in alphabetical order.
        notes: Notes of the estimate, and assumptions of the files, in sentences for the user.
        metrics: Comparison with the ground truth, if there is one.
    """

    folder: Path
    paths: tuple[Path, ...]
    notes: tuple[str, ...]
    metrics: Metrics | None


def write_outputs(estimate: Estimate, light_field: LightField, folder: str | Path) -> Outputs:
    """Write an estimate as files, all of them or none.

    Args:
        estimate: Result of an estimator.
        light_field: The light field that was estimated.
        folder: Folder to write. In an existing folder the files of the table at the top of this
            module are replaced, or removed if this estimate does not have them; other files are
            kept.

    Returns:
        The files that were written, with notes and scores.

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


def has_signal(light_field: LightField, confidence: np.ndarray) -> np.ndarray:
    """Find the pixels at which disparity can be measured at all.

    A pixel has no signal if the centre view is black there (below half a step of 8 bits in every
    channel), as in the corners of a camera's vignetted views, or if its confidence is below
    :data:`MIN_CONFIDENCE`.

    Args:
        light_field: The light field that was estimated.
        confidence: ``[H, W]`` in [0, 1].

    Returns:
        ``[H, W]`` booleans.
    """
    lit = to_unit_float(light_field.centre).max(axis=-1) >= 0.5 / 255.0
    return lit & ~(confidence < MIN_CONFIDENCE)


def _notes(light_field: LightField, metrics: Metrics | None, signal: np.ndarray) -> list[str]:
    """Return the assumptions of the files, as sentences for the user."""
    notes = []
    if light_field.calibration is None:
        notes.append(
            "no calibration: the points in points.ply are in pixels and their depth has no true "
            "scale; depth.npy is not written (--focal-length-mm, --sensor-mm, --baseline-mm and "
            "--focus-m describe the camera)"
        )
    if not signal.all():
        notes.append(
            f"points.ply leaves out {np.sum(~signal)} of {signal.size} pixels without signal "
            f"(centre view black, or confidence below {MIN_CONFIDENCE:g})"
        )
    if light_field.ground_truth is not None and metrics is None:
        notes.append("the ground truth has no finite value to compare with")
    return notes


def _write_maps(estimate: Estimate, truth: np.ndarray | None, folder: Path) -> None:
    """Write disparity, confidence and occlusion."""
    disparity = np.asarray(estimate.disparity, np.float32)
    write_pfm(folder / "disparity.pfm", disparity)
    np.save(folder / "disparity.npy", disparity)
    confidence = estimate.confidence
    figure = disparity_figure(disparity, confidence=confidence, ground_truth=truth)
    save(figure, folder / "disparity.png")
    save(confidence_figure(confidence), folder / "confidence.png")
    if estimate.occlusion is not None:
        save(occlusion_figure(estimate.occlusion), folder / "occlusion.png")


def _write_geometry(
    disparity: np.ndarray, light_field: LightField, signal: np.ndarray, folder: Path
) -> None:
    """Write the depth of all pixels, and the points of those with signal."""
    content, calibration = Map(disparity, "disparity"), light_field.calibration
    if calibration is not None:
        depth = convert_map(content, "depth", calibration).values
        np.save(folder / "depth.npy", depth.astype(np.float32))
    cloud = point_cloud(content, calibration)
    write_points(folder / "points.ply", cloud, centre=light_field.centre, mask=signal)


def _write_comparison(
    estimate: Estimate, light_field: LightField, metrics: Metrics | None, folder: Path
) -> None:
    """Write the comparison, and the error map if there is ground truth."""
    truth, score, border = None, "", 0
    if metrics is not None and light_field.ground_truth is not None:
        truth, border = light_field.ground_truth, metrics.border
        score = f"BadPix {BAD_PIXEL_THRESHOLD:g}: {metrics.badpix[BAD_PIXEL_THRESHOLD]:.2f} %"
        title = f"Error   {score}   MSE x100: {metrics.mse_x100:.3f}"
        error = error_figure(estimate.disparity, truth, title=title, border=border)
        save(error, folder / "error.png")
    overview = comparison_figure(
        light_field.centre,
        estimate.disparity,
        truth,
        confidence=estimate.confidence,
        score=score,
        border=border,
    )
    save(overview, folder / "comparison.png")
