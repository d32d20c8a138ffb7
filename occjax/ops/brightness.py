"""What counts as white, and what as the black frame of a vignette."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

WHITE = 0.8
"""Grey of the 99th percentile of the centre view while views are compared."""


def white_level(centre: Float[Array, "h w"]) -> Float[Array, ""]:
    """What counts as white: the 99th percentile of grey, unless nearly all of the view is black.

    Args:
        centre: ``[h, w]`` grey centre view.

    Returns:
        A positive grey value.

    Example:
        >>> round(float(white_level(jnp.linspace(0.0, 1.0, 101)[None])), 2)
        0.99
    """
    return jnp.maximum(jnp.maximum(jnp.quantile(centre, 0.99), centre.max() / 100), 1e-9)


def vignetted(centre: Float[Array, "h w"], darkness: float) -> Bool[Array, "h w"]:
    """Where all is dark up to a side of the image.

    Dark objects within the image do not count: their outline tells their disparity, while that of a
    vignette is no part of the scene.

    Args:
        centre: ``[h, w]`` grey centre view.
        darkness: Grey up to which a pixel is dark.

    Returns:
        ``[h, w]`` mask.

    Example:
        >>> vignetted(jnp.array([[0.0, 0.5, 0.0, 0.5]] * 3), 0.1)[1].tolist()
        [True, False, True, False]
    """
    dark = (centre <= darkness).astype(jnp.int32)
    to_sides = [
        jax.lax.cummin(dark, axis=axis, reverse=reverse)
        for axis in (0, 1)
        for reverse in (False, True)
    ]
    return jnp.stack(to_sides).max(0) > 0
