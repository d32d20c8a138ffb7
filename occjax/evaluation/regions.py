"""Measures of the HCI 4D benchmark that look at one kind of region each.

Defined in "A Dataset and Evaluation Methodology for Depth Estimation on 4D Light Fields" (Honauer,
Johannsen, Kondermann and Goldluecke, ACCV 2016), thresholds as in the descriptions that the
benchmark prints with its measures. Errors at single pixels and their averages say little about how
a surface looks: whether planes are smooth, whether thin things keep their width.

In every function a pixel without a finite estimate has the worst value that the measure knows, so
that leaving out the hard pixels improves no score. A pixel without finite ground truth is left out,
and with it those whose differences would need it.
"""

from __future__ import annotations

import numpy as np

from occjax.errors import InputError
from occjax.evaluation.metrics import BORDER, compared_pixels

ROUGHEST = 0.05
"""Bumpiness of a pixel is at most this, so that single outliers do not drown all others."""

FINE = 0.15
"""Error at fine structures, in pixels per view step, that counts as fattening or thinning."""

DETECTED = 0.4
"""Error, in pixels per view step, up to which a pixel of a dot is detected."""


def bumpiness(
    estimate: np.ndarray,
    ground_truth: np.ndarray,
    *,
    border: int = BORDER,
    mask: np.ndarray | None = None,
) -> float:
    """How rough the error is: the mean Frobenius norm of its Hessian, bounded at each pixel.

    ``mean(min(0.05, |Hessian(estimate - ground_truth)|))`` with second differences of neighbouring
    pixels. An offset and a tilt of the whole surface cost nothing. The definition leaves the
    differences open, so values compare with those of the same program only.

    Args:
        estimate: ``[H, W]`` estimated disparity, pixels per view step.
        ground_truth: ``[H, W]`` true disparity, pixels per view step.
        border: Pixels left out at each side of the image.
        mask: ``[H, W]`` of booleans: True on the smooth surfaces. None is everywhere.

    Returns:
        From 0 to 0.05; the tables print 100 times it.

    Raises:
        InputError: If the maps do not fit each other or nothing is left to compare.

    Example:
        >>> y, x = np.mgrid[:8, :8]
        >>> round(bumpiness(0.01 * x**2 + 0.3 * y, np.zeros((8, 8)), border=1), 12)
        0.02
    """
    compared_pixels(estimate, ground_truth, border=border, mask=mask)  # the sizes, first of all
    truth = np.asarray(ground_truth, np.float64)
    smooth = np.isfinite(_hessian_norm(np.where(np.isfinite(truth), truth, np.nan)))
    pixels = compared_pixels(estimate, np.where(smooth, truth, np.nan), border=border, mask=mask)
    roughness = _hessian_norm(_signed_errors(estimate, truth))
    return float(np.mean(np.fmin(roughness, ROUGHEST)[pixels]))


def fattening(
    estimate: np.ndarray,
    ground_truth: np.ndarray,
    *,
    threshold: float = FINE,
    border: int = BORDER,
    mask: np.ndarray | None = None,
) -> float:
    """Percentage of pixels that are estimated too near, by more than the threshold.

    In the benchmark: of the pixels around fine structures.

    Args:
        estimate: ``[H, W]`` estimated disparity, pixels per view step.
        ground_truth: ``[H, W]`` true disparity, pixels per view step.
        threshold: In pixels per view step.
        border: Pixels left out at each side of the image.
        mask: ``[H, W]`` of booleans: True around the fine structures. None is everywhere.

    Raises:
        InputError: If the maps do not fit each other or nothing is left to compare.

    Example:
        >>> fattening(np.array([[0.2, 0.1, -0.2, 0.1]]), np.zeros((1, 4)), border=0)
        25.0
    """
    pixels = compared_pixels(estimate, ground_truth, border=border, mask=mask)
    return _percent_not(_signed_errors(estimate, ground_truth)[pixels] <= threshold)


