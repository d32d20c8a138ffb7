"""Figures of disparity, depth, confidence, error and occlusion."""

from __future__ import annotations

from typing import TYPE_CHECKING

from occjax.lazy import lazy_names

if TYPE_CHECKING:
    from occjax.viz.canvas import save
    from occjax.viz.figures import (
        comparison_figure,
        confidence_figure,
        depth_figure,
        disparity_figure,
        error_figure,
        occlusion_figure,
    )

__all__ = [
    "comparison_figure",
    "confidence_figure",
    "depth_figure",
    "disparity_figure",
    "error_figure",
    "occlusion_figure",
    "save",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "occjax.viz.canvas": ("save",),
        "occjax.viz.figures": (
            "comparison_figure",
            "confidence_figure",
            "depth_figure",
            "disparity_figure",
            "error_figure",
            "occlusion_figure",
        ),
    },
)
