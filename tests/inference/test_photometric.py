"""The training-free estimator on scenes whose disparity is known in closed form."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.inference.photometric import photometric

HEIGHT, WIDTH, BORDER = 36, 44, 6
CANDIDATES = jnp.linspace(-2.0, 2.0, 33)
estimate = jax.jit(photometric)


def _texture(y, x, seed=0):
    """``[..., 3]`` colours in [0, 1] at real coordinates: waves no shorter than four pixels."""
    rng = np.random.default_rng(seed)
    angle, length, phase = rng.uniform(0, [[2 * np.pi], [1.0], [2 * np.pi]], (3, 24))
    frequency = 2 * np.pi / (4.0 + 10.0 * length)
    along = y[..., None] * np.sin(angle) + x[..., None] * np.cos(angle)
    colour = np.sin(frequency * along + phase) @ rng.normal(0, 0.1, (24, 3))
    return np.clip(0.5 + colour, 0.0, 1.0)


def _grid(v, u):
    for row, column in np.ndindex(v, u):
        yield row, column, row - v // 2, column - u // 2


def _plane(v, u, disparity=0.3, slope=(0.01, -0.02), offsets=None):
    """Views of ``disparity + slope . (y, x)`` and that disparity ``[h, w]`` in the centre view."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    views = np.empty((v, u, HEIGHT, WIDTH, 3), np.float32)
    for row, column, down, right in _grid(v, u):
        if offsets is not None:
            down, right = offsets[row, column]
        # (y, x) of a view is centre pixel (y + d down, x + d right), where d obeys the plane.
        d = (disparity + slope[0] * y + slope[1] * x) / (1 - slope[0] * down - slope[1] * right)
        views[row, column] = _texture(y + d * down, x + d * right)
    return jnp.asarray(views), disparity + slope[0] * y + slope[1] * x


def _square(v, u, near=1.0, far=-1.0):
    """A square at disparity ``near`` before a background at ``far``, and its disparity."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    views = np.empty((v, u, HEIGHT, WIDTH, 3), np.float32)

    def inside(y, x):
        return (np.abs(y - 17.5) < 8) & (np.abs(x - 21.5) < 10)

    for row, column, down, right in _grid(v, u):
        foreground = y + near * down, x + near * right
        background = _texture(y + far * down, x + far * right, seed=1)
        views[row, column] = np.where(
            inside(*foreground)[..., None], _texture(*foreground), background
        )
    return jnp.asarray(views), np.where(inside(y, x), near, far)


def _inner(image):
    return np.asarray(image)[..., BORDER:-BORDER, BORDER:-BORDER]


@pytest.mark.parametrize(
    ("grid", "mean_error"), [((9, 9), 0.03), ((3, 3), 0.03), ((1, 5), 0.04), ((5, 1), 0.04)]
)
def test_a_slanted_textured_plane_is_recovered(grid, mean_error):
    views, truth = _plane(*grid)
    error = np.abs(_inner(estimate(views, CANDIDATES).disparity - truth))
    assert error.mean() < mean_error
    assert error.max() < 0.4
