"""Error measures of the HCI 4D benchmark."""

from __future__ import annotations

from typing import TYPE_CHECKING

from occjax.lazy import lazy_names

if TYPE_CHECKING:
    from occjax.evaluation.benchmark import SceneScores, evaluate_scene, metric_names
    from occjax.evaluation.files import evaluate_files, read_disparity
    from occjax.evaluation.metrics import (
        BAD_PIXEL_THRESHOLD,
        BORDER,
        THRESHOLDS,
        Metrics,
        bad_pix,
        compared_pixels,
        default_border,
        evaluate,
        mean_squared_error,
        q25,
    )
    from occjax.evaluation.normals import angular_errors
    from occjax.evaluation.regions import (
        bumpiness,
        fattening,
        foreground_fattening,
        foreground_thinning,
        missed_dots,
        thinning,
    )
    from occjax.evaluation.scene_files import is_scene, read_mask

__all__ = [
    "BAD_PIXEL_THRESHOLD",
    "BORDER",
    "THRESHOLDS",
    "Metrics",
    "SceneScores",
    "angular_errors",
    "bad_pix",
    "bumpiness",
    "compared_pixels",
    "default_border",
    "evaluate",
    "evaluate_files",
    "evaluate_scene",
    "fattening",
    "foreground_fattening",
    "foreground_thinning",
    "is_scene",
    "mean_squared_error",
    "metric_names",
    "missed_dots",
    "q25",
    "read_disparity",
    "read_mask",
    "thinning",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "occjax.evaluation.benchmark": ("SceneScores", "evaluate_scene", "metric_names"),
        "occjax.evaluation.files": ("evaluate_files", "read_disparity"),
        "occjax.evaluation.metrics": (
            "BAD_PIXEL_THRESHOLD",
            "BORDER",
            "THRESHOLDS",
            "Metrics",
            "bad_pix",
            "compared_pixels",
            "default_border",
            "evaluate",
            "mean_squared_error",
            "q25",
        ),
        "occjax.evaluation.normals": ("angular_errors",),
        "occjax.evaluation.regions": (
            "bumpiness",
            "fattening",
            "foreground_fattening",
            "foreground_thinning",
            "missed_dots",
            "thinning",
        ),
        "occjax.evaluation.scene_files": ("is_scene", "read_mask"),
    },
)
