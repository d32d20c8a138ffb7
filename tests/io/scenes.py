"""Closed-form light fields: textured planes whose views are evaluated, not interpolated."""

import numpy as np

WAVES = np.random.default_rng(7).uniform(-1.0, 1.0, (40, 4))
"""Frequencies (row, column), phase and colour of the waves of a texture."""


def texture(y, x, waves=WAVES):
    """Band-limited pattern in [0, 1] at any real position: ``[..., 3]``."""
    rows, columns, phase, colour = waves.T
    angle = np.multiply.outer(y, rows * 0.9) + np.multiply.outer(x, columns * 0.9) + 6.3 * phase
    tint = np.stack([np.ones_like(colour), colour, -colour], axis=-1)
    return np.clip(0.5 + 0.12 * np.sin(angle) @ tint, 0.0, 1.0)


def two_planes(grid=(5, 5), size=(96, 96), far=-1.0, near=1.5, positions=None, shifts=None):
    """A square in front of a wall, both textured, as floating point views and exact disparity.

    Cameras stand at ``positions`` instead of the places of the grid; the content of each view is
    displaced by ``shifts`` pixels; both are ``[V, U, 2]``.

    By the definition of disparity, view (v, u) sees at (y, x) the point that the centre view sees
    at (y + d (v - v0), x + d (u - u0)) -- of the square where that falls on the square, else of the
    wall.
    """
    (rows, columns), (h, w) = grid, size
    y, x = np.mgrid[:h, :w].astype(float)

    def on_square(y, x):
        return (abs(y - h / 2) < h / 4) & (abs(x - w / 2) < w / 4)

    def view(v, u):
        dv, du = (v - rows // 2, u - columns // 2) if positions is None else positions[v, u]
        down, right = (0.0, 0.0) if shifts is None else shifts[v, u]
        row, column = y - down, x - right
        wall = texture(row + far * dv, column + far * du)
        square = texture(row + near * dv, column + near * du, WAVES[::-1] * [1.1, 1.1, 1.0, -1.0])
        shown = on_square(row + near * dv, column + near * du)
        return np.where(shown[..., None], square * 0.8, 0.2 + 0.8 * wall)

    views = np.stack([[view(v, u) for u in range(columns)] for v in range(rows)])
    return views.astype(np.float32), np.where(on_square(y, x), near, far).astype(np.float32)
