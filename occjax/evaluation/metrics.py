"""The error measures of the HCI 4D benchmark and of the paper's tables.

Maps are compared in float64. A border of 15 pixels is left out, as in the benchmark.

All measures treat pixels without a value as follows:

* Without finite ground truth, the pixel is left out, as if it were masked.
* Without a finite estimate, the pixel is *bad* at every threshold of BadPix, so that a method
  cannot improve its score by leaving out hard pixels. The mean squared error and Q25 have no worst
  value. They are computed over the pixels that have an estimate, as in the benchmark's toolkit;
  :attr:`Metrics.missing` counts the others.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from occjax.errors import InputError

BORDER = 15
"""Pixels that the HCI 4D benchmark leaves out on each side of the image."""

THRESHOLDS = (0.07, 0.03, 0.01)
"""Thresholds of BadPix in the benchmark's and the paper's tables, in pixels per view step."""

BAD_PIXEL_THRESHOLD = THRESHOLDS[0]
"""Error above which a pixel counts as bad, in pixels per view step: the first threshold of the HCI
benchmark."""


@dataclass(frozen=True)
class Metrics:
    """Differences of an estimated disparity map from the ground truth.

    Attributes:
        mse_x100: Mean squared error times 100.
        badpix: Percentage of pixels whose absolute error is strictly above each threshold.
        q25_x100: Largest absolute error of the best quarter of the pixels, times 100: entry
            ``floor(N / 4)`` of the N sorted errors.
        pixels: Number of compared pixels.
        missing: Number of compared pixels without a finite estimate.
        border: Pixels left out on each side of the image.
    """

    mse_x100: float
    badpix: dict[float, float]
    q25_x100: float
    pixels: int
    missing: int
    border: int

    def as_dict(self) -> dict[str, float | int | dict[str, float]]:
        """Return the numbers as a dictionary for JSON; thresholds become strings."""
        return {
            "mse_x100": self.mse_x100,
            "badpix": {f"{threshold:g}": percent for threshold, percent in self.badpix.items()},
            "q25_x100": self.q25_x100,
            "pixels": self.pixels,
            "missing": self.missing,
            "border": self.border,
        }

    def table(self) -> str:
        """Return a text table: one measure per line, three decimals."""
        rows = [
            ("MSE x100", f"{self.mse_x100:.3f}"),
            *((f"BadPix {t:g}", f"{percent:.3f} %") for t, percent in self.badpix.items()),
            ("Q25 x100", f"{self.q25_x100:.3f}"),
            ("pixels", f"{self.pixels} (border of {self.border} left out)"),
        ]
        if self.missing:
            rows.append(("missing", f"{self.missing} (bad in BadPix, not in MSE and Q25)"))
        width = max(len(name) for name, _ in rows)
        return "\n".join(f"{name:<{width}}  {value}" for name, value in rows)


def default_border(image_size: tuple[int, int]) -> int:
    """Return the border that is left out of a comparison if the user names none.

    Args:
        image_size: ``(H, W)`` of the maps, in pixels.

    Returns:
        :data:`BORDER` as in the benchmark; an eighth of the shorter side for smaller images, of
        which the benchmark's border would leave little or nothing.

    Example:
        >>> default_border((512, 512)), default_border((32, 40))
        (15, 4)
    """
    return min(BORDER, min(image_size) // 8)


def evaluate(
    estimate: np.ndarray,
    ground_truth: np.ndarray,
    *,
    thresholds: tuple[float, ...] = THRESHOLDS,
    border: int = BORDER,
    mask: np.ndarray | None = None,
) -> Metrics:
    """Compute all measures of the paper's tables.

    Args:
        estimate: ``[H, W]`` estimated disparity, pixels per view step.
        ground_truth: ``[H, W]`` true disparity, pixels per view step.
        thresholds: Thresholds of BadPix, pixels per view step; at least one.
        border: Pixels left out on each side of the image.
        mask: ``[H, W]`` boolean, True where to compare; None for all pixels.

    Returns:
        The :class:`Metrics`.

    Raises:
        InputError: If the sizes differ, no pixel is left to compare, the border is negative, there
            is no threshold, or a threshold is negative or not finite.

    Example:
        >>> truth = np.zeros((40, 40))
        >>> estimate = truth + 0.05
        >>> estimate[20, 20] = 1.0
        >>> print(evaluate(estimate, truth).table())
        MSE x100     1.247
        BadPix 0.07  1.000 %
        BadPix 0.03  100.000 %
        BadPix 0.01  100.000 %
        Q25 x100     5.000
        pixels       100 (border of 15 left out)
    """
    if not thresholds:
        raise InputError("no BadPix threshold; pass at least one, in pixels per view step")
    for threshold in thresholds:
        if not 0.0 <= threshold < math.inf:
            raise InputError(
                f"BadPix threshold is {threshold:g}; pass 0 or more pixels per view step, finite"
            )
    compared = compared_pixels(estimate, ground_truth, border=border, mask=mask)
    errors = np.abs(signed_errors(estimate, ground_truth)[compared])
    present = errors[np.isfinite(errors)]
    if not present.size:
        raise InputError("the estimate has no finite value at the compared pixels; check the map")
    return Metrics(
        mse_x100=float(100.0 * np.mean(np.square(present))),
        badpix={each: float(100.0 * np.mean(~(errors <= each))) for each in thresholds},
        q25_x100=float(100.0 * np.sort(present)[present.size // 4]),
        pixels=errors.size,
        missing=errors.size - present.size,
        border=border,
    )


def compare(disparity: np.ndarray, ground_truth: np.ndarray | None) -> Metrics | None:
    """Compute the metrics of an estimate, if there is ground truth to compare it with.

    The border of :func:`default_border` is left out.

    Args:
        disparity: ``[H, W]`` estimate, pixels per view step.
        ground_truth: ``[H, W]`` pixels per view step, or None.

    Returns:
        The metrics; None without finite ground truth inside the border.

    Example:
        >>> compare(np.full((8, 8), 0.5), np.zeros((8, 8))).mse_x100
        25.0
    """
    if ground_truth is None:
        return None
    height, width = disparity.shape
    border = default_border(disparity.shape)
    if not np.isfinite(ground_truth[border : height - border, border : width - border]).any():
        return None
    return evaluate(disparity, ground_truth, border=border)


def compared_pixels(
    estimate: np.ndarray,
    ground_truth: np.ndarray,
    *,
    border: int = BORDER,
    mask: np.ndarray | None = None,
) -> np.ndarray:
    """Return the pixels that are compared: inside border and mask, with finite ground truth.

    Args:
        estimate: ``[H, W]`` estimated disparity.
        ground_truth: ``[H, W]`` true disparity.
        border: Pixels left out on each side of the image.
        mask: ``[H, W]`` boolean, True where to compare; None for all pixels.

    Returns:
        ``[H, W]`` boolean, True for at least one pixel.

    Raises:
        InputError: If the sizes differ, the border is negative, or no pixel is left to compare.

    Example:
        >>> compared_pixels(np.zeros((3, 4)), np.zeros((3, 4)), border=1).astype(int)
        array([[0, 0, 0, 0],
               [0, 1, 1, 0],
               [0, 0, 0, 0]])
    """
    estimate, ground_truth = np.asarray(estimate), np.asarray(ground_truth)
    if ground_truth.ndim != 2:
        raise InputError(
            f"ground truth must be one disparity map [H, W], not {list(ground_truth.shape)}"
        )
    if estimate.shape != ground_truth.shape:
        raise InputError(
            f"estimate is {list(estimate.shape)} but ground truth is {list(ground_truth.shape)}; "
            "compare maps of the same scene and resolution"
        )
    if mask is not None and mask.shape != ground_truth.shape:
        raise InputError(
            f"mask is {list(mask.shape)} but the maps are {list(ground_truth.shape)}; "
            "pass one boolean per pixel"
        )
    if border < 0:
        raise InputError(f"border is {border}; pass 0 or more pixels")
    h, w = ground_truth.shape
    if min(h, w) <= 2 * border:
        raise InputError(
            f"maps of {h}x{w} have no pixel inside a border of {border} pixels; "
            "pass a smaller border"
        )
    inside = np.s_[border : h - border, border : w - border]
    compared = np.zeros((h, w), bool)
    compared[inside] = np.isfinite(ground_truth[inside])
    if mask is not None:
        compared &= np.asarray(mask, bool)
    if not compared.any():
        raise InputError(
            "no pixel to compare: all are masked or have no finite ground truth; check the mask"
        )
    return compared


def signed_errors(estimate: np.ndarray, ground_truth: np.ndarray) -> np.ndarray:
    """Return ``[H, W]`` float64 errors; NaN, which fails any comparison, where a map has none."""
    estimate, ground_truth = (np.asarray(each, np.float64) for each in (estimate, ground_truth))
    both = np.isfinite(estimate) & np.isfinite(ground_truth)
    return np.subtract(estimate, ground_truth, out=np.full(both.shape, np.nan), where=both)
