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


def refined_sector_costs(features, disparities, offsets, penalties):
    """``penalties`` of the differences ``[c]`` at one pixel, a list of measures."""
    centre = features[features.shape[0] // 2, features.shape[1] // 2]
    measures = len(penalties(np.zeros(features.shape[-1])))
    sums = np.zeros((measures, 8, *disparities.shape))
    weights = np.zeros(sums.shape[1:])
    for index, offset, number in others(offsets):
        for k, y, x in np.ndindex(*disparities.shape):
            position = [y, x] - disparities[k, y, x] * offset
            if inside(features[index], *position):
                difference = bilinear(features[index], *position) - centre[y, x]
                sums[:, number, k, y, x] += penalties(difference)
                weights[number, k, y, x] += 1
    return sums, weights


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
