"""Comparison of hypotheses on the arrangement of views; each gives every view an offset.

Sixteen numbered views may be a row or a square, a row of a grid may be the cameras of one frame of
a video, and every second row may run backwards. The cross of views around the centre view cannot
always tell this: a hypothesis that is right on one side of the centre view is as consistent as the
right one. Here all views near the centre view must agree.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from occjax.layout.brightness import view_brightness
from occjax.layout.config import ViewOrderConfig
from occjax.layout.consistency import lowest_cost
from occjax.layout.filters import reduce_image
from occjax.lightfield import LightField, view_offsets


class BestHypothesis(NamedTuple):
    """The most consistent one of several hypotheses.

    Attributes:
        number: Its index.
        clear: Whether all others are less consistent by the factor ``clearly_worse_ratio``.
        alike: Whether another one is as consistent, up to the factor ``alike_ratio``. False if
            there is nothing to compare: views without texture, or copies of one view.
    """

    number: int
    clear: bool
    alike: bool


def row_major_offsets(grid: tuple[int, int]) -> np.ndarray:
    """Return the ``[V * U, 2]`` offsets of the views of a grid, row by row."""
    return view_offsets(*grid).reshape(-1, 2)


def best_hypothesis(
    views: np.ndarray,
    hypotheses: Sequence[np.ndarray],
    config: ViewOrderConfig | None = None,
    *,
    usable: np.ndarray | None = None,
) -> BestHypothesis:
    """Return the hypothesis on the offsets of views that explains the images best.

    Args:
        views: ``[N, H, W, C]`` views.
        hypotheses: ``[N, 2]`` offsets ``(row, column)`` of the views, in view steps. The centre
            view is the one at zero in the last hypothesis.
        config: Settings of the comparison; None for the default.
        usable: ``[N]`` bool, False for views that are missing; None if all can be used.

    Returns:
        The index of that hypothesis, and how clearly it is the best.

    Example:
        >>> wall = np.random.default_rng(0).random((60, 60, 1), np.float32)
        >>> views = np.stack([np.roll(wall, (-v, -u), (0, 1)) for v in range(2) for u in range(2)])
        >>> best_hypothesis(views, [row_major_offsets((1, 4)), row_major_offsets((2, 2))])
        BestHypothesis(number=1, clear=True, alike=False)
    """
    config = config or ViewOrderConfig()
    present = np.ones(len(views), bool) if usable is None else usable
    for size in (config.coarse_size_px, config.fine_size_px):
        scores = np.array(_scores(views, hypotheses, present, size, config))
        best = int(np.argmin(scores))
        second = np.delete(scores, best).min()
        differs = second - scores[best] > config.noise_floor
        clear = bool(differs and second > config.clearly_worse_ratio * scores[best])
        if clear or max(views.shape[1:3]) <= size:
            break
    alike = bool(config.noise_floor < second < config.alike_ratio * scores[best])
    return BestHypothesis(best, clear, alike)


def _scores(
    views: np.ndarray,
    hypotheses: Sequence[np.ndarray],
    usable: np.ndarray,
    size_px: int,
    config: ViewOrderConfig,
) -> list[float]:
    """Return the inconsistency of views, reduced to ``size_px``, under each hypothesis.

    The same views are compared under all hypotheses: those that are nearest to the centre view
    under one of them.

    Returns:
        Mean over all pixels of the lowest mean grey difference, relative to the brightness of the
        centre view.
    """
    centre = int(np.hypot(*hypotheses[-1].T).argmin())
    near: set[int] = set()
    for hypothesis in hypotheses:
        distance = np.hypot(*(hypothesis - hypothesis[centre]).T)
        distance[~usable | (np.arange(len(views)) == centre)] = np.inf
        nearest = np.argsort(distance, kind="stable")[: config.nearest_views]
        near.update(k for k in nearest.tolist() if np.isfinite(distance[k]))
    ordered = sorted(near)
    middle = (len(ordered) + 1) // 2
    ordered.insert(middle, centre)  # as the centre view of a row
    line = LightField(views[None, ordered])
    brightness = view_brightness(line, config.brightness)
    compared = [k for k in range(len(ordered)) if k != middle and brightness.usable[0, k]]
    if not compared:
        return [0.0] * len(hypotheses)
    scale = max(1, math.ceil(min(line.image_size) / size_px))
    centre_image, *images = (
        reduce_image(brightness.grey(line, 0, k), scale) for k in (middle, *compared)
    )
    white = np.float32(np.percentile(centre_image, config.brightness_percentile)) or np.float32(1)
    limit = config.max_disparity * min(line.image_size)
    scores = []
    for hypothesis in hypotheses:
        offsets = (hypothesis - hypothesis[centre])[[ordered[k] for k in compared]]
        reach = min(float(np.abs(offsets).max()), config.view_steps[-1])
        count = math.ceil(limit * reach / (config.candidate_motion_px * scale))
        candidates = np.linspace(-limit, limit, 2 * count + 1)
        cost = lowest_cost(
            centre_image / white, np.stack(images) / white, offsets / scale, candidates, config
        )
        scores.append(float(cost.mean()))
    return scores
