"""Pictures, and figures with colour bars, of disparity, depth, confidence, error and occlusion."""

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
    from occjax.viz.pictures import (
        confidence_picture,
        disparity_picture,
        error_picture,
        save_picture,
    )

__all__ = [
    "comparison_figure",
    "confidence_figure",
    "confidence_picture",
    "depth_figure",
    "disparity_figure",
    "disparity_picture",
    "error_figure",
    "error_picture",
    "occlusion_figure",
    "save",
    "save_picture",
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
        "occjax.viz.pictures": (
            "confidence_picture",
            "disparity_picture",
            "error_picture",
            "save_picture",
        ),
    },
)
