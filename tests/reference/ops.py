"""The operations of ``occjax.ops`` in NumPy and float64, one pixel at a time.

An independent truth: every function follows its formula literally, shares no code with the library
and is simple rather than fast. Bilinear interpolation is a sum over all pixels,
each weighted by its hat function, so that no floor, clamp or tap order can be wrong in both.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np


def view_offsets(v: int, u: int) -> np.ndarray:
    """``[v, u, 2]`` row and column of each view minus those of the centre view."""
    offsets = np.zeros((v, u, 2))
    for row, column in np.ndindex(v, u):
        offsets[row, column] = row - v // 2, column - u // 2
    return offsets


def sample(image: np.ndarray, y: float, x: float, border: str) -> np.ndarray:
    """``[c]`` bilinear value of ``[h, w, c]`` at one position."""
    h, w, c = image.shape
    if border == "replicate":
        y, x = min(max(y, 0.0), h - 1.0), min(max(x, 0.0), w - 1.0)
    value = np.zeros(c)
    for row, column in np.ndindex(h, w):
        weight = max(0.0, 1.0 - abs(y - row)) * max(0.0, 1.0 - abs(x - column))
        if weight:
            value += weight * np.asarray(image[row, column], np.float64)
    return value


def warp(image, disparity, offset, *, border="replicate", first_row=0) -> np.ndarray:
    """``[r, w, c]`` image read at ``(y - d * offset[0], x - d * offset[1])``."""
    disparity, offset = np.asarray(disparity, np.float64), np.asarray(offset, np.float64)
    result = np.zeros((*disparity.shape, image.shape[2]))
    for y, x in np.ndindex(*disparity.shape):
        row = first_row + y - disparity[y, x] * offset[0]
        column = x - disparity[y, x] * offset[1]
        result[y, x] = sample(image, row, column, border)
    return result


def shift(image, disparity, offset) -> np.ndarray:
    """``[h, w, c]`` image moved by one disparity, zero outside."""
    return warp(image, np.full(image.shape[:2], float(disparity)), offset, border="zero")


def warp_views(views, disparity, *, offsets=None, border="replicate") -> np.ndarray:
    """``[v, u, h, w, c]`` every view warped to the centre view."""
    v, u = views.shape[:2]
    offsets = view_offsets(v, u) if offsets is None else offsets
    return np.stack(
        [
            np.stack([warp(views[i, j], disparity, offsets[i, j], border=border) for j in range(u)])
            for i in range(v)
        ]
    )


def concatenate(views, weights=None) -> np.ndarray:
    """``[h, w, v * u * c]``, view-major."""
    v, u, h, w, c = views.shape
    plane = np.zeros((h, w, v * u * c))
    for i, j, y, x, k in np.ndindex(*views.shape):
        factor = 1.0 if weights is None else weights[i, j, y, x]
        plane[y, x, (i * u + j) * c + k] = factor * views[i, j, y, x, k]
    return plane


def mean_and_variance(views, weights=None) -> np.ndarray:
    """``[h, w, 2 * c]``: weighted means over the views, then weighted variances."""
    v, u, h, w, c = views.shape
    weights = np.ones((v, u, h, w)) if weights is None else np.asarray(weights, np.float64)
    plane = np.zeros((h, w, 2 * c))
    for y, x, k in np.ndindex(h, w, c):
        total = sum(weights[i, j, y, x] for i, j in np.ndindex(v, u))
        if total == 0.0:
            continue
        mean = sum(weights[i, j, y, x] * float(views[i, j, y, x, k]) for i, j in np.ndindex(v, u))
        mean /= total
        variance = sum(
            weights[i, j, y, x] * (float(views[i, j, y, x, k]) - mean) ** 2
            for i, j in np.ndindex(v, u)
        )
        plane[y, x, k], plane[y, x, c + k] = mean, variance / total
    return plane


def group_correlation(groups: int) -> Callable[..., np.ndarray]:
    """Weighted mean over the views of ``mean_c(f_view * f_centre)`` in each group of channels."""

    def combine(views, weights=None) -> np.ndarray:
        v, u, h, w, c = views.shape
        weights = np.ones((v, u, h, w)) if weights is None else np.asarray(weights, np.float64)
        size = c // groups
        plane = np.zeros((h, w, groups))
        for y, x, group in np.ndindex(h, w, groups):
            total = weights[:, :, y, x].sum()
            if total == 0.0:
                continue
            for i, j in np.ndindex(v, u):
                for k in range(group * size, (group + 1) * size):
                    product = float(views[i, j, y, x, k]) * float(views[v // 2, u // 2, y, x, k])
                    plane[y, x, group] += weights[i, j, y, x] / total * product / size
        return plane

    return combine


def coarse_volume(
    features, candidates, *, weights=None, offsets=None, combine=concatenate
) -> np.ndarray:
    """``[d, h, w, k]`` of constant shifts, zero outside."""
    planes = []
    for candidate in np.asarray(candidates, np.float64):
        constant = np.full(features.shape[2:4], candidate)
        registered = warp_views(features, constant, offsets=offsets, border="zero")
        planes.append(combine(registered, weights))
    return np.stack(planes)


def refined_volume(
    features,
    disparity,
    candidates,
    *,
    weights=None,
    offsets=None,
    combine=concatenate,
    border="replicate",
) -> np.ndarray:
    """``[d, h, w, k]`` of warps by the disparity map plus each candidate."""
    planes = []
    for candidate in np.asarray(candidates, np.float64):
        moved = np.asarray(disparity, np.float64) + candidate
        planes.append(combine(warp_views(features, moved, offsets=offsets, border=border), weights))
    return np.stack(planes)


def occlusion_maps(views, disparity, *, offsets=None, border="replicate") -> np.ndarray:
    """``[v, u, h, w]``: sum over channels of ``|centre - warped|``, at most one."""
    v, u, h, w, _ = views.shape
    warped = warp_views(views, disparity, offsets=offsets, border=border)
    maps = np.zeros((v, u, h, w))
    for i, j, y, x in np.ndindex(v, u, h, w):
        centre = np.asarray(views[v // 2, u // 2, y, x], np.float64)
        maps[i, j, y, x] = min(np.abs(centre - warped[i, j, y, x]).sum(), 1.0)
    return maps


def softmax_of_negative(costs) -> np.ndarray:
    """``[d, h, w]`` ``exp(-c) / sum exp(-c)`` over the first axis."""
    d, h, w = costs.shape
    probabilities = np.zeros((d, h, w))
    for y, x in np.ndindex(h, w):
        exponentials = [
            np.exp(-(float(costs[k, y, x]) - float(costs[:, y, x].min()))) for k in range(d)
        ]
        probabilities[:, y, x] = np.array(exponentials) / sum(exponentials)
    return probabilities


def moments_and_entropy(probabilities, candidates) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean and standard deviation of the candidates, and entropy in nats, each ``[h, w]``."""
    d, h, w = probabilities.shape
    mean, deviation, entropy = np.zeros((3, h, w))
    for y, x in np.ndindex(h, w):
        values = [
            float(candidates[k] if candidates.ndim == 1 else candidates[k, y, x]) for k in range(d)
        ]
        chances = [float(probabilities[k, y, x]) for k in range(d)]
        pairs = list(zip(chances, values, strict=True))
        mean[y, x] = sum(p * value for p, value in pairs)
        deviation[y, x] = np.sqrt(sum(p * (value - mean[y, x]) ** 2 for p, value in pairs))
        entropy[y, x] = -sum(p * np.log(p) for p in chances if p > 0.0)
    return mean, deviation, entropy


def slanted_plane(
    grid: tuple[int, int],
    size: tuple[int, int],
    plane: tuple[float, float, float],
    texture: Callable[[np.ndarray, np.ndarray], np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """Exact views of a textured plane whose disparity is ``a + b * y + c * x`` in the centre view.

    View (v, u) sees at (Y, X) the centre pixel ``(Y + d * dv, X + d * du)``; with the plane's
    equation there, ``d = (a + b * Y + c * X) / (1 - b * dv - c * du)``: no search, no resampling.

    Returns:
        ``[v, u, h, w, 1]`` views of the analytic texture, and ``[h, w]`` disparity.
    """
    a, b, c = plane
    rows, columns = np.meshgrid(np.arange(size[0]), np.arange(size[1]), indexing="ij")
    views = np.zeros((*grid, *size, 1))
    for v, u in np.ndindex(*grid):
        dv, du = v - grid[0] // 2, u - grid[1] // 2
        seen = (a + b * rows + c * columns) / (1.0 - b * dv - c * du)
        views[v, u, ..., 0] = texture(rows + seen * dv, columns + seen * du)
    return views, a + b * rows + c * columns
