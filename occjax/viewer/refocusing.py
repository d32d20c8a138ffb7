"""Refocused images for the slider: all views at rest, as many as time allows while it moves."""

from __future__ import annotations

import math
import time

import jax
import numpy as np

from occjax.lightfield import LightField
from occjax.ops import aperture_weights, refocus
from occjax.viewer.config import ViewerConfig
from occjax.viz.pictures import view_picture
from occjax.viz.refocusing import Refocuser


class LiveRefocuser:
    """Refocuses one light field fast enough for a slider.

    Args:
        light_field: The views.
        config: Settings of the viewer.
    """

    def __init__(self, light_field: LightField, config: ViewerConfig) -> None:
        self._refocuser = Refocuser(light_field)
        prepared = self._refocuser.light_field
        self._views = prepared.views[prepared.usable]
        self._offsets = prepared.offsets[prepared.usable].astype(np.float32)
        self._config = config
        self._seconds_per_view = math.inf  # until it has been measured

    @property
    def largest_aperture(self) -> float:
        """Diameter of the aperture that contains all views, in view steps."""
        return 2.0 * float(np.linalg.norm(self._offsets, axis=-1).max())

    def image(self, disparity: float, aperture: float, *, preview: bool = False) -> np.ndarray:
        """Compute the image that a camera with a large aperture would take.

        Args:
            disparity: Disparity of the plane in focus, pixels per view step.
            aperture: Diameter of the aperture, in view steps.
            preview: Whether to average only as many views as the time of a preview allows.

        Returns:
            ``[H, W, 3]`` uint8 RGB.
        """
        if not preview:
            return self._refocuser.image(disparity, aperture=aperture)
        weights = np.asarray(aperture_weights(self._offsets[None], aperture))[0]
        views_in_time = int(self._config.frame_seconds / self._seconds_per_view)
        count = max(self._config.min_preview_views, views_in_time)
        chosen = spread(self._offsets, np.flatnonzero(weights), count)
        # Padded to a power of two, so that few compiled programs serve all apertures.
        indices = np.resize(chosen, 1 << (chosen.size - 1).bit_length())
        weights = np.where(np.arange(indices.size) < chosen.size, weights[indices], 0.0)
        begin = time.perf_counter()
        views, offsets = self._views[indices][None], self._offsets[indices][None]
        weights = weights[None].astype(np.float32)
        image = np.asarray(_refocus(views, np.float32(disparity), offsets=offsets, weights=weights))
        self._seconds_per_view = (time.perf_counter() - begin) / indices.size
        return view_picture(image)


_refocus = jax.jit(refocus)


def spread(offsets: np.ndarray, chosen: np.ndarray, count: int) -> np.ndarray:
    """Choose views that are spread over the aperture.

    Farthest point sampling: the first view is the one nearest to the centre, each further view is
    the one farthest from all views before.

    Args:
        offsets: ``[N, 2]`` offset of each view from the centre view, in view steps.
        chosen: ``[K]`` indices to choose from.
        count: Largest number of views.

    Returns:
        ``[min(K, count)]`` indices.

    Example:
        >>> spread(np.array([[0, -2], [0, -1], [0, 0], [0, 1], [0, 2]]), np.arange(5), 3).tolist()
        [2, 0, 4]
    """
    if chosen.size <= count:
        return chosen
    candidates = offsets[chosen].astype(np.float64)
    order = [int(np.argmin(np.square(candidates).sum(-1)))]
    distance = np.full(chosen.size, np.inf)
    while len(order) < count:
        step = np.square(candidates - candidates[order[-1]]).sum(-1)
        distance = np.minimum(distance, step)
        order.append(int(np.argmax(distance)))
    return chosen[order]
