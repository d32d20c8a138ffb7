"""Thresholds for files whose content is ambiguous."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ReadingConfig:
    """Thresholds for files whose content is ambiguous.

    Attributes:
        min_seam_ratio: Ratio above which the layout of a mosaic counts as detected: of the mean
            brightness step at seams to that elsewhere, or of the mean difference of adjacent tiles
            of the declared grid to that of the detected grid.
        max_dark_ratio: Ratio of the darkest to the brightest view of a mosaic below which the
            darkest view counts as dark.
        min_dark_pixels: Number of pixels per view from which the mean brightness of a view is
            reliable.
        min_repeated_px: Smallest height and width of a tile, in pixels, for which repeated content
            can be detected.
        min_round_fraction: Smallest fraction of a square grid that a round aperture fills; that of
            a circle is 0.79.
        max_unusable_fraction: Fraction of the images of a folder above which images that cannot be
            decoded, or are of another size, are an error. A single such image is never an error.
        min_truth_ratio: Factor by which a mirrored or negated ground truth must lower the grey
            differences of the views to be reported as the right one.
        truth_samples: Minimum number of rows and columns at which the ground truth is compared with
            the views; smaller views are compared at every pixel.
        max_changed_error_ratio: A warning is given if the median error to the mirrored or negated
            ground truth is less than this fraction of that to the ground truth as given.
        min_view_step: A warning is given if the mean distance of neighbouring cameras, in the unit
            of their positions, is below this value or above its inverse.
        min_byte_order_values: Number of values from which their magnitudes show the byte order.
        white_percentile: Percentile of the pixels that tone mapping makes white.
    """

    min_seam_ratio: float = 1.3
    max_dark_ratio: float = 0.6
    min_dark_pixels: int = 400
    min_repeated_px: int = 16
    min_round_fraction: float = 0.7
    max_unusable_fraction: float = 0.1
    min_truth_ratio: float = 1.3
    truth_samples: int = 128
    max_changed_error_ratio: float = 0.3
    min_view_step: float = 0.3
    min_byte_order_values: int = 256
    white_percentile: float = 99.9
