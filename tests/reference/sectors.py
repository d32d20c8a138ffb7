"""NumPy loops for the costs of the aperture's sectors."""

import numpy as np

from tests.reference.filtering import box_filter
from tests.reference.matching import bilinear, other_views


def refined_sector_costs(features, disparities, offsets, penalties):
    """Sum the measures ``penalties(differences [c])`` in each sector, one pixel at a time."""
    height, width = features.shape[2:4]
    centre = features[features.shape[0] // 2, features.shape[1] // 2]
    measures = len(penalties(np.zeros(features.shape[-1])))
    sums = np.zeros((measures, 8, *disparities.shape))
    weights = np.zeros(sums.shape[1:])
    for index, offset, number in other_views(offsets):
        for k, y, x in np.ndindex(*disparities.shape):
            row, column = [y, x] - disparities[k, y, x] * offset
            if 0 <= row <= height - 1 and 0 <= column <= width - 1:
                difference = bilinear(features[index], row, column) - centre[y, x]
                sums[:, number, k, y, x] += penalties(difference)
                weights[number, k, y, x] += 1
    return sums, weights


def sector_means(sums, weights):
    """Return the means of sectors, aperture and best half, if every sector has a view."""
    halves = []
    for first in range(8):
        part = [(first + k) % 8 for k in range(5)]
        half = sums[part].sum(0) / weights[part].sum(0)
        halves.append([box_filter(plane, 1) for plane in half])
    return sums / weights, sums.sum(0) / weights.sum(0), np.min(halves, 0)
