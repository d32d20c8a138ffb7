"""Error measures of the HCI 4D benchmark for one kind of region each.

Defined in "A Dataset and Evaluation Methodology for Depth Estimation on 4D Light Fields" (Honauer,
Johannsen, Kondermann and Goldluecke, ACCV 2016); the thresholds are those that the benchmark states
with its results. Averages of pixel errors do not show how a surface looks: whether planes are
smooth and whether thin structures keep their width.

In every measure a pixel without a finite estimate has the worst possible value, so that a method
cannot improve its score by leaving out hard pixels. Pixels without finite ground truth are left
out, and so are pixels whose second differences need such a pixel.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from occjax.errors import InputError
from occjax.evaluation.metrics import BORDER, compared_pixels, signed_errors


def bumpiness(
    estimate: np.ndarray,
    ground_truth: np.ndarray,
    *,
    border: int = BORDER,
    mask: np.ndarray | None = None,
) -> float:
    """Compute the roughness of the error: the mean, limited Frobenius norm of its Hessian.

    ``mean(min(0.05, |Hessian(estimate - ground_truth)|))`` with second differences of neighbouring
    pixels. An offset and a tilt of the whole surface have no effect. The limit bounds the effect of
    outliers. The definition does not fix the differences, so values are comparable only if the
    same program computed them.

    Args:
        estimate: ``[H, W]`` estimated disparity, pixels per view step.
        ground_truth: ``[H, W]`` true disparity, pixels per view step.
        border: Pixels left out on each side of the image.
        mask: ``[H, W]`` boolean, True on the smooth surfaces; None for all pixels.

    Returns:
        Bumpiness from 0 to 0.05; result tables print it times 100.

    Raises:
        InputError: If the maps do not fit each other or no pixel is left to compare.

    Example:
        >>> y, x = np.mgrid[:8, :8]
        >>> round(bumpiness(0.01 * x**2 + 0.3 * y, np.zeros((8, 8)), border=1), 12)
        0.02
    """
    compared_pixels(estimate, ground_truth, border=border, mask=mask)  # checks the sizes first
    truth = np.asarray(ground_truth, np.float64)
    known = np.isfinite(_hessian_norm(np.where(np.isfinite(truth), truth, np.nan)))
    pixels = compared_pixels(estimate, np.where(known, truth, np.nan), border=border, mask=mask)
    roughness = _hessian_norm(signed_errors(estimate, truth))
    return float(np.mean(np.fmin(roughness, 0.05)[pixels]))


def fattening(
    estimate: np.ndarray,
    ground_truth: np.ndarray,
    *,
    threshold: float = 0.15,
    border: int = BORDER,
    mask: np.ndarray | None = None,
) -> float:
    """Compute the percentage of pixels that are estimated too near by more than a threshold.

    The benchmark measures it in the surroundings of fine structures. Thinning, the percentage of
    pixels that are estimated too far, is ``fattening(-estimate, -ground_truth)``; the benchmark
    measures it on fine structures.

    Args:
        estimate: ``[H, W]`` estimated disparity, pixels per view step.
        ground_truth: ``[H, W]`` true disparity, pixels per view step.
        threshold: Largest error that does not count, pixels per view step; by default that of the
            benchmark. It is twice that of BadPix: smaller errors are inaccuracies of the right
            surface, larger ones those of a structure that is wider or thinner than it should be.
        border: Pixels left out on each side of the image.
        mask: ``[H, W]`` boolean, True around the fine structures; None for all pixels.

    Returns:
        Percentage of the compared pixels.

    Raises:
        InputError: If the maps do not fit each other or no pixel is left to compare.

    Example:
        >>> fattening(np.array([[0.2, 0.1, -0.2, 0.1]]), np.zeros((1, 4)), border=0)
        25.0
    """
    pixels = compared_pixels(estimate, ground_truth, border=border, mask=mask)
    return _percent_not(signed_errors(estimate, ground_truth)[pixels] <= threshold)


def wrong_layer(
    estimate: np.ndarray,
    ground_truth: np.ndarray,
    *,
    wrong: np.ndarray,
    right: np.ndarray,
    border: int = BORDER,
    mask: np.ndarray | None = None,
) -> float:
    """Compute the percentage of pixels whose estimate is closer to the wrong one of two layers.

    An estimate is compared with the disparities of both layers at the same pixel. Each layer is
    extrapolated from its nearest pixels with ground truth. In the scene backgammon the benchmark
    measures foreground fattening, at background pixels close to the foreground, and foreground
    thinning, at foreground pixels.

    Args:
        estimate: ``[H, W]`` estimated disparity, pixels per view step.
        ground_truth: ``[H, W]`` true disparity, pixels per view step.
        wrong: ``[H, W]`` boolean, True on the layer that the compared pixels do not belong to.
        right: ``[H, W]`` boolean, True on the layer that they belong to.
        border: Pixels left out on each side of the image.
        mask: ``[H, W]`` boolean, True where to compare; None for all pixels.

    Returns:
        Percentage of the compared pixels.

    Raises:
        InputError: If the maps do not fit each other, no pixel is left to compare, or a layer has
            no pixel with ground truth.

    Example:
        >>> truth = np.array([[0.0, 0.0, 0.0, 2.0]])
        >>> bar = truth > 1.0
        >>> layers = {"wrong": bar, "right": ~bar, "mask": ~bar}
        >>> estimate = np.array([[0.0, 0.9, 1.1, 2.0]])
        >>> round(wrong_layer(estimate, truth, **layers, border=0), 2)
        33.33
    """
    pixels = compared_pixels(estimate, ground_truth, border=border, mask=mask)
    to_wrong = _distance(estimate, ground_truth, wrong, pixels)
    return _percent_not(_distance(estimate, ground_truth, right, pixels) <= to_wrong)


def missed_dots(
    estimate: np.ndarray,
    ground_truth: np.ndarray,
    dots: np.ndarray,
    *,
    threshold: float = 0.4,
    border: int = BORDER,
) -> float:
    """Compute the percentage of dots of which more than half of the pixels are bad.

    Args:
        estimate: ``[H, W]`` estimated disparity, pixels per view step.
        ground_truth: ``[H, W]`` true disparity, pixels per view step.
        dots: ``[H, W]`` boolean, True on the dots. Pixels that touch, also at a corner, belong to
            the same dot.
        threshold: Absolute error above which a pixel is bad, pixels per view step; by default that
            of the benchmark.
        border: Pixels left out on each side of the image.

    Returns:
        Percentage of the dots.

    Raises:
        InputError: If the maps do not fit each other or no dot is left to compare.

    Example:
        >>> dots = np.array([[True, True, False, True, False, True]])
        >>> estimate = np.array([[0, 1, 9, 0, 9, 1]])
        >>> round(missed_dots(estimate, np.zeros((1, 6)), dots, border=0), 2)
        33.33
    """
    pixels = compared_pixels(estimate, ground_truth, border=border, mask=dots)
    good = np.abs(signed_errors(estimate, ground_truth)) <= threshold
    labels, count = ndimage.label(pixels, np.ones((3, 3)))
    return _percent_not(ndimage.mean(good, labels, np.arange(1, count + 1)) >= 0.5)


def _percent_not(good: np.ndarray) -> float:
    return float(100.0 * np.mean(~good))


def _hessian_norm(values: np.ndarray) -> np.ndarray:
    """Return the ``[H, W]`` Frobenius norm of the second differences; NaN next to a NaN."""
    # Linear extrapolation: the edge of the image does not count as a bend.
    padded = np.pad(values, 1, mode="reflect", reflect_type="odd")
    middle = padded[1:-1, 1:-1]
    along_x = padded[1:-1, 2:] - 2.0 * middle + padded[1:-1, :-2]
    along_y = padded[2:, 1:-1] - 2.0 * middle + padded[:-2, 1:-1]
    mixed = 0.25 * (padded[2:, 2:] - padded[2:, :-2] - padded[:-2, 2:] + padded[:-2, :-2])
    return np.sqrt(along_x**2 + 2.0 * mixed**2 + along_y**2)


def _distance(
    estimate: np.ndarray, ground_truth: np.ndarray, layer: np.ndarray, pixels: np.ndarray
) -> np.ndarray:
    """Return ``[N]`` distances of the estimate from the extrapolated layer at the given pixels."""
    estimate, ground_truth = (np.asarray(each, np.float64) for each in (estimate, ground_truth))
    known = layer & np.isfinite(ground_truth)
    if not known.any():
        raise InputError("a layer has no pixel with ground truth; check its mask")
    values = np.where(known, ground_truth, np.nan)
    # Each round fills the pixels next to the known ones with the mean of their neighbours.
    while np.isnan(values[pixels]).any():
        padded = np.pad(values, 1, constant_values=np.nan)
        neighbours = np.stack(
            [padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]]
        )
        count = np.isfinite(neighbours).sum(0)
        mean = np.nansum(neighbours, 0) / np.maximum(count, 1)
        values = np.where(np.isnan(values) & (count > 0), mean, values)
    estimated = np.where(np.isfinite(estimate), estimate, np.nan)
    return np.abs(estimated - values)[pixels]
