"""Random light fields to train on, as a pure function of a random key.

:func:`generate` draws a scene (:mod:`occjax.data.random_scenes`), intersects every ray of every
view with every surface in closed form (:mod:`occjax.data.patches`), shades what is nearest
(:mod:`occjax.data.shading`) and adds the faults of a camera (:mod:`occjax.data.sensor`). Disparity
and visibility are exact.
"""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from occjax.data.draws import Key
from occjax.data.patches import first_hits
from occjax.data.random_scenes import RandomScene, random_scene
from occjax.data.samples import Sample
from occjax.data.scene_config import SceneConfig, arrangement
from occjax.data.sensor import expose
from occjax.data.shading import brightness, shade_maps

VISIBLE_WITHIN = 2e-3
"""A point is visible where its ray is stopped at most this much disparity in front of it."""


@partial(jax.jit, static_argnames=("config", "views_at_once"))
def generate(
    key: Key,
    config: SceneConfig = SceneConfig(),
    photographs: Float[Array | np.ndarray, "p 256 256"] | None = None,
    *,
    views_at_once: int = 1,
) -> Sample:
    """Draw a random light field with its ground truth.

    Args:
        key: Random key; the same key gives the same light field.
        config: The distribution to draw from.
        photographs: ``[p, 256, 256]`` grey photographs in [0, 1], some of which become textures;
            see :func:`occjax.data.photographs.load_photographs`.
        views_at_once: Views that are rendered side by side. One at a time is best on a CPU, whose
            cache holds no more; a GPU wants many.

    Returns:
        Grey views, their offsets, the disparity of the ray through the middle of each pixel of the
        centre view, exact visibility, and all pixels valid.

    Example:
        >>> config = SceneConfig(image_size=(16, 24), grid=(3, 3), sheets=2, solids=1)
        >>> sample = generate(jax.random.key(0), config)
        >>> sample.views.shape, sample.disparity.shape, sample.visibility.shape
        ((1, 9, 16, 24), (16, 24), (1, 9, 16, 24))
    """
    scene_key, ray_key, camera_key = jax.random.split(key, 3)
    offsets = jnp.asarray(arrangement(config.grid, config.views))
    flat_offsets = offsets.reshape(-1, 2)
    scene = random_scene(scene_key, config, photographs)
    views = render(scene, flat_offsets, config, ray_key, views_at_once)
    disparity = centre_disparity(scene, config.image_size)
    visibility = jax.lax.map(
        lambda offset: view_visibility(scene, disparity, offset),
        flat_offsets,
        batch_size=views_at_once,
    )
    views = expose(camera_key, views, flat_offsets, config.defects)
    shape = (*offsets.shape[:2], *config.image_size)
    return Sample(
        views=views.reshape(shape),
        offsets=offsets,
        disparity=disparity,
        visibility=visibility.reshape(shape),
        valid=jnp.ones(config.image_size, bool),
    )


def render(
    scene: RandomScene,
    offsets: Float[Array, "n 2"],
    config: SceneConfig,
    key: Key,
    views_at_once: int = 1,
) -> Float[Array, "n h w"]:
    """Brightness of views, averaged over the rays of each pixel.

    Rays are spread over two pixels with the weight of bilinear interpolation, one in each of as
    many parts of equal weight, at random within its part.
    """
    y, x = pixel_grid(config.image_size)
    strata = round(config.rays**0.5)
    parts = np.indices((strata, strata), np.float32).reshape(2, -1, 1, 1)

    def cast(item):
        offset, view_key = item
        jitter = jax.random.uniform(view_key, (2, config.rays, *config.image_size))
        spread_y, spread_x = _tent_quantile((jitter + parts) / strata)
        ray_y, ray_x = y[None] + spread_y, x[None] + spread_x
        return offset, ray_y, ray_x, first_hits(scene.geometry, ray_y, ray_x, offset)

    shade = shade_maps(scene.geometry, scene.light, config.image_size)

    # Separate loops: compiled as one, rays and hits would be computed anew for each of their uses.
    keys = jax.random.split(key, offsets.shape[0])
    rays = jax.lax.map(cast, (offsets, keys), batch_size=views_at_once)
    light = jax.lax.map(
        lambda item: brightness(*scene, shade, *item), rays, batch_size=views_at_once
    )
    return jnp.mean(light, axis=1)


def centre_disparity(scene: RandomScene, image_size: tuple[int, int]) -> Float[Array, "h w"]:
    """Disparity of the centre view, of the ray through the middle of each pixel."""
    y, x = pixel_grid(image_size)
    return first_hits(scene.geometry, y, x, jnp.zeros(2)).disparity


def view_visibility(
    scene: RandomScene, disparity: Float[Array, "h w"], offset: Float[Array, "2"]
) -> Array:
    """Whether a view sees what the centre view sees at each of its pixels: ``[h, w]``, bool."""
    h, w = disparity.shape
    y, x = pixel_grid((h, w))
    y, x = y - disparity * offset[0], x - disparity * offset[1]
    inside = (jnp.abs(y) <= 0.5 * (h - 1)) & (jnp.abs(x) <= 0.5 * (w - 1))
    nearest = first_hits(scene.geometry, y, x, offset).disparity
    return inside & (nearest <= disparity + VISIBLE_WITHIN)


def pixel_grid(image_size: tuple[int, int]) -> tuple[Float[Array, "h w"], Float[Array, "h w"]]:
    """Row and column of every pixel, from the image centre."""
    rows, columns = (jnp.arange(size, dtype=jnp.float32) - 0.5 * (size - 1) for size in image_size)
    y, x = jnp.meshgrid(rows, columns, indexing="ij")
    return y, x


def _tent_quantile(uniform: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Position in (-1, 1) below which a tent has this share of its area."""
    rising = jnp.sqrt(2.0 * jnp.minimum(uniform, 1.0 - uniform))
    return jnp.where(uniform < 0.5, rising - 1.0, 1.0 - rising)
