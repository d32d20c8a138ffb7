"""Normalisation of brightness, and the mask of vignetted pixels."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from occjax.lightfield import centre_index


def white_level(views: Float[Array, "v u h w"]) -> Float[Array, ""]:
    """Return the grey level that counts as white: the 99th percentile of the centre view.

    If nearly all of the centre view is black, a hundredth of the maximum of all views is the lower
    bound.

    Args:
        views: ``[v, u, h, w]`` grey views.

    Returns:
        Positive grey level.

    Example:
        >>> round(float(white_level(jnp.linspace(0.0, 1.0, 101)[None, None, None])), 2)
        0.99
    """
    centre = views[centre_index(views.shape[:2])]
    return jnp.maximum(jnp.maximum(jnp.quantile(centre, 0.99), views.max() / 100), 1e-9)


def vignette_mask(centre: Float[Array, "h w"], level: float) -> Bool[Array, "h w"]:
    """Return the mask of dark pixels that are connected to the image border by dark pixels.

    The connection follows the row or the column. Dark objects inside the image are not part of the
    mask: their outline shows their disparity, while that of a vignette is not part of the scene.

    Args:
        centre: ``[h, w]`` grey centre view.
        level: Grey level up to which a pixel is dark.

    Returns:
        ``[h, w]`` mask.

    Example:
        >>> vignette_mask(jnp.array([[0.0, 0.5, 0.0, 0.5]] * 3), 0.1)[1].tolist()
        [True, False, True, False]
    """
    dark = (centre <= level).astype(jnp.int32)
    connected = [
        jax.lax.cummin(dark, axis=axis, reverse=reverse)
        for axis in (0, 1)
        for reverse in (False, True)
    ]
    return jnp.stack(connected).max(0) > 0
