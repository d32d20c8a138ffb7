"""The error measures of the HCI 4D benchmark and of the paper's tables.

Both maps are compared in float64. A border of 15 pixels is left out, as the benchmark does.

Pixels without a value are treated as follows, for every measure here:

* no finite ground truth: the pixel is left out, as if masked;
* no finite estimate: the pixel is *bad* at every threshold of BadPix, because leaving out the hard
  pixels must not improve a score. The mean squared error and Q25 have no such worst value; like the
  benchmark's toolkit they are taken over the pixels that have an estimate, and
  :attr:`Metrics.missing` says how many have not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from occjax.errors import InputError

BORDER = 15
"""Pixels left out at each side of the image by the HCI 4D benchmark."""

THRESHOLDS = (0.07, 0.03, 0.01)
"""Thresholds of BadPix in the benchmark's and the paper's tables, in pixels per view step."""


@dataclass(frozen=True)
class Metrics:
    """How far an estimated disparity map is from the ground truth.

    Attributes:
        mse_x100: Mean squared error times 100.
        badpix: Percentage of bad pixels for each threshold, in the order asked for.
        q25_x100: Largest absolute error of the best quarter of the pixels, times 100.
        pixels: Number of pixels compared.
        missing: How many of them have no finite estimate.
        border: Pixels left out at each side of the image.
    """

    mse_x100: float
    badpix: dict[float, float]
    q25_x100: float
    pixels: int
    missing: int
    border: int

    def as_dict(self) -> dict[str, float | int | dict[str, float]]:
        """The same numbers with names that JSON allows: thresholds become strings."""
        return {
            "mse_x100": self.mse_x100,
            "badpix": {f"{threshold:g}": percent for threshold, percent in self.badpix.items()},
            "q25_x100": self.q25_x100,
            "pixels": self.pixels,
            "missing": self.missing,
            "border": self.border,
        }

    def table(self) -> str:
        """A table for people, one measure a line, with three decimals."""
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


def evaluate(
    estimate: np.ndarray,
    ground_truth: np.ndarray,
    *,
    thresholds: tuple[float, ...] = THRESHOLDS,
    border: int = BORDER,
    mask: np.ndarray | None = None,
) -> Metrics:
    """Every measure of the paper's tables at once.

    Args:
        estimate: ``[H, W]`` estimated disparity, pixels per view step.
        ground_truth: ``[H, W]`` true disparity, pixels per view step.
        thresholds: Thresholds of BadPix, pixels per view step; at least one.
        border: Pixels left out at each side of the image.
        mask: ``[H, W]`` of booleans: True where to compare. None compares everywhere.

    Returns:
        The measures; see :class:`Metrics`.

    Raises:
        InputError: If the sizes differ, there is no threshold, a threshold or the border is
            negative or a threshold not finite, or nothing is left to compare.

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
        raise InputError("no BadPix threshold is given; pass one or more in pixels per view step")
    errors = _absolute_errors(estimate, ground_truth, border, mask)
    return Metrics(
        mse_x100=100.0 * _mean_squared(errors),
        badpix={threshold: _percent_above(errors, threshold) for threshold in thresholds},
        q25_x100=100.0 * _first_quartile(errors),
        pixels=errors.size,
        missing=int(np.isinf(errors).sum()),
        border=border,
    )


def bad_pix(
    estimate: np.ndarray,
    ground_truth: np.ndarray,
    threshold: float,
    *,
    border: int = BORDER,
    mask: np.ndarray | None = None,
) -> float:
    """Percentage of pixels whose absolute error is strictly above ``threshold``.

    Takes and raises what :func:`evaluate` does. Pixels without an estimate are bad.
    """
    return _percent_above(_absolute_errors(estimate, ground_truth, border, mask), threshold)


def mean_squared_error(
    estimate: np.ndarray,
    ground_truth: np.ndarray,
    *,
    border: int = BORDER,
    mask: np.ndarray | None = None,
) -> float:
    """Mean squared error in squared pixels per view step (the tables print 100 times it).

    Takes and raises what :func:`evaluate` does. Pixels without an estimate are left out.
    """
    return _mean_squared(_absolute_errors(estimate, ground_truth, border, mask))


def q25(
    estimate: np.ndarray,
    ground_truth: np.ndarray,
    *,
    border: int = BORDER,
    mask: np.ndarray | None = None,
) -> float:
    """The sorted absolute errors' entry ``floor(N / 4)`` (the tables print 100 times it).

    Takes and raises what :func:`evaluate` does. Pixels without an estimate are left out.
    """
    return _first_quartile(_absolute_errors(estimate, ground_truth, border, mask))


def compared_pixels(
    estimate: np.ndarray,
    ground_truth: np.ndarray,
    *,
    border: int = BORDER,
    mask: np.ndarray | None = None,
) -> np.ndarray:
    """Which pixels are compared: within the border and the mask, where the truth is known.

    Args:
        estimate: ``[H, W]`` estimated disparity.
        ground_truth: ``[H, W]`` true disparity.
        border: Pixels left out at each side of the image.
        mask: ``[H, W]`` of booleans: True where to compare. None compares everywhere.

    Returns:
        ``[H, W]`` of booleans, at least one of them True.

    Raises:
        InputError: If the sizes differ, the border is negative, or nothing is left to compare.

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
            "pass one boolean a pixel"
        )
    if border < 0:
        raise InputError(f"border is {border}; pass 0 or more pixels")
    h, w = ground_truth.shape
    if min(h, w) <= 2 * border:
        raise InputError(
            f"maps of {h}x{w} have nothing inside a border of {border} pixels; "
            "pass a smaller border"
        )
    inside = np.s_[border : h - border, border : w - border]
    compared = np.zeros((h, w), bool)
    compared[inside] = np.isfinite(ground_truth[inside])
    if mask is not None:
        compared &= np.asarray(mask, bool)
    if not compared.any():
        raise InputError(
            "no pixel to compare: all are masked or without finite ground truth; check the mask"
        )
    return compared


def _absolute_errors(
    estimate: np.ndarray, ground_truth: np.ndarray, border: int, mask: np.ndarray | None
) -> np.ndarray:
    """``[N]`` absolute errors of the pixels to compare; infinite where there is no estimate."""
    compared = compared_pixels(estimate, ground_truth, border=border, mask=mask)
    estimated = np.asarray(estimate)[compared].astype(np.float64)
    true = np.asarray(ground_truth)[compared].astype(np.float64)
    present = np.isfinite(estimated)
    if not present.any():
        raise InputError("the estimate has no finite value where it is compared; estimate it again")
    errors = np.full(true.shape, np.inf)
    errors[present] = np.abs(estimated[present] - true[present])
    return errors


def _percent_above(errors: np.ndarray, threshold: float) -> float:
    if not 0.0 <= threshold < math.inf:
        raise InputError(
            f"BadPix threshold is {threshold:g}; pass 0 or more pixels per view step, finite"
        )
    return float(100.0 * np.mean(errors > threshold))


def _mean_squared(errors: np.ndarray) -> float:
    return float(np.mean(np.square(errors[np.isfinite(errors)])))


def _first_quartile(errors: np.ndarray) -> float:
    present = errors[np.isfinite(errors)]
    return float(np.sort(present)[present.size // 4])
