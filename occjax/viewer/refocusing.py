"""Refocused images for the slider: the mean of the views shifted to one disparity."""

from __future__ import annotations

import math
import time

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Shaped

from occjax.lightfield import LightField
from occjax.ops import shift
from occjax.viewer.scene import camera_offsets

MIN_PREVIEW_VIEWS = 4
"""Number of views of a preview, at least."""


class Refocuser:
    """Refocuses one light field; one program serves every disparity and aperture.

    Args:
        light_field: The views.
        frame_seconds: Time that a preview may take.
    """

    def __init__(self, light_field: LightField, *, frame_seconds: float) -> None:
        usable = np.ones(light_field.grid, bool)
        if light_field.usable is not None:
            usable = light_field.usable
        self._offsets = camera_offsets(light_field)[usable].astype(np.float32)
        self._views = jnp.asarray(light_field.views[usable])
        self._frame_seconds = frame_seconds
        self._seconds_per_view = math.inf  # until it has been measured

    @property
    def largest_aperture(self) -> float:
        """Distance of the outermost views from the centre view, in view steps."""
        return float(np.abs(self._offsets).max())

    def refocus(self, disparity: float, aperture: float, *, preview: bool = False) -> np.ndarray:
        """Compute the image that a camera with a large aperture would take.

        Args:
            disparity: Disparity of the plane in focus, pixels per view step.
            aperture: Distance of the outermost views from the centre view, in view steps; the
                aperture is a square.
            preview: Whether to average only as many views as the time of a preview allows.

        Returns:
            ``[H, W, C]`` float32 in [0, 1].
        """
        chosen = np.flatnonzero(np.abs(self._offsets).max(-1) <= aperture + 1e-3)
        if preview:
            affordable = max(MIN_PREVIEW_VIEWS, int(self._frame_seconds / self._seconds_per_view))
            chosen = spread(self._offsets, chosen, affordable)
        indices = np.zeros(len(self._offsets), np.int32)
        indices[: chosen.size] = chosen
        begin = time.perf_counter()
        image = np.asarray(
            _mean_of_shifted(
                self._views,
                self._offsets,
                indices,
                jnp.int32(chosen.size),
                jnp.float32(disparity),
            )
        )
        self._seconds_per_view = (time.perf_counter() - begin) / chosen.size
        return image


def spread(offsets: np.ndarray, chosen: np.ndarray, count: int) -> np.ndarray:
    """Choose views that are spread over the aperture.

    Starting with the view nearest to the centre, each next one is that farthest from all before.

    Args:
        offsets: ``[N, 2]`` offset of each view from the centre view, in view steps.
        chosen: ``[K]`` indices to choose from.
        count: Number of views, at most.

    Returns:
        ``[min(K, count)]`` indices.

    Example:
        >>> spread(np.array([[0, -2], [0, -1], [0, 0], [0, 1], [0, 2]]), np.arange(5), 3).tolist()
        [2, 0, 4]
    """
    if chosen.size <= count:
        return chosen
    places = offsets[chosen].astype(np.float64)
    order = [int(np.argmin(np.square(places).sum(-1)))]
    distance = np.full(chosen.size, np.inf)
    while len(order) < count:
        step = np.square(places - places[order[-1]]).sum(-1)
        distance = np.minimum(distance, step)
        order.append(int(np.argmax(distance)))
    return chosen[order]


@jax.jit
def _mean_of_shifted(
    views: Shaped[Array, "n h w c"],
    offsets: Float[Array, "n 2"],
    indices: Int[Array, " n"],
    count: Int[Array, ""],
    disparity: Float[Array, ""],
) -> Float[Array, "h w c"]:
    """Average the first ``count`` of the indexed views where they see the plane in focus."""
    _, h, w, c = views.shape
    scale = 1.0 if jnp.issubdtype(views.dtype, jnp.floating) else 1.0 / jnp.iinfo(views.dtype).max
    rows, columns = np.array([1.0, 0.0], np.float32), np.array([0.0, 1.0], np.float32)

    def add_view(step, sums):
        total, seen = sums
        view, offset = views[indices[step]], offsets[indices[step]]
        image = view.astype(jnp.float32) * scale
        # ``shift`` reads zero outside the view: the sum is divided by the number of views inside.
        inside = shift(jnp.ones((h, 1, 1)), disparity, offset * rows)
        inside = inside * shift(jnp.ones((1, w, 1)), disparity, offset * columns)
        return total + shift(image, disparity, offset), seen + inside

    zero = jnp.zeros((h, w, c), jnp.float32), jnp.zeros((h, w, 1), jnp.float32)
    total, seen = jax.lax.fori_loop(0, count, add_view, zero)
    return total / jnp.maximum(seen, 1e-3)
