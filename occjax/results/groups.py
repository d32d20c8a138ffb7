"""Groups of the files of an estimate, by which ``--save`` chooses them."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

GROUPS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "maps": (
            *("disparity.pfm", "disparity.npy", "confidence.npy", "standard_deviation.npy"),
            *("depth.npy", "ground_truth.npy", "centre.png"),
        ),
        "pictures": ("disparity_picture.png", "confidence.png", "error.png"),
        "cloud": ("points.ply",),
        "figures": ("comparison.png",),
        "occlusion": ("occlusion.npy", "occlusion.png"),
        "stages": ("stages.npy",),
    }
)
"""File names of each group."""

DEFAULT_GROUPS = ("maps", "pictures", "cloud")
"""The groups that take a fraction of a second."""
