"""What an estimator returns, whichever it is."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True, eq=False)
class Estimate:
    """A disparity map of the centre view and what the estimator knows about it.

    Attributes:
        disparity: ``[H, W]`` float32, pixels per view step.
        confidence: ``[H, W]`` float32 in [0, 1]: one minus the entropy of the candidates'
            probabilities over its maximum; 1 is certain. Of a cascade, that of its least certain
            stage; a stage that chooses among proposals is as certain as all proposals within 0.15
            of the chosen one are probable together. Not comparable between grids of views.
        standard_deviation: ``[H, W]`` float32 of the last stage's probabilities, in the unit of
            disparity.
        coarse: ``[H, W]`` float32 disparity of the first stage, if there is more than one.
        disparity_range: ``(minimum, maximum)`` that was searched.
        model: Name of the estimator or of the network's preset.
        weights: Name of the weights, if the estimator has any.
        notes: Sentences the user should hear (cropped grid, assumed units, chosen range).
        seconds: Wall-clock seconds of each phase, e.g. ``{"compile": 3.1, "run": 0.4}``.
        stages: ``[H, W]`` float32 disparity after each stage, in order; the last is ``disparity``.
        find_occlusion: What :attr:`occlusion` is computed by, if there is anything to compute.
    """

    disparity: np.ndarray
    confidence: np.ndarray
    standard_deviation: np.ndarray
    coarse: np.ndarray | None
    disparity_range: tuple[float, float]
    model: str
    weights: str | None = None
    notes: tuple[str, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)
    stages: tuple[np.ndarray, ...] = ()
    find_occlusion: Callable[[], np.ndarray] | None = field(default=None, repr=False)

    @functools.cached_property
    def occlusion(self) -> np.ndarray | None:
        """``[V, U, H, W]`` float32 occlusion map of each view in [0, 1] (eq. 5 of the paper).

        0 where the view sees what the centre view sees, towards 1 where it is occluded; None for a
        network without occlusion. All views are warped when this is first asked for.
        """
        return None if self.find_occlusion is None else self.find_occlusion()
