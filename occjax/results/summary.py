"""Content of ``summary.json``: one object, in which missing values are null.

============================  ==================================================================
``scene``                     string, name of the light field
``source``                    string or null, file or folder it was read from, as it was given
``grid``                      [V, U], rows and columns of views
``view``                      null, or [v, u], the view that was estimated, counted from 0, if it is
                              not the centre view; ``grid`` then has 2 V - 1 rows and 2 U - 1
                              columns around it, in which other views are missing
``image_size``                [H, W], rows and columns of pixels
``calibration``               null, or {focal_length_mm, sensor_size_mm, baseline_mm,
                              focus_distance_m} as in :class:`occjax.lightfield.Calibration`; an
                              infinite focus distance is null
``model``                     string, name of the estimator
``weights``                   string or null, name of its weights
``searched_disparity_range``  [minimum, maximum], pixels per view step
``disparity``                 {minimum, maximum, mean} of the finite values in pixels per view
                              step (null if there are none), {missing} number of other pixels
``confidence``                the same for the confidence, in [0, 1]
``metrics``                   null, or {mse_x100, badpix, q25_x100, pixels, missing, border} as in
                              :class:`occjax.evaluation.Metrics`; badpix is an object from each
                              threshold, written as a string, to a percentage
``seconds``                   object from each phase (load, compile, run) to its wall-clock time
``peak_memory_mb``            number, largest memory of the process so far, 10^6 bytes
``command``                   string or null, the command line
``versions``                  {occjax, jax, numpy, python}, strings
``notes``                     list of sentences for the user
``file_notes``                list of those notes that are on the files, not on the estimate
``files``                     list of the names of the other files that were written
``settings``                  null, or what ``occjax estimate`` made the files from: {occjax,
                              source_sha256, model, model_sha256, options, files_sha256}; a second
                              call skips a scene whose settings are the same
============================  ==================================================================
"""

from __future__ import annotations

import dataclasses
import json
import math
import platform
import resource
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from occjax.estimators.protocol import Estimate
from occjax.evaluation.metrics import Metrics
from occjax.io.files import decoding
from occjax.lightfield import Calibration, LightField


def summary(
    estimate: Estimate,
    light_field: LightField,
    metrics: Metrics | None,
    notes: tuple[str, ...],
    command: str | None = None,
) -> dict[str, Any]:
    """Return the content of ``summary.json``; see the table at the top of this module.

    Args:
        estimate: Result of an estimator.
        light_field: The light field that was estimated.
        metrics: Comparison with the ground truth, if there is one.
        notes: Sentences for the user.
        command: The command line, if there is one.
    """
    return {
        "scene": light_field.name,
        "source": None if light_field.source is None else str(light_field.source),
        "grid": list(light_field.grid),
        "view": None if light_field.view is None else list(light_field.view),
        "image_size": list(light_field.image_size),
        "calibration": _calibration(light_field.calibration),
        "model": estimate.model,
        "weights": estimate.weights,
        "searched_disparity_range": [float(value) for value in estimate.disparity_range],
        "disparity": _statistics(estimate.disparity),
        "confidence": _statistics(estimate.confidence),
        "metrics": None if metrics is None else metrics.as_dict(),
        "seconds": {phase: round(float(time), 3) for phase, time in estimate.seconds.items()},
        "peak_memory_mb": round(peak_memory_bytes() / 1e6, 1),
        "command": command,
        "versions": {
            "occjax": metadata.version("occjax"),
            "jax": metadata.version("jax"),
            "numpy": np.__version__,
            "python": platform.python_version(),
        },
        "notes": list(notes),
    }


def read_summary(path: Path) -> dict[str, Any]:
    """Read the summary of an estimate.

    Returns:
        Its content; see the table at the top of this module.

    Raises:
        InputError: If the file is not a summary.
    """
    what, remedy = "a summary of results", "estimate again, or remove it"
    with decoding(path, what, remedy=remedy, max_bytes=2**24) as file:
        content = json.load(file)
        missing = _REQUIRED - content.keys()
        if missing:
            raise ValueError(f"it has no {min(missing)}")
        stored_calibration(content)  # an error here names the file
        return content


_REQUIRED = {
    *("scene", "source", "grid", "image_size", "calibration", "model", "weights"),
    *("searched_disparity_range", "seconds", "versions", "notes"),
}


def stored_calibration(summary: dict[str, Any]) -> Calibration | None:
    """Return the camera of the light field that was estimated; None if it was unknown.

    Args:
        summary: From :func:`read_summary`.

    Raises:
        ValueError: If a parameter of the camera is not positive.
    """
    stored = summary["calibration"]
    if stored is None:
        return None
    camera = {name: float("inf" if value is None else value) for name, value in stored.items()}
    if not all(value > 0.0 for value in camera.values()):
        raise ValueError("the camera has a parameter that is not positive")
    return Calibration(**camera)


def _calibration(calibration: Calibration | None) -> dict[str, float | None] | None:
    """Return the fields of the camera; null replaces infinity, which JSON does not have."""
    if calibration is None:
        return None
    fields = dataclasses.asdict(calibration)
    return {name: None if math.isinf(value) else value for name, value in fields.items()}


def peak_memory_bytes() -> int:
    """Return the peak memory of this process so far, in bytes, without that of a GPU."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak


def _statistics(values: np.ndarray) -> dict[str, float | int | None]:
    """Return range and mean of the finite values; null replaces NaN, which JSON does not have."""
    finite = np.asarray(values, np.float64)[np.isfinite(values)]
    numbers = (finite.min(), finite.max(), finite.mean()) if finite.size else (math.nan,) * 3
    smallest, largest, mean = (None if math.isnan(n) else round(float(n), 6) for n in numbers)
    return {
        "minimum": smallest,
        "maximum": largest,
        "mean": mean,
        "missing": int(values.size - finite.size),
    }
