"""NumPy loops for matching costs and semi-global aggregation."""

import numpy as np

from tests.reference.filtering import box_filter


def bilinear(image, y, x):
    """Read one sample at real coordinates, borders replicated."""
    row, column = int(np.floor(y)), int(np.floor(x))
    total = 0.0
    for down in (0, 1):
        for right in (0, 1):
            weight = (1 - abs(y - row - down)) * (1 - abs(x - column - right))
            inside_y = min(max(row + down, 0), image.shape[0] - 1)
            inside_x = min(max(column + right, 0), image.shape[1] - 1)
            total = total + weight * image[inside_y, inside_x]
    return total


def sector(offset):
    """Return the sector of a view: its direction in steps of 45 degrees."""
    return round(np.arctan2(offset[0], offset[1]) / (np.pi / 4)) % 8


def other_views(offsets):
    """Yield index, offset and sector of all views but the centre view."""
    v, u = offsets.shape[:2]
    for index in np.ndindex(v, u):
        if index != (v // 2, u // 2):
            yield index, offsets[index], sector(offsets[index])


def sector_sums(features, candidates, truncation, offsets):
    """Sum truncated differences over the views of each sector, and count these views."""
    v, u, height, width, _ = features.shape
    sums, counts = np.zeros((len(candidates), 8, height, width)), np.zeros(8)
    for index, (down, right), number in other_views(offsets):
        counts[number] += 1
        for k, y, x in np.ndindex(len(candidates), height, width):
            seen = bilinear(features[index], y - candidates[k] * down, x - candidates[k] * right)
            difference = np.abs(seen - features[v // 2, u // 2, y, x])
            sums[k, number, y, x] += np.minimum(difference / truncation, 1).mean()
    return sums, counts


def aperture_costs(features, candidates, truncation, offsets, radius=0):
    """Compute the least of the mean costs over the aperture and over its eight quarters."""
    sums, counts = sector_sums(features, candidates, truncation, offsets)
    sums = np.array([[box_filter(image, radius) for image in volume] for volume in sums])
    parts = [np.ones(8)]
    for middle in range(8):
        quarter = np.zeros(8)
        quarter[[middle, middle - 1, (middle + 1) % 8]] = 1.0, 0.5, 0.5
        parts.append(quarter)
    means = [
        np.tensordot(part, sums, (0, 1)) / (part @ counts) for part in parts if part @ counts > 0
    ]
    return np.min(means, axis=0)


def semi_global(costs, guide, small_penalty, large_penalty, guide_scale):
    """Aggregate costs along eight paths, one pixel at a time."""
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
