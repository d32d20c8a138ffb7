"""Pure, differentiable functions on one light field: the cost-volume library.

Every function takes arrays without a batch axis and is meant to be vmapped; conventions of axes and
signs are those of :mod:`occjax.lightfield`.
"""

from occjax.ops.geometry import view_offsets
from occjax.ops.occlusion import occlusion_maps, occlusion_weights
from occjax.ops.regression import Confidence, confidence, expected_disparity, soft_argmin
from occjax.ops.sampling import shift, warp
from occjax.ops.volume import (
    coarse_volume,
    concatenate,
    group_correlation,
    mean_and_variance,
    refined_volume,
    warp_views,
)

__all__ = [
    "Confidence",
    "coarse_volume",
    "concatenate",
    "confidence",
    "expected_disparity",
    "group_correlation",
    "mean_and_variance",
    "occlusion_maps",
    "occlusion_weights",
    "refined_volume",
    "shift",
    "soft_argmin",
    "view_offsets",
    "warp",
    "warp_views",
]