def thinning(
    estimate: np.ndarray,
    ground_truth: np.ndarray,
    *,
    threshold: float = FINE,
    border: int = BORDER,
    mask: np.ndarray | None = None,
) -> float:
    """Percentage of pixels that are estimated too far away, by more than the threshold.

    In the benchmark: of the pixels of fine structures. Takes and raises what :func:`fattening`
    does.

    Example:
        >>> thinning(np.array([[0.2, 0.1, -0.2, np.nan]]), np.zeros((1, 4)), border=0)
        50.0
    """
    pixels = compared_pixels(estimate, ground_truth, border=border, mask=mask)
    return _percent_not(_signed_errors(estimate, ground_truth)[pixels] >= -threshold)


def foreground_fattening(
    estimate: np.ndarray,
    ground_truth: np.ndarray,
    *,
    foreground: np.ndarray,
    background: np.ndarray,
    border: int = BORDER,
    mask: np.ndarray | None = None,
) -> float:
    """Percentage of pixels whose estimate is closer to the foreground than to the background.

    The foreground's disparity at a pixel of the background is that of the foreground nearby,
    continued; so too the other way round. In the benchmark: of background pixels close to the
    foreground of the scene backgammon.

    Args:
        estimate: ``[H, W]`` estimated disparity, pixels per view step.
        ground_truth: ``[H, W]`` true disparity, pixels per view step.
        foreground: ``[H, W]`` of booleans: True on the foreground.
        background: ``[H, W]`` of booleans: True on the background.
        border: Pixels left out at each side of the image.
        mask: ``[H, W]`` of booleans: True where to look. None is everywhere.

    Raises:
        InputError: If the maps do not fit each other, nothing is left to compare, or there is no
            foreground or no background.

    Example:
        >>> truth = np.array([[0.0, 0.0, 0.0, 2.0]])
        >>> bar = truth > 1.0
        >>> layers = {"foreground": bar, "background": ~bar, "mask": ~bar}
        >>> estimate = np.array([[0.0, 0.9, 1.1, 2.0]])
        >>> round(foreground_fattening(estimate, truth, **layers, border=0), 2)
        33.33
    """
    pixels = compared_pixels(estimate, ground_truth, border=border, mask=mask)
    to_near, to_far = _distances(estimate, ground_truth, foreground, background, pixels)
    return _percent_not(to_far <= to_near)


def foreground_thinning(
    estimate: np.ndarray,
    ground_truth: np.ndarray,
    *,
    foreground: np.ndarray,
    background: np.ndarray,
    border: int = BORDER,
    mask: np.ndarray | None = None,
) -> float:
    """Percentage of pixels whose estimate is closer to the background than to the foreground.

    In the benchmark: of foreground pixels of the scene backgammon. Takes and raises what
    :func:`foreground_fattening` does.
    """
    pixels = compared_pixels(estimate, ground_truth, border=border, mask=mask)
    to_near, to_far = _distances(estimate, ground_truth, foreground, background, pixels)
    return _percent_not(to_near <= to_far)


def missed_dots(
    estimate: np.ndarray,
    ground_truth: np.ndarray,
    dots: np.ndarray,
    *,
    threshold: float = DETECTED,
    border: int = BORDER,
) -> float:
    """Percentage of dots of which more than half of the pixels are bad.

    Args:
        estimate: ``[H, W]`` estimated disparity, pixels per view step.
        ground_truth: ``[H, W]`` true disparity, pixels per view step.
        dots: ``[H, W]`` of booleans: True on the dots. Pixels that touch, also at a corner, are of
            one dot.
        threshold: Absolute error above which a pixel is bad, in pixels per view step.
        border: Pixels left out at each side of the image.

    Raises:
        InputError: If the maps do not fit each other or no dot is left to compare.

    Example:
        >>> dots = np.array([[True, True, False, True, False, True]])
        >>> estimate = np.array([[0, 1, 9, 0, 9, 1]])
        >>> round(missed_dots(estimate, np.zeros((1, 6)), dots, border=0), 2)
        33.33
    """
    pixels = compared_pixels(estimate, ground_truth, border=border, mask=dots)
    good = np.abs(_signed_errors(estimate, ground_truth)[pixels]) <= threshold
    _, dot = np.unique(_components(pixels)[pixels], return_inverse=True)
    return _percent_not(np.bincount(dot, good) >= 0.5 * np.bincount(dot))


