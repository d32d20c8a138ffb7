"""Which views are occluded at each pixel of the centre view, judged by photo-consistency."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from occjax.errors import InputError
from occjax.ops.sampling import Border, as_images
from occjax.ops.volume import warp_views


def occlusion_maps(
    views: Float[Array, "v u h w c"],
    disparity: Float[Array, "h w"],
    *,
    offsets: Float[Array, "v u 2"] | None = None,
    border: Border = "replicate",
) -> Float[Array, "v u h w"]:
    """How far each view, warped to the centre, departs from the centre view (eqs. 4 and 5).

    ``M = clip(|I_centre - warp(I, d)|_1, 0, 1)``: 0 where a view sees what the centre view sees,
    towards 1 where something else stands in between (or the disparity is wrong).

    Args:
        views: ``[v, u, h, w, c]`` images in [0, 1]; the published network uses grey ones, c = 1.
        disparity: ``[h, w]`` disparity of the centre view, pixels per view step.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view; a regular
            grid by default.
        border: What lies outside a view, see :func:`occjax.ops.warp`.

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
            f"disparity must be [{h}, {w}] as the views, not {list(jnp.shape(disparity))}"
        )
    warped = warp_views(views, disparity, offsets=offsets, border=border)
    departure = jnp.abs(warped - views[v // 2, u // 2][None, None]).sum(-1)
    return jnp.clip(departure, 0.0, 1.0)


def occlusion_weights(maps: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """Weight of each view in the refined volume, ``(1 - M)^2`` (eq. 6 as published).

    The paper writes ``||1 - M||_2``; its code squares, and the published weights rely on it.

    Args:
        maps: Occlusion maps in [0, 1], any shape.

    Returns:
        Weights in [0, 1], 1 where nothing is occluded, same shape.

    Example:
        >>> float(occlusion_weights(jnp.float32(0.5)))
        0.25
    """
    return jnp.square(1.0 - jnp.asarray(maps))
