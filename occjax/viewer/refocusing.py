"""Refocused images for the slider: the mean of the views shifted to one disparity."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Shaped

from occjax.lightfield import LightField
from occjax.ops import shift
from occjax.viewer.scene import camera_offsets


class Refocuser:
    """Refocuses one light field; its programs are compiled for a fixed number of views.

    Args:
        light_field: The views.
        preview_views: Number of views, at most, of a preview.
    """

    def __init__(self, light_field: LightField, *, preview_views: int = 25) -> None:
        offsets = camera_offsets(light_field)
        usable = np.ones(light_field.grid, bool)
        if light_field.usable is not None:
            usable = light_field.usable
        # From the inside to the outside, so that an aperture is a number of leading views.
        distance = np.abs(offsets).max(axis=-1)
        order = np.argsort(distance[usable], kind="stable")
        self.preview_views = preview_views
        self._distance = distance[usable][order]
        self._offsets = offsets[usable][order]
        self._views = jnp.asarray(light_field.views[usable][order])

    @property
    def apertures(self) -> tuple[float, ...]:
        """Radii of square apertures, in view steps, from one view to all views."""
        return tuple(float(radius) for radius in np.unique(np.round(self._distance, 3)))

    def refocus(
        self, disparity: float, aperture: float, *, preview: bool = False
    ) -> Float[np.ndarray, "h w c"]:
        """Compute the image that a camera with a large aperture would take.

        Args:
            disparity: Disparity of the plane in focus, pixels per view step.
            aperture: Distance of the outermost views from the centre view, in view steps.
            preview: Whether to average only some of the views, for speed.

        Returns:
            ``[H, W, C]`` float32 in [0, 1].
        """
        chosen = np.flatnonzero(self._distance <= aperture + 1e-3)
        if preview and chosen.size > self.preview_views:
            # The outermost views determine the blur; spread the choice over the aperture.
            chosen = chosen[
                np.round(np.linspace(0, chosen.size - 1, self.preview_views)).astype(int)
            ]
        indices = np.zeros(len(self._views), np.int32)
        indices[: chosen.size] = chosen
        return np.asarray(
            _mean_of_shifted(
                self._views,
                self._offsets,
                indices,
                jnp.int32(chosen.size),
                jnp.float32(disparity),
            )
        )


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
