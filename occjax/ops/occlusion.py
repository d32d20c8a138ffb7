"""Occlusion of each view at each pixel of the centre view, from photo-consistency."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from occjax.errors import InputError
from occjax.lightfield import centre_index
from occjax.ops.sampling import Border, as_images
from occjax.ops.volume import warp_views


def occlusion_maps(
    views: Float[Array, "v u h w c"],
    disparity: Float[Array, "h w"],
    *,
    offsets: Float[Array | np.ndarray, "v u 2"] | None = None,
    border: Border = "replicate",
) -> Float[Array, "v u h w"]:
    """Compute the difference of each warped view from the centre view (eqs. 4 and 5).

    ``M = clip(|I_centre - warp(I, d)|_1, 0, 1)``: 0 where a view sees the same point as the centre
    view, towards 1 where the point is occluded (or the disparity is wrong). The gradient is zero
    where M is clipped at 1, and finite where a view agrees exactly.

    Args:
        views: ``[v, u, h, w, c]`` images in [0, 1]; the published network uses grey images, c = 1.
        disparity: ``[h, w]`` disparity of the centre view, pixels per view step.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view, in view
            steps; a regular grid by default.
        border: Values outside a view, see :func:`occjax.ops.warp`.

    Returns:
        ``[v, u, h, w]`` occlusion maps in [0, 1].

    Raises:
        InputError: If the views are not floating point, or the shapes do not fit together.

    Example:
        >>> float(occlusion_maps(jnp.ones((3, 3, 4, 4, 1)), jnp.zeros((4, 4))).max())
        0.0
    """
    views = as_images(views, "v u h w c")
    v, u, h, w, _ = views.shape
    if jnp.shape(disparity) != (h, w):
        raise InputError(
            f"disparity must be [{h}, {w}] like the views, not {list(jnp.shape(disparity))}"
        )
    warped = warp_views(views, disparity, offsets=offsets, border=border)
    difference = jnp.abs(warped - views[centre_index((v, u))][None, None]).sum(-1)
    return jnp.clip(difference, 0.0, 1.0)


def occlusion_weights(maps: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """Compute the weight of each view in the refined volume, ``(1 - M)^2`` (eq. 6).

    The paper writes ``||1 - M||_2``; the published code squares, and the published weights need
    that. The gradient ``-2 (1 - M)`` is zero where a view is fully occluded.

    Args:
        maps: ``[...]`` occlusion maps in [0, 1], as from :func:`occjax.ops.occlusion_maps`.

    Returns:
        ``[...]`` weights in [0, 1]; 1 where nothing is occluded.

    Example:
        >>> float(occlusion_weights(jnp.float32(0.5)))
        0.25
    """
    return jnp.square(1.0 - jnp.asarray(maps))