def _signed_errors(estimate: np.ndarray, ground_truth: np.ndarray) -> np.ndarray:
    """``[H, W]`` float64 estimate minus ground truth; NaN without either, which fails any test."""
    estimate, ground_truth = (np.asarray(one, np.float64) for one in (estimate, ground_truth))
    both = np.isfinite(estimate) & np.isfinite(ground_truth)
    return np.subtract(estimate, ground_truth, out=np.full(both.shape, np.nan), where=both)


def _percent_not(good: np.ndarray) -> float:
    return float(100.0 * np.mean(~good))


def _hessian_norm(values: np.ndarray) -> np.ndarray:
    """``[H, W]`` Frobenius norm of the second differences; NaN where a neighbour is."""
    # Continued linearly, so that the edge of the image does not bend.
    padded = np.pad(values, 1, mode="reflect", reflect_type="odd")
    middle = padded[1:-1, 1:-1]
    along_x = padded[1:-1, 2:] - 2.0 * middle + padded[1:-1, :-2]
    along_y = padded[2:, 1:-1] - 2.0 * middle + padded[:-2, 1:-1]
    mixed = 0.25 * (padded[2:, 2:] - padded[2:, :-2] - padded[:-2, 2:] + padded[:-2, :-2])
    return np.sqrt(along_x**2 + 2.0 * mixed**2 + along_y**2)


def _distances(
    estimate: np.ndarray,
    ground_truth: np.ndarray,
    foreground: np.ndarray,
    background: np.ndarray,
    pixels: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """``[N]`` distances of the estimate from the foreground and from the background at pixels."""
    estimate, ground_truth = (np.asarray(one, np.float64) for one in (estimate, ground_truth))
    sides = []
    for name, side in (("foreground", foreground), ("background", background)):
        known = side & np.isfinite(ground_truth)
        if not known.any():
            raise InputError(f"there is no {name} with ground truth; check its mask")
        sides.append(_continued(np.where(known, ground_truth, np.nan), pixels))
    estimated = np.where(np.isfinite(estimate), estimate, np.nan)[pixels]
    near, far = sides
    return np.abs(estimated - near[pixels]), np.abs(estimated - far[pixels])


def _continued(values: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Values with NaN replaced by the mean of their neighbours, outwards until the wanted have one.

    Each round reaches one pixel further, so a pixel takes what lies nearest to it.
    """
    while np.isnan(values[wanted]).any():
        padded = np.pad(values, 1, constant_values=np.nan)
        around = np.stack(
            [padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]]
        )
        count = np.isfinite(around).sum(0)
        mean = np.nansum(around, 0) / np.maximum(count, 1)
        values = np.where(np.isnan(values) & (count > 0), mean, values)
    return values


def _components(mask: np.ndarray) -> np.ndarray:
    """``[H, W]`` numbers that are equal where pixels of the mask touch, directly or through others.

    Each pixel takes the smallest number around it until nothing changes.
    """
    outside = mask.size
    labels = np.where(mask, np.arange(mask.size).reshape(mask.shape), outside)
    while True:
        padded = np.pad(labels, 1, constant_values=outside)
        smallest = np.lib.stride_tricks.sliding_window_view(padded, (3, 3)).min((-2, -1))
        spread = np.where(mask, smallest, outside)
        if np.array_equal(spread, labels):
            return labels
        labels = spread
