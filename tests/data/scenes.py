"""A scene with occlusion in closed form, for tests of what changes light fields."""

import jax
import jax.numpy as jnp
import numpy as np
from scipy.ndimage import map_coordinates

from occjax.data.samples import LightFieldSample
from occjax.lightfield import centre_index

WALL, DISC = -0.5, 1.5
"""Disparity of the wall, and of the disc in front of it (where the slope adds nothing)."""


def star(size):
    """Offsets ``[1, n, 2]`` of row, column and diagonals, by their definition."""
    half = size // 2
    places = [(r, c) for r in range(-half, half + 1) for c in range(-half, half + 1)]
    return np.array([[p for p in places if 0 in p or abs(p[0]) == abs(p[1])]], np.float32)


def cheap_scene(key, config):
    """Stands for the generator, which takes long to compile: random numbers of the right shape."""
    parts = jax.random.split(key, 4)
    offsets = jnp.asarray(config.offsets)
    shape = (*offsets.shape[:2], *config.image_size)
    return LightFieldSample(
        views=jax.random.uniform(parts[0], shape),
        offsets=offsets,
        disparity=jax.random.normal(parts[1], config.image_size),
        visibility=jax.random.bernoulli(parts[2], 0.7, shape),
        valid=jax.random.bernoulli(parts[3], 0.9, config.image_size),
    )


def disc_before_a_wall(offsets, size=(44, 52), seed=0, slope=(0.004, -0.006)):
    """A dark, slanted wall and a bright disc, as a sample and with the disc's mask as its views.

    Pixel ``p`` of the view at offset ``o`` sees the point of the disc that the centre view has at
    ``p + DISC o`` if that is inside the circle, and else the point of the wall at ``q`` with
    ``q - d(q) o = p``, d linear: ``d = (WALL + slope . p) / (1 - slope . o)``.
    """
    generator = np.random.default_rng(seed)
    frequency, phase = generator.uniform(-0.13, 0.13, (8, 2)), generator.uniform(0, 6.28, 8)

    def texture(y, x):
        return np.mean(
            np.sin(frequency[:, 0] * y[..., None] + frequency[:, 1] * x[..., None] + phase), axis=-1
        )

    y, x = np.mgrid[: size[0], : size[1]].astype(float)
    middle, radius = (0.45 * size[0], 0.55 * size[1]), 0.24 * min(size)

    def on_disc(y, x):
        return np.hypot(y - middle[0], x - middle[1]) <= radius

    def wall(y, x, row=0.0, column=0.0):
        linear = WALL + slope[0] * (y - middle[0]) + slope[1] * (x - middle[1])
        return linear / (1 - slope[0] * row - slope[1] * column)

    disparity = np.where(on_disc(y, x), DISC, wall(y, x))
    views, masks, visibility = (np.empty((*offsets.shape[:2], *size)) for _ in range(3))
    for place in np.ndindex(offsets.shape[:2]):
        row, column = offsets[place]
        d = wall(y, x, row, column)
        masks[place] = on_disc(y + DISC * row, x + DISC * column)
        views[place] = np.where(
            masks[place] > 0,
            0.75 + 0.35 * texture(y + DISC * row + 100, x + DISC * column),
            0.25 + 0.35 * texture(y + d * row, x + d * column),
        )
        seen_y, seen_x = y - disparity * row, x - disparity * column
        hidden = on_disc(seen_y + DISC * row, seen_x + DISC * column) & (disparity != DISC)
        inside = (seen_y >= 0) & (seen_y <= size[0] - 1) & (seen_x >= 0) & (seen_x <= size[1] - 1)
        visibility[place] = ~hidden & inside
    sample = LightFieldSample(
        views=jnp.asarray(views, jnp.float32),
        offsets=jnp.asarray(offsets),
        disparity=jnp.asarray(disparity, jnp.float32),
        visibility=jnp.asarray(visibility, bool),
        valid=jnp.asarray(np.hypot(y - 5, x - 7) > 3),
    )
    return sample, sample._replace(views=jnp.asarray(np.where(masks, 0.75, 0.25), jnp.float32))


def warped(images, sample):
    """Views ``[v, u, h, w]`` brought into register with the centre view, NaN outside of them."""
    images, disparity = np.asarray(images), np.asarray(sample.disparity)
    y, x = np.mgrid[: disparity.shape[0], : disparity.shape[1]].astype(float)
    result = np.empty(images.shape)
    for place in np.ndindex(images.shape[:2]):
        row, column = np.asarray(sample.offsets)[place]
        where = np.stack([y - disparity * row, x - disparity * column])
        where = np.where(np.abs(where - np.rint(where)) < 1e-4, np.rint(where), where)
        result[place] = map_coordinates(images[place], where, order=1, cval=np.nan, mode="constant")
    return result


def assert_consistent(sample, masks, tolerance=0.02):
    """Visible points look as in the centre view, and only those; taps across an edge are left out.

    Returns the number of hidden points that were compared.

    ``masks`` is the sample with the disc's mask as its views, changed as the sample was.
    """
    centre = centre_index(sample.views.shape[:2])
    np.testing.assert_array_equal(np.asarray(sample.offsets)[centre], 0)
    np.testing.assert_array_equal(sample.disparity, masks.disparity)
    difference = np.abs(warped(sample.views, sample) - np.asarray(sample.views[centre]))
    disc = warped(masks.views, masks)
    pure = np.abs(np.abs(disc - 0.5) - 0.25) < 1e-3
    visible = np.asarray(sample.visibility)
    assert np.isfinite(difference[visible]).all()
    assert difference[visible & pure].max() < tolerance
    hidden = ~visible & pure & np.isfinite(difference)
    assert difference[hidden].min(initial=1.0) > 0.2
    return int(hidden.sum())
