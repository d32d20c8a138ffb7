"""The cost-volume library: pure, differentiable functions on one light field.

Every function takes arrays without a batch axis and is meant to be vmapped. The conventions of axes
and signs are those of :mod:`occjax.lightfield`.
"""

from occjax.lightfield import view_offsets
from occjax.ops.cross_view import CrossViewCounts, cross_view_counts, cross_view_difference
from occjax.ops.geometry import (
    back_project,
    depth_from_disparity,
    disparity_from_depth,
    surface_normals,
)
from occjax.ops.occlusion import occlusion_maps, occlusion_weights
from occjax.ops.refocus import all_in_focus, aperture_weights, refocus
from occjax.ops.regression import (
    Confidence,
    confidence,
    expected_disparity,
    soft_argmin,
    winner_takes_all,
)
from occjax.ops.sampling import shift, warp
from occjax.ops.volume import (
    coarse_volume,
    coarse_volume_means,
    concatenate,
    group_correlation,
    mean_and_variance,
    refined_volume,
    warp_views,
)

__all__ = [
    "Confidence",
    "CrossViewCounts",
    "all_in_focus",
    "aperture_weights",
    "back_project",
    "coarse_volume",
    "coarse_volume_means",
    "concatenate",
    "confidence",
    "cross_view_counts",
    "cross_view_difference",
    "depth_from_disparity",
    "disparity_from_depth",
    "expected_disparity",
    "group_correlation",
    "mean_and_variance",
    "occlusion_maps",
    "occlusion_weights",
    "refined_volume",
    "refocus",
    "shift",
    "soft_argmin",
    "surface_normals",
    "view_offsets",
    "warp",
    "warp_views",
    "winner_takes_all",
]
