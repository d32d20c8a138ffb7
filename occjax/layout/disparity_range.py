"""Disparity range of a scene from cost volumes, including weak texture and noise.

Weakly textured surfaces show their disparity only if the cost is averaged over many pixels, thin
surfaces only if it is averaged over few. Therefore each pixel is measured with several windows. A
disparity is reliable where its cost is lower than the other costs by more than noise explains.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from occjax.layout.config import ViewOrderConfig
from occjax.layout.consistency import CostVolumes
from occjax.layout.filters import box_mean
from occjax.layout.orientation import Orientation


@dataclass(frozen=True)
class DisparityMeasurement:
    """Disparities under one view order, in pixels of the light field per view step.

    Attributes:
        disparity: ``[h, w]`` disparity of lowest cost in the smallest window, reliable or not.
        limits: Lowest and highest reliable disparity without outliers; None if no more pixels are
            reliable than in pure noise.
        search_range: Range to search: the limits with a margin, which is wide if few pixels are
            reliable.
        reliable_fraction: Fraction of the pixels that are reliable in some window; 0 if no more
            than in pure noise.
        textured_fraction: Fraction of the pixels whose cost depends on the disparity.
    """

    disparity: np.ndarray
    limits: tuple[float, float] | None
    search_range: tuple[float, float]
    reliable_fraction: float
    textured_fraction: float


def measure_disparity(volumes: CostVolumes, orientation: Orientation) -> DisparityMeasurement:
    """Measure the disparity of each pixel and the range of the reliable disparities.

    The lowest cost of a pixel is the mean of ``n`` absolute grey differences. If all of them were
    noise of mean ``m``, costs would vary by ``0.75 m / sqrt(n)``: the standard deviation of the
    absolute value of Gaussian noise is ``sqrt(pi / 2 - 1)`` of its mean.

    Args:
        volumes: Cost volumes of all view orders.
        orientation: The view order that is assumed.

    Returns:
        Disparities, their limits, and how much of the image they rest on.
    """
    config, candidates = volumes.config, volumes.candidates
    volume = volumes.of(orientation)
    noise = float(np.median(volume.min(0)))
    disparities, reliable = [], []
    for radius in config.window_radii_px:
        costs = volume if radius == 0 else np.stack([box_mean(cost, radius) for cost in volume])
        disparity = candidates[costs.argmin(0)].astype(np.float32)
        lowest, mean = costs.min(0), costs.mean(0)
        pixels = max(2 * radius + 1, volumes.window) ** 2
        deviation = 0.75 * noise / np.sqrt(pixels * volumes.images)
        significant = mean - lowest > config.significance * max(deviation, config.noise_floor)
        clear = (lowest < config.clear_minimum * mean) & (mean > 4 * config.noise_floor)
        smooth = np.abs(disparity - box_mean(disparity, 1)) <= volumes.step
        disparities.append(disparity)
        reliable.append((significant | clear) & smooth)
    reliable_fraction = float(np.any(reliable, axis=0).mean())
    textured_fraction = float((volume.mean(0) > 4 * config.noise_floor).mean())
    if reliable_fraction <= config.max_noise_fraction * textured_fraction:
        limits, search_range, reliable_fraction = None, config.unknown_range, 0.0
    else:
        found = np.concatenate([d[r] for d, r in zip(disparities, reliable, strict=True)])
        limits = _limits(found, volumes.step, config)
        search_range = _with_margin(limits, reliable_fraction, volumes)
    return DisparityMeasurement(
        disparities[0], limits, search_range, reliable_fraction, textured_fraction
    )


def _limits(found: np.ndarray, step: float, config: ViewOrderConfig) -> tuple[float, float]:
    """Return the lowest and the highest of ``[n]`` reliable disparities without outliers."""
    values, counts = np.unique(found, return_counts=True)
    group = np.cumsum([False, *(np.diff(values) >= 1.5 * step)])
    large = np.bincount(group, counts) >= config.min_group_fraction * found.size
    kept = values[large[group]]
    low, high = np.clip(np.percentile(found, config.range_percentiles), kept[0], kept[-1])
    return float(low), float(high)


def _with_margin(
    limits: tuple[float, float], reliable_fraction: float, volumes: CostVolumes
) -> tuple[float, float]:
    """Widen limits by one candidate, and further if few pixels are reliable; round outwards."""
    low, high = limits
    config, largest = volumes.config, float(volumes.candidates[-1])
    unknown = max(0.0, 1.0 - reliable_fraction / config.sufficient_fraction)
    margin = 0.5 * unknown * max(high - low, 1.0)
    low = max(low - margin, -largest) - volumes.step
    high = min(high + margin, largest) + volumes.step
    # Rounding errors of the division must not widen the range by a whole step.
    low, high = np.round(np.array([low, high]) / config.range_step, 3)
    steps_per_pixel = round(1 / config.range_step)
    return math.floor(low) / steps_per_pixel, math.ceil(high) / steps_per_pixel
