"""Light fields with known disparity and images with known noise."""

import jax.numpy as jnp
import numpy as np

from occjax.lightfield import LightField


def plane(
    grid=(3, 3),
    size=(40, 48),
    disparity=0.6,
    slope=(0.0, 0.0),
    seed=0,
    **fields,
) -> LightField:
    """Return a textured plane: the centre view's disparity is ``disparity + slope . (y, x)``.

    View (v, u) sees the point (Y, X) of the centre view at (Y - d v, X - d u), where d is its
    disparity. Since d is linear in (Y, X), this is solved for (Y, X) in closed form. The texture is
    a sum of sines, evaluated without interpolation.
    """
    generator = np.random.default_rng(seed)
    frequency = generator.uniform(-1.3, 1.3, (24, 2))
    phase = generator.uniform(0, 2 * np.pi, (24, 3))
    y, x = np.mgrid[: size[0], : size[1]].astype(float)
    views = np.empty((*grid, *size, 3), np.float32)
    for row, column in np.ndindex(grid):
        v, u = row - grid[0] // 2, column - grid[1] // 2
        # d = (disparity + slope . (y, x)) / (1 - slope . (v, u)) at pixel (y, x) of this view
        d = (disparity + slope[0] * y + slope[1] * x) / (1 - slope[0] * v - slope[1] * u)
        point = np.stack([y + d * v, x + d * u], -1)
        waves = np.sin((point @ frequency.T)[..., None] + phase)
        views[row, column] = 0.5 + waves.mean(-2) * 1.2
    truth = (disparity + slope[0] * y + slope[1] * x).astype(np.float32)
    return LightField(np.clip(views, 0, 1), ground_truth=truth, **{"name": "plane", **fields})


def noisy_waves(deviation, disparity=0.25, *, views=3, size=64, amplitude=0.2):
    """Return ``[views, views, size, size]`` grey waves at one disparity with normal noise."""
    y, x = np.mgrid[:size, :size].astype(float)
    generator = np.random.default_rng(0)
    images = np.empty((views, views, size, size), np.float32)
    for row, column in np.ndindex(views, views):
        v, u = row - views // 2, column - views // 2
        scene_y, scene_x = y + disparity * v, x + disparity * u
        waves = np.sin(0.3 * scene_x + 0.1 * scene_y) + np.sin(0.25 * scene_y)
        images[row, column] = 0.5 + amplitude * waves + generator.normal(0, deviation, y.shape)
    return jnp.asarray(images)


def correlated_noise(shape, down, right):
    """Return noise ``[..., h, w]`` and its correlation ``(along a column, along a row)``.

    To independent noise of standard deviation 0.01, the fractions ``down`` and ``right`` of the
    pixels above and to the left are added.
    """
    *n, h, w = shape
    draws = np.random.default_rng(0).normal(0, 0.01, (*n, h + 1, w + 1))
    draws = draws[..., 1:, :] + down * draws[..., :-1, :]
    draws = draws[..., 1:] + right * draws[..., :-1]
    # The correlation of n_k + a n_(k - 1) is a / (1 + a^2).
    return draws.astype(np.float32), [down / (1 + down**2), right / (1 + right**2)]


def two_plane_maps(grid=(3, 3), size=24, far=0.0, near=2.0):
    """Return the exact ``[V, U, size, size]`` maps of a near square in front of a far plane.

    The centre view sees the square in rows and columns 8 to 15; it moves by whole pixels.
    """
    maps = np.full((*grid, size, size), far, np.float32)
    for v, u in np.ndindex(grid):
        top, left = int(8 - near * (v - grid[0] // 2)), int(8 - near * (u - grid[1] // 2))
        maps[v, u, top : top + 8, left : left + 8] = near
    return maps
