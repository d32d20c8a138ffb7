"""Closed-form light fields: textured planes whose views are evaluated, not interpolated."""

import numpy as np

WAVES = np.random.default_rng(7).uniform(-1.0, 1.0, (40, 4))
"""Frequencies (row, column), phase and colour of the waves of a texture."""


def texture(y, x, waves=WAVES):
    """Band-limited pattern in [0, 1] at real rows ``[h]`` and columns ``[w]``: ``[h, w, 3]``.

    With sin(a + b) = sin(a) cos(b) + cos(a) sin(b), the sum of waves is a matrix product.
    """
    rows, columns, phase, colour = waves.T
    tint = np.stack([np.ones_like(colour), colour, -colour], axis=-1)
    a = np.multiply.outer(y, rows * 0.9)
    b = np.multiply.outer(x, columns * 0.9) + 6.3 * phase
    down = np.concatenate([np.sin(a), np.cos(a)], axis=-1)
    across = np.concatenate([np.cos(b), np.sin(b)], axis=-1)[..., None] * np.tile(tint, (2, 1))
    sines = np.tensordot(down, across, (1, 1))
    return np.clip(0.5 + 0.12 * sines, 0.0, 1.0)


def two_planes(grid=(5, 5), size=(64, 64), far=-1.0, near=1.5, positions=None, shifts=None):
    """A square in front of a wall, both textured, as floating point views and exact disparity.

    Cameras stand at ``positions`` instead of the places of the grid; the content of each view is
    displaced by ``shifts`` pixels; both are ``[V, U, 2]``.

    By the definition of disparity, view (v, u) sees at (y, x) the point that the centre view sees
    at (y + d (v - v0), x + d (u - u0)) -- of the square where that falls on the square, else of the
    wall.
    """
    (rows, columns), (h, w) = grid, size
    y, x = np.arange(h, dtype=float), np.arange(w, dtype=float)

    def on_square(y, x):
        return np.logical_and.outer(abs(y - h / 2) < h / 4, abs(x - w / 2) < w / 4)

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
