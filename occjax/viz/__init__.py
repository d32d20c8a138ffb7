"""Figures of disparity, depth, confidence, error and occlusion."""

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
