"""NumPy loops for the edge-aware filters: one pixel at a time, straight from the papers."""

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


def guided_filter(image, guide, radius, epsilon):
    slope, intercept = np.empty_like(image), np.empty_like(image)
    for y, x in np.ndindex(*image.shape):
        g, p = _window(guide, y, x, radius), _window(image, y, x, radius)
        slope[y, x] = np.mean((g - g.mean()) * (p - p.mean())) / (g.var() + epsilon)
        intercept[y, x] = p.mean() - slope[y, x] * g.mean()
    return box_filter(slope, radius) * guide + box_filter(intercept, radius)


def semi_global(costs, guide, small_penalty, large_penalty, guide_scale):
    candidates, height, width = costs.shape
    total = np.zeros_like(costs)
    for dy, dx in [(0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1)]:
        path = np.zeros_like(costs)
        for y in range(height)[:: dy or 1]:
            for x in range(width)[:: dx or 1]:
                path[:, y, x] = costs[:, y, x]
                if not (0 <= y - dy < height and 0 <= x - dx < width):
                    continue
                before = path[:, y - dy, x - dx]
                edge = abs(guide[y, x] - guide[y - dy, x - dx])
                jump = max(small_penalty, large_penalty * np.exp(-edge / guide_scale))
                for k in range(candidates):
                    arrivals = [before[k], before.min() + jump]
                    arrivals += [before[k - 1] + small_penalty] if k > 0 else []
                    arrivals += [before[k + 1] + small_penalty] if k + 1 < candidates else []
                    path[k, y, x] += min(arrivals) - before.min()
        total += path
    return total / 8
