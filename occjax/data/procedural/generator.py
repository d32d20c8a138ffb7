"""The generator: from a random key to a light field with exact disparity and visibility."""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from occjax.data.procedural.config import SceneConfig
from occjax.data.procedural.draws import Key
from occjax.data.procedural.scenes import RandomScene, random_scene
from occjax.data.procedural.sensor import add_camera_defects
from occjax.data.procedural.shading import brightness, shade_maps
from occjax.data.procedural.surfaces import first_hits
from occjax.data.samples import LightFieldSample
from occjax.lightfield import project


@partial(jax.jit, static_argnames="config")
def generate(key: Key, config: SceneConfig = SceneConfig()) -> LightFieldSample:
    """Draw a random light field with its ground truth.

    Args:
        key: Random key; the same key gives the same light field.
        config: The distribution to draw from.

    Returns:
        Grey views ``[v, u, h, w]``, their offsets, the disparity of the ray through the middle of
        each pixel of the centre view, exact visibility, and all pixels valid.

    Example:
        >>> config = SceneConfig(image_size=(16, 24), grid=(3, 3), sheets=2, solids=1)
        >>> sample = generate(jax.random.key(0), config)
        >>> sample.views.shape, sample.disparity.shape, sample.visibility.shape
        ((1, 9, 16, 24), (16, 24), (1, 9, 16, 24))
    """
    scene_key, ray_key, camera_key = jax.random.split(key, 3)
    offsets = jnp.asarray(config.offsets)
    flat_offsets = offsets.reshape(-1, 2)
    scene = random_scene(scene_key, config)
    views = render(scene, flat_offsets, config, ray_key)
    y, x = pixel_grid(config.image_size)
    disparity = first_hits(scene.geometry, y, x, jnp.zeros(2)).disparity
    visibility = jax.lax.map(lambda offset: view_visibility(scene, disparity, offset), flat_offsets)
    views = add_camera_defects(camera_key, views, flat_offsets, config.defects)
    shape = (*offsets.shape[:2], *config.image_size)
    return LightFieldSample(
        views=views.reshape(shape),
        offsets=offsets,
        disparity=disparity,
        visibility=visibility.reshape(shape),
        valid=jnp.ones(config.image_size, bool),
    )


@partial(jax.jit, static_argnames="config")
def true_disparities(key: Key, config: SceneConfig = SceneConfig()) -> Float[Array, "v u h w"]:
    """Compute the exact disparity of every view of a random light field.

    Args:
        key: Random key of the light field, as for :func:`generate`.
        config: The distribution that it was drawn from.

    Returns:
        ``[v, u, h, w]`` disparity of the ray through the middle of each pixel of each view, in
        pixels per view step. That of the centre view is ``generate(key, config).disparity``, up to
        rounding.

    Example:
        >>> config = SceneConfig(image_size=(16, 24), grid=(3, 3), views="all", sheets=2, solids=1)
        >>> true_disparities(jax.random.key(0), config).shape
        (3, 3, 16, 24)
    """
    scene_key, _, _ = jax.random.split(key, 3)
    geometry = random_scene(scene_key, config).geometry
    y, x = pixel_grid(config.image_size)
    offsets = jnp.asarray(config.offsets)
    maps = jax.lax.map(
        lambda offset: first_hits(geometry, y, x, offset).disparity, offsets.reshape(-1, 2)
    )
    return maps.reshape(*offsets.shape[:2], *config.image_size)


def render(
    scene: RandomScene, offsets: Float[Array, "n 2"], config: SceneConfig, key: Key
) -> Float[Array, "n h w"]:
    """Render the brightness of views, averaged over the rays of each pixel.

    Rays are distributed over two pixels with the weight of bilinear interpolation (a tent). The
    tent is divided into as many parts of equal weight as there are rays; each ray is drawn at
    random within one part. The brightness is at least 0; offsets are in view steps.
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

    # In one loop, XLA would recompute rays and hits for each of their uses.
    rays = jax.lax.map(cast, (offsets, jax.random.split(key, offsets.shape[0])))
    light = jax.lax.map(lambda item: brightness(*scene, shade, *item), rays)
    return jnp.mean(light, axis=1)


def view_visibility(
    scene: RandomScene, disparity: Float[Array, "h w"], offset: Float[Array, "2"]
) -> Bool[Array, "h w"]:
    """Return whether a view sees what the centre view, of this disparity, sees at each pixel.

    A point is visible if its ray hits no surface that is nearer by more than 0.002 pixels per view
    step. Points outside the view's image are not visible.
    """
    h, w = disparity.shape
    y, x = project(*pixel_grid((h, w)), disparity, offset)
    inside = (jnp.abs(y) <= 0.5 * (h - 1)) & (jnp.abs(x) <= 0.5 * (w - 1))
    nearest = first_hits(scene.geometry, y, x, offset).disparity
    # Rounding changes the disparity of a point by up to about 1e-4 from view to view, and a point
    # must not hide itself. A larger tolerance misses occluders that are close to the point.
    return inside & (nearest <= disparity + 2e-3)


def pixel_grid(image_size: tuple[int, int]) -> tuple[Float[Array, "h w"], Float[Array, "h w"]]:
    """Return row and column of every pixel, in pixels from the image centre."""
    rows, columns = (jnp.arange(size, dtype=jnp.float32) - 0.5 * (size - 1) for size in image_size)
    y, x = jnp.meshgrid(rows, columns, indexing="ij")
    return y, x


def _tent_quantile(uniform: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Map uniform numbers in [0, 1] to positions in (-1, 1) with the density of a tent."""
    rising = jnp.sqrt(2.0 * jnp.minimum(uniform, 1.0 - uniform))
    return jnp.where(uniform < 0.5, rising - 1.0, 1.0 - rising)
