"""Settings of the viewer."""

from __future__ import annotations

from dataclasses import dataclass

LOOPBACK = "127.0.0.1"
"""Address that only this computer can reach."""


@dataclass(frozen=True)
class ViewerConfig:
    """Settings of the viewer.

    Attributes:
        max_points: Largest number of points of a cloud; larger maps are shown by every second (or
            third, ...) row and column.
        relief_depth: Depth of a relief, as a fraction of the longer side of the image.
        occluded_above: Value of the occlusion map above which a view counts as occluded.
        cost_candidates: Number of disparities at which the matching cost is computed.
        cost_radius_px: Radius of the window over which the matching cost is averaged, in pixels.
        epi_radius_px: Number of pixels shown on each side of the picked pixel in an epipolar plane
            image.
        frame_seconds: Time for one refocused image while a slider moves; it determines how many
            views are averaged.
        min_preview_views: Smallest number of views that are averaged while a slider moves.
        rest_seconds: Time after which a slider counts as at rest; then all views are averaged.
        blink_seconds: Time for which each result is shown while the results blink.
        jpeg_quality: JPEG quality of the views and the refocused images, 0 to 100.
    """

    max_points: int = 600_000
    relief_depth: float = 0.4
    occluded_above: float = 0.1
    cost_candidates: int = 129
    cost_radius_px: int = 2
    epi_radius_px: int = 40
    frame_seconds: float = 0.07
    min_preview_views: int = 4
    rest_seconds: float = 0.25
    blink_seconds: float = 0.7
    jpeg_quality: int = 90
