"""Pure, differentiable functions on one light field: the cost-volume library.

Every function takes arrays without a batch axis and is meant to be vmapped; conventions of axes and
signs are those of :mod:`occjax.lightfield`.
"""

from occjax.ops.aperture import sector_of
from occjax.ops.depth import back_project, depth_from_disparity, disparity_from_depth
from occjax.ops.filtering import (
    binomial_filter,
    box_filter,
    central_differences,
    edge_aware_mean,
    fit_planes,
    neighbours,
)
from occjax.ops.geometry import view_offsets
from occjax.ops.matching import aperture_costs, grey_costs, sector_sums, semi_global
from occjax.ops.noise import noise_level, noisiness, texture_share
from occjax.ops.normals import surface_normals
from occjax.ops.occlusion import occlusion_maps, occlusion_weights
from occjax.ops.refinement import median_filter, refine_disparity, refinement_features
from occjax.ops.regression import (
    Confidence,
    cheapest,
    confidence,
    expected_disparity,
    probability_near,
    soft_argmin,
)
from occjax.ops.sampling import shift, warp
from occjax.ops.sectors import (
    SectorCosts,
    geman_mcclure,
    refined_sector_costs,
    sector_channels,
)
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
    "SectorCosts",
    "aperture_costs",
    "back_project",
    "binomial_filter",
    "box_filter",
    "central_differences",
    "cheapest",
    "coarse_volume",
    "coarse_volume_means",
    "concatenate",
    "confidence",
    "depth_from_disparity",
    "disparity_from_depth",
    "edge_aware_mean",
    "expected_disparity",
    "fit_planes",
    "geman_mcclure",
    "grey_costs",
    "group_correlation",
    "mean_and_variance",
    "median_filter",
    "neighbours",
    "noise_level",
    "noisiness",
    "occlusion_maps",
    "occlusion_weights",
    "probability_near",
    "refine_disparity",
    "refined_sector_costs",
    "refined_volume",
    "refinement_features",
    "sector_channels",
    "sector_of",
    "sector_sums",
    "semi_global",
    "shift",
    "soft_argmin",
    "surface_normals",
    "texture_share",
    "view_offsets",
    "warp",
    "warp_views",
]
