"""The bundled sample is consistent with its ground truth."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates, maximum_filter

from occjax.data.bundled_sample import sample


@pytest.fixture(scope="module")
def light_field():
    return sample()


def test_the_sample_is_a_whole_light_field(light_field):
    assert light_field.grid == (9, 9)
    assert light_field.image_size == (256, 256)
    assert light_field.views.dtype == np.uint8
    truth = light_field.ground_truth
    assert np.isfinite(truth).all()
    assert np.ptp(truth) > 2.0
    lowest, highest = light_field.disparity_range
    assert lowest <= truth.min() < lowest + 2e-3
    assert highest - 2e-3 < truth.max() <= highest


def nearest(disparity, v, u):
    """Largest disparity within a pixel of where each point of the centre view lies in a view."""
    found = np.full(disparity.shape, -np.inf)
    for y, x in np.ndindex(disparity.shape):
        row, column = round(y - disparity[y, x] * v), round(x - disparity[y, x] * u)
        if 0 <= row < found.shape[0] and 0 <= column < found.shape[1]:
            found[row, column] = max(found[row, column], disparity[y, x])
    return maximum_filter(found, 3)


@pytest.mark.parametrize("view", [(0, 1), (8, 3)])
def test_views_agree_where_nothing_is_in_front_and_only_there(light_field, view):
    disparity = light_field.ground_truth.astype(np.float64)
    v, u = view[0] - 4, view[1] - 4
    y, x = np.mgrid[:256, :256].astype(np.float64)
    seen_y, seen_x = y - disparity * v, x - disparity * u
    inside = (seen_y >= 0) & (seen_y <= 255) & (seen_x >= 0) & (seen_x <= 255)
    images = light_field.grey()
    error = np.abs(map_coordinates(images[view], [seen_y, seen_x], order=1) - images[4, 4])
    places = np.rint(np.clip([seen_y, seen_x], 0, 255)).astype(int)
    before = nearest(disparity, v, u)[tuple(places)] - disparity
    hidden, visible = inside & (before > 0.3), inside & (before < 0.05)
    assert hidden.mean() > 0.01
    assert visible.mean() > 0.6
    assert np.median(error[visible]) < 0.02
    assert np.median(error[hidden]) > 3 * np.median(error[visible])
