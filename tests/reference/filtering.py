"""NumPy loops for filters, one pixel at a time.

``edge_aware_mean`` and ``fit_planes`` use the neighbourhoods of the domain transform (Gastal and
Oliveira, 2011), with half of the radius in each pass.
"""

import itertools

import numpy as np


def _window(image, y, x, radius):
    rows = np.clip(np.arange(y - radius, y + radius + 1), 0, image.shape[0] - 1)
    columns = np.clip(np.arange(x - radius, x + radius + 1), 0, image.shape[1] - 1)
    return image[np.ix_(rows, columns)]


def box_filter(image, radius):
    result = np.empty_like(image)
    for y, x in np.ndindex(*image.shape):
        result[y, x] = _window(image, y, x, radius).mean()
    return result


def neighbourhoods(guides, radius, passes):
    """Return ``[N, N]`` weights of all N pixels; row i is the neighbourhood of pixel i."""
    height, width = guides.shape[1:]
    pixels = [(y, x) for y in range(height) for x in range(width)]

    def distance(p, q):
        return 1 / radius + np.abs(guides[(slice(None), *p)] - guides[(slice(None), *q)]).sum()

    def kernel(axis, sharpness):
        matrix = np.zeros((len(pixels), len(pixels)))
        for i, p in enumerate(pixels):
            for j, q in enumerate(pixels):
                if p[1 - axis] != q[1 - axis]:
                    continue
                low, high = sorted([p, q])
                path = [
                    tuple(low[a] + (k if a == axis else 0) for a in range(2))
                    for k in range(high[axis] - low[axis] + 1)
                ]
                length = sum(distance(*ends) for ends in itertools.pairwise(path))
                matrix[i, j] = np.exp(-np.sqrt(2) * sharpness * length)
        return matrix

    neighbourhood = np.eye(len(pixels))
    for k in range(passes):
        neighbourhood = kernel(1, 2**k) @ kernel(0, 2**k) @ neighbourhood
    return neighbourhood


def edge_aware_mean(values, guides, radius, passes):
    """Compute the means over the neighbourhoods."""
    weights = neighbourhoods(guides, radius, passes)
    weights = weights / weights.sum(1, keepdims=True)
    return np.stack([(weights @ value.ravel()).reshape(value.shape) for value in values])


def fit_planes(values, weights, guides, radius, ridge, passes):
    """Solve the weighted least squares problem of each pixel."""
    height, width = values.shape
    pixels = [(y, x) for y in range(height) for x in range(width)]
    neighbourhood = neighbourhoods(guides, radius, passes)
    result = np.empty(len(pixels))
    for i, (y, x) in enumerate(pixels):
        weight = neighbourhood[i] * weights.ravel()
        weight = weight / weight.sum()
        position = np.array(pixels)[:, ::-1] / 64.0
        centred = position - weight @ position
        mean = weight @ values.ravel()
        moments = centred.T @ (weight[:, None] * centred) + ridge * np.eye(2)
        slope = np.linalg.solve(moments, centred.T @ (weight * (values.ravel() - mean)))
        result[i] = mean + slope @ (np.array([x, y]) / 64.0 - weight @ position)
    return result.reshape(height, width)
