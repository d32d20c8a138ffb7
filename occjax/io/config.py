"""Thresholds by which files are read."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ReadingConfig:
    """Thresholds by which the content of files is interpreted.

    Attributes:
        min_seam_ratio: Ratio of brightness differences above which the arrangement of a mosaic is
            clear: of steps at seams to steps elsewhere, and of neighbouring tiles as declared to
            those as detected.
        max_dark_ratio: Ratio of the darkest to the brightest view of a mosaic below which the
            darkest view counts as dark.
        min_dark_pixels: Number of pixels per view from which the mean brightness of a view is
            reliable.
        min_repeated_px: Smallest height and width of a tile, in pixels, for which repeated content
            can be detected.
        min_round_fraction: Smallest fraction of a square grid that a round aperture fills; that of
            a circle is 0.79.
        max_unusable_fraction: Fraction of the images of a folder above which images that cannot be
            decoded, or are of another size, are an error. One such image never is.
        min_truth_ratio: Ratio of the grey differences under two readings of the ground truth above
            which the lower one is right.
        truth_samples: Number of rows and columns, at least, at which the ground truth is compared
            with the views if they have as many.
        max_changed_error_ratio: Ratio of two median errors of an estimate, to the ground truth
            reversed or negated and to the ground truth as given, below which a warning says so.
        min_view_step: Distance of neighbouring cameras, in the unit of their positions, below
            which, or above whose inverse, this unit is no view step.
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
