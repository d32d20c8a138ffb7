"""Light fields of procedural scenes, with exact disparity and visibility.

The scene stands in a box seen through the image plane: scene coordinates are ``x`` to the right and
``y`` down, in pixels from the image centre where disparity is zero, and ``z`` towards the camera.
The point that the centre view sees at ``(Y, X)`` with disparity ``d`` is

``(X - X0, Y - Y0, relief * d) / (1 + perspective * d)``

so ``perspective = 0`` is a light field of parallel projections and any other value is that of a
grid of pinhole cameras. The ray of pixel ``(y, x)`` of the view at offset ``(t, s)`` (row, column)
is the set of points with ``Y = y + d t``, ``X = x + d s``, a straight line of the scene: every ray
of every view is intersected in closed form, and the nearest surface wins.

Light (:mod:`occjax.data.lighting`) does not depend on the view, so that all views agree on the
colour of what they see.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from occjax.data.lighting import Lighting, Seen, light_from, sampling_patterns
from occjax.data.surfaces import Hits, Surfaces, first_hits
from occjax.data.textures import srgb_from_linear
from occjax.ops.geometry import view_offsets

VISIBLE_WITHIN = 5e-3
"""A point is visible where its ray is stopped at most this much disparity in front of it."""


class Camera(NamedTuple):
    """The grid of cameras.

    Attributes:
        relief: Depth of the scene per unit of disparity at zero disparity, in pixels.
        perspective: Relative growth of things per unit of disparity; ``relief / perspective`` is
            the focal length in pixels.
    """

    relief: Float[Array, ""]
    perspective: Float[Array, ""]


class Scene(NamedTuple):
    """Everything that a picture depends on, as arrays."""

    surfaces: Surfaces
    camera: Camera
    lighting: Lighting


class Rendered(NamedTuple):
    """A rendered light field.

    Attributes:
        views: ``[v, u, h, w, 3]`` sRGB in [0, 1].
        disparity: ``[h, w]`` of the ray through the middle of each pixel of the centre view, pixels
            per view step; exact.
        visibility: ``[v, u, h, w]`` whether each view sees the point that the centre view sees at
            that pixel: not behind another surface and not outside the image.
    """

    views: Float[Array, "v u h w 3"]
    disparity: Float[Array, "h w"]
    visibility: Bool[Array, "v u h w"]


@partial(jax.jit, static_argnames=("grid", "image_size", "samples"))
def render(
    scene: Scene, *, grid: tuple[int, int], image_size: tuple[int, int], samples: int = 4
) -> Rendered:
    """Render all views of a scene, with the ground truth of the centre view.

    Args:
        scene: What to render.
        grid: ``(V, U)`` number of views.
        image_size: ``(H, W)`` of each view, in pixels.
        samples: Rays per pixel along each axis.

    Returns:
        Views, disparity and visibility.

    Example:
        >>> from occjax.data.still_life import still_life
        >>> rendered = render(still_life(), grid=(1, 3), image_size=(4, 6), samples=1)
        >>> rendered.views.shape, rendered.disparity.shape, rendered.visibility.shape
        ((1, 3, 4, 6, 3), (4, 6), (1, 3, 4, 6))
    """
    offsets = view_offsets(*grid)
    disparity = centre_disparity(scene, image_size)

    def one_view(offset):
        image = render_rows(scene, offset, jnp.arange(image_size[0]), image_size, samples=samples)
        return image, view_visibility(scene, disparity, offset)

    flat_views, flat_visibility = jax.lax.map(one_view, offsets.reshape(-1, 2))
    return Rendered(
        views=flat_views.reshape(*grid, *image_size, 3),
        disparity=disparity,
        visibility=flat_visibility.reshape(*grid, *image_size),
    )


@partial(jax.jit, static_argnames=("image_size", "samples"))
def render_rows(
    scene: Scene,
    offset: Float[Array, "2"],
    rows: Array,
    image_size: tuple[int, int],
    *,
    samples: int,
) -> Float[Array, "rows w 3"]:
    """Some rows of the view at an offset, averaged over the rays of each pixel.

    Each of a pixel's rays looks at another part of the lamp and of the sky; their average is a soft
    shadow, the same in every view.

    Args:
        scene: What to render.
        offset: ``[2]`` row and column offset of the view from the centre view.
        rows: ``[rows]`` integer pixel rows.
        image_size: ``(H, W)`` of the view, in pixels.
        samples: Rays per pixel along each axis.

    Returns:
        ``[rows, W, 3]`` sRGB in [0, 1].
    """
    within = _tent_quantiles(samples)
    sub_y, sub_x = (part.ravel() for part in jnp.meshgrid(within, within, indexing="ij"))
    lamp_points, sky_points = sampling_patterns(samples**2)
    columns = jnp.arange(image_size[1], dtype=jnp.float32)

    def one_row(row):
        y = jnp.broadcast_to(row + sub_y, (image_size[1], samples**2))
        x = columns[:, None] + sub_x[None, :]

        def tiled(points):
            return jnp.tile(points, (image_size[1], 1))

        light = _radiance(
            scene, y.ravel(), x.ravel(), offset, image_size, tiled(lamp_points), tiled(sky_points)
        )
        return srgb_from_linear(jnp.mean(light.reshape(image_size[1], samples**2, 3), axis=1))

    return jax.lax.map(one_row, rows.astype(jnp.float32))


@partial(jax.jit, static_argnames=("image_size",))
def centre_disparity(scene: Scene, image_size: tuple[int, int]) -> Float[Array, "h w"]:
    """Disparity of the centre view, of the ray through the middle of each pixel."""
    y, x = _pixel_grid(image_size)
    _, disparity = trace(scene, y.ravel(), x.ravel(), jnp.zeros(2), image_size)
    return disparity.reshape(image_size)


@jax.jit
def view_visibility(
    scene: Scene, disparity: Float[Array, "h w"], offset: Float[Array, "2"]
) -> Bool[Array, "h w"]:
    """Whether a view sees what the centre view sees at each of its pixels."""
    h, w = disparity.shape
    y, x = _pixel_grid((h, w))
    y, x = y - disparity * offset[0], x - disparity * offset[1]
    inside = (y >= 0.0) & (y <= h - 1.0) & (x >= 0.0) & (x <= w - 1.0)
    _, nearest = trace(scene, y.ravel(), x.ravel(), offset, (h, w))
    return inside & (nearest.reshape(h, w) <= disparity + VISIBLE_WITHIN)


def trace(
    scene: Scene,
    y: Float[Array, " r"],
    x: Float[Array, " r"],
    offset: Float[Array, "2"],
    image_size: tuple[int, int],
) -> tuple[Hits, Float[Array, " r"]]:
    """First hit and its disparity for rays of one view.

    Args:
        scene: What to look at.
        y: ``[r]`` pixel rows, not necessarily whole.
        x: ``[r]`` pixel columns.
        offset: ``[2]`` row and column offset of the view from the centre view.
        image_size: ``(H, W)`` of the view, in pixels.

    Returns:
        The hits, and ``[r]`` disparities in pixels per view step: that of infinitely distant points
        where nothing is hit.
    """
    camera = scene.camera
    origins, directions = view_rays(camera, y, x, offset, image_size)
    # Rays start at zero disparity and run away from the camera, so what stands in front of that
    # plane has negative parameters, down to the camera itself at -1 / perspective.
    closest = jnp.where(camera.perspective > 0.0, -0.98 / camera.perspective, -jnp.inf)
    hits = first_hits(scene.surfaces, origins, directions, closest)
    disparity = -hits.distance / (1.0 + camera.perspective * hits.distance)
    farthest = -1.0 / jnp.maximum(camera.perspective, 1e-6)
    return hits, jnp.where(jnp.isinf(hits.distance), farthest, disparity)


def view_rays(
    camera: Camera,
    y: Float[Array, " r"],
    x: Float[Array, " r"],
    offset: Float[Array, "2"],
    image_size: tuple[int, int],
) -> tuple[Float[Array, "r 3"], Float[Array, "r 3"]]:
    """Origin (where disparity is zero) and direction (away from the camera) of rays of one view.

    A ray at parameter ``r`` has disparity ``-r / (1 + perspective * r)``.
    """
    h, w = image_size
    x, y = x - 0.5 * (w - 1), y - 0.5 * (h - 1)
    origins = jnp.stack([x, y, jnp.zeros_like(x)], axis=-1)
    directions = jnp.stack(
        [
            camera.perspective * x - offset[1],
            camera.perspective * y - offset[0],
            jnp.broadcast_to(-camera.relief, x.shape),
        ],
        axis=-1,
    )
    return origins, directions


def _radiance(scene, y, x, offset, image_size, lamp_points, sky_points) -> Float[Array, "r 3"]:
    """Linear RGB that each ray of a view brings back."""
    camera = scene.camera
    origins, directions = view_rays(camera, y, x, offset, image_size)
    hits, _ = trace(scene, y, x, offset, image_size)
    hit = jnp.isfinite(hits.distance)
    points = origins + jnp.where(hit, hits.distance, 0.0)[:, None] * directions
    focal = camera.relief / jnp.maximum(camera.perspective, 1e-3)
    eye = jnp.array([0.0, 0.0, 1.0]) * focal  # of the centre view, whichever view is rendered
    light = light_from(
        scene.surfaces,
        scene.lighting,
        Seen(hits.surface, points, directions),
        eye,
        lamp_points,
        sky_points,
    )
    return jnp.where(hit[:, None], light, scene.lighting.sky[None])


def _tent_quantiles(count: int) -> Float[Array, " k"]:
    """Positions in (-1, 1) whose density is a tent, the weight of bilinear interpolation.

    A pixel that averages only its own square still shows finer detail than pixels can carry, and
    shows it differently in each view; a tent two pixels wide hardly does.
    """
    uniform = (jnp.arange(count, dtype=jnp.float32) + 0.5) / count
    rising = jnp.sqrt(2.0 * jnp.minimum(uniform, 1.0 - uniform))
    return jnp.where(uniform < 0.5, rising - 1.0, 1.0 - rising)


def _pixel_grid(image_size: tuple[int, int]) -> tuple[Float[Array, "h w"], Float[Array, "h w"]]:
    """Row and column of every pixel."""
    rows, columns = (jnp.arange(size, dtype=jnp.float32) for size in image_size)
    y, x = jnp.meshgrid(rows, columns, indexing="ij")
    return y, x
