"""NumPy loops for the costs of the aperture's sectors."""

import numpy as np

from tests.reference.matching import bilinear


def sector(offset):
    return round(np.arctan2(offset[0], offset[1]) / (np.pi / 4)) % 8


def inside(image, y, x):
    return 0 <= y <= image.shape[0] - 1 and 0 <= x <= image.shape[1] - 1


def others(offsets):
    """Indices, offset and sector of all views but the centre one."""
    v, u = offsets.shape[:2]
    for index in np.ndindex(v, u):
        if index != (v // 2, u // 2):
            yield index, offsets[index], sector(offsets[index])


def window_mean(image, y, x):
    rows = np.clip([y - 1, y, y + 1], 0, image.shape[0] - 1)
    columns = np.clip([x - 1, x, x + 1], 0, image.shape[1] - 1)
    return image[np.ix_(rows, columns)].mean()


def warped(view, disparity, offset):
    result = np.empty_like(disparity, dtype=float)
    for y, x in np.ndindex(*disparity.shape):
        result[y, x] = bilinear(
            view, *np.clip([y, x] - disparity[y, x] * offset, 0, np.array(view.shape) - 1)
        )
    return result


def visibility(view, centre, disparity, offset, tolerance):
    """Weight of a view at each pixel."""
    squared = np.square(warped(view, disparity, offset) - centre)
    result = np.zeros_like(squared)
    for y, x in np.ndindex(*disparity.shape):
        if inside(view, *([y, x] - disparity[y, x] * offset)):
            result[y, x] = 1 / (1 + window_mean(squared, y, x) / tolerance**2)
    return result


def refined_sector_costs(features, disparities, offsets, tolerance):
    centre = features[features.shape[0] // 2, features.shape[1] // 2]
    sums = np.zeros((8, *disparities.shape))
    weights = np.zeros_like(sums)
    for index, offset, number in others(offsets):
        for k, y, x in np.ndindex(*disparities.shape):
            position = [y, x] - disparities[k, y, x] * offset
            if inside(features[index], *position):
                square = np.square(bilinear(features[index], *position) - centre[y, x])
                sums[number, k, y, x] += (square / (square + np.square(tolerance))).mean()
                weights[number, k, y, x] += 1
    return sums, weights


def sector_steps(views, disparity, offsets, tolerance):
    """Information, push and squares."""
    centre = views[views.shape[0] // 2, views.shape[1] // 2]
    padded = np.pad(centre, 1, mode="edge")
    down = (padded[2:, 1:-1] - padded[:-2, 1:-1]) / 2
    right = (padded[1:-1, 2:] - padded[1:-1, :-2]) / 2
    sums = np.zeros((3, 8, *disparity.shape))
    for index, offset, number in others(offsets):
        visible = visibility(views[index], centre, disparity, offset, tolerance)
        residual = warped(views[index], disparity, offset) - centre
        slope = -(offset[0] * down + offset[1] * right)
        sums[:, number] += visible * np.stack([slope**2, -slope * residual, residual**2])
    return sums / (offsets.shape[0] * offsets.shape[1] - 1)


def sector_channels(sums, weights):
    """Where every sector was seen."""
    sectors = sums / weights
    whole = sums.sum(0) / weights.sum(0)
    halves = []
    for first in range(8):
        part = [(first + k) % 8 for k in range(5)]
        half = sums[part].sum(0) / weights[part].sum(0)
        means = [window_mean(plane, y, x) for plane in half for y, x in np.ndindex(plane.shape)]
        halves.append(np.reshape(means, half.shape))
    return np.concatenate([sectors, whole[None], np.min(halves, 0)[None]])
