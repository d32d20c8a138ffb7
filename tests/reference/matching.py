"""NumPy loops for matching costs and semi-global aggregation."""

import numpy as np


def bilinear(image, y, x):
    """One sample at real coordinates, borders replicated."""
    row, column = int(np.floor(y)), int(np.floor(x))
    total = 0.0
    for down in (0, 1):
        for right in (0, 1):
            weight = (1 - abs(y - row - down)) * (1 - abs(x - column - right))
            inside_y = min(max(row + down, 0), image.shape[0] - 1)
            inside_x = min(max(column + right, 0), image.shape[1] - 1)
            total = total + weight * image[inside_y, inside_x]
    return total


def sector_sums(features, candidates, truncation, offsets):
    """Sums of truncated differences over the views of each sector."""
    v, u, height, width, _ = features.shape
    sums = np.zeros((len(candidates), 8, height, width))
    for k, y, x in np.ndindex(len(candidates), height, width):
        for row, column in np.ndindex(v, u):
            down, right = offsets[row, column]
            if down == right == 0:
                continue
            seen = bilinear(
                features[row, column], y - candidates[k] * down, x - candidates[k] * right
            )
            difference = np.abs(seen - features[v // 2, u // 2, y, x])
            sector = round(np.arctan2(down, right) / (np.pi / 4)) % 8
            sums[k, sector, y, x] += np.minimum(difference / truncation, 1).mean()
    return sums


def aperture_costs(features, candidates, truncation, reach):
    """Without averaging over windows; ``reach`` sectors on either side make a part."""
    v, u, height, width, _ = features.shape
    costs = np.empty((len(candidates), height, width))
    for k, y, x in np.ndindex(*costs.shape):
        departures, directions = [], []
        for row, column in np.ndindex(v, u):
            down, right = row - v // 2, column - u // 2
            if down == right == 0:
                continue
            seen = bilinear(
                features[row, column], y - candidates[k] * down, x - candidates[k] * right
            )
            difference = np.abs(seen - features[v // 2, u // 2, y, x])
            departures.append(np.minimum(difference / truncation, 1).mean())
            directions.append(round(np.arctan2(down, right) / (np.pi / 4)) % 8)
        means = [np.mean(departures)]
        for middle in range(8):
            apart = [min((s - middle) % 8, (middle - s) % 8) for s in directions]
            weights = [1.0 if a < reach else 0.5 if a == reach else 0.0 for a in apart]
            if sum(weights) > 0:
                means.append(np.average(departures, weights=weights))
        costs[k, y, x] = min(means)
    return costs


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
