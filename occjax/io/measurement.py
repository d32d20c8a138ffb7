"""What disparities a scene has, from cost volumes: weak texture and noise included.

A surface of weak texture shows its disparity only when the cost is averaged over many pixels, a
thin one only when it is averaged over few. So every pixel is measured with several windows, and a
disparity counts where its cost is lower than the others' by more than the noise can make it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occjax.io.orientation import Orientation
from occjax.io.photoconsistency import CostVolumes, box_mean

NOISE = 0.05 / 255
"""Inconsistencies closer than this are equal, relative to the brightness of the centre view."""

EXTRA_RADII = (0, 3, 8)
"""Half widths in pixels of the windows in which the cost is averaged once more."""

CLEAR_MINIMUM = 0.5
"""Ratio of lowest to mean cost below which the lowest is right, whatever the noise."""

SIGNIFICANT = 5.0
"""Standard deviations of the noise by which the lowest cost must stand out from the mean."""

SPREAD_OF_NOISE = 0.75
"""Standard deviation of the absolute value of Gaussian noise, relative to its mean."""

ENOUGH = 0.6
"""Share of measured pixels below which the range is widened: the others may lie outside."""

FEW = 0.002
"""Share of the sure disparities below which those that lie apart from all others are mistakes:
repeated texture, seen by few views.
"""

FEIGNED = 0.05
"""Share of the textured pixels that pure noise makes look measured, at most."""


@dataclass(frozen=True)
class Measurement:
    """Disparities under one layout of the grid.

    Attributes:
        disparity: ``[h, w]``, by the smallest window, sure or not.
        found: ``[N]`` sure disparities of all windows.
        measured: Share of the pixels that some window measures.
        textured: Share of the pixels whose cost depends on the disparity.
        candidates: ``[D]`` disparities that were compared.
    """

    disparity: np.ndarray
    found: np.ndarray
    measured: float
    textured: float
    candidates: np.ndarray

    @property
    def nothing(self) -> bool:
        """Whether no more is measured than noise feigns."""
        return self.measured <= FEIGNED * self.textured

    @property
    def extremes(self) -> np.ndarray:
        """Lowest and highest disparity found but for a few outliers."""
        values, counts = np.unique(self.found, return_counts=True)
        apart = np.diff(values) > 1.5 * (self.candidates[1] - self.candidates[0])
        group = np.cumsum([False, *apart])
        many = np.bincount(group, counts) >= FEW * self.found.size
        kept = values[many[group]]
        return np.clip(np.percentile(self.found, [0.05, 99.95]), kept[0], kept[-1])

    @property
    def span(self) -> np.ndarray:
        """Lowest and highest disparity to expect: with a margin, wide where much is unmeasured."""
        low, high = self.extremes
        step, largest = self.candidates[1] - self.candidates[0], self.candidates[-1]
        unknown = max(0.0, 1.0 - self.measured / ENOUGH)
        margin = 0.5 * unknown * max(high - low, 1.0)
        low, high = max(low - margin, -largest), min(high + margin, largest)
        return np.array([low - step, high + step])


def measure(volumes: CostVolumes, orientation: Orientation) -> Measurement:
    """Measure the disparity of each pixel and which of them are beyond doubt.

    The lowest cost of a pixel is the mean of ``n`` absolute grey differences. Were they all noise
    of mean ``m``, costs would vary by ``0.75 m / sqrt(n)``.
    """
    volume = volumes.of(orientation)
    noise = float(np.median(volume.min(0)))
    disparities, sure = [], []
    for radius in EXTRA_RADII:
        costs = volume if radius == 0 else np.stack([box_mean(cost, radius) for cost in volume])
        disparity, lowest, mean = _lowest(volumes.candidates, costs)
        pixels = max(2 * radius + 1, volumes.window) ** 2
        deviation = SPREAD_OF_NOISE * noise / np.sqrt(pixels * volumes.images)
        stands_out = mean - lowest > SIGNIFICANT * max(deviation, NOISE)
        clear = (lowest < CLEAR_MINIMUM * mean) & (mean > 4 * NOISE)
        smooth = np.abs(disparity - box_mean(disparity, 1)) <= volumes.step
        disparities.append(disparity)
        sure.append((stands_out | clear) & smooth)
    return Measurement(
        disparity=disparities[0],
        found=np.concatenate([d[s] for d, s in zip(disparities, sure, strict=True)]),
        measured=float(np.any(sure, axis=0).mean()),
        textured=float((volume.mean(0) > 4 * NOISE).mean()),
        candidates=volumes.candidates,
    )


def _lowest(candidates: np.ndarray, costs: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """``[h, w]`` disparity of lowest cost, that cost, and the mean over all candidates."""
    index = costs.argmin(0)
    lowest = np.take_along_axis(costs, index[None], 0)[0]
    return candidates[index].astype(np.float32), lowest, costs.mean(0)
