import numpy as np
import pytest

from occjax.layout import ORIENTATIONS, ViewOrderConfig, view_brightness
from occjax.layout.consistency import CostVolumes, view_cross
from occjax.layout.filters import box_mean
from occjax.lightfield import LightField, project
from tests.io.scenes import two_planes

CONFIG = ViewOrderConfig()


def sample_replicated(image, y, x):
    """Bilinear value at real positions; the border is replicated."""
    h, w = image.shape
    y, x = np.clip(y, 0, h - 1), np.clip(x, 0, w - 1)
    top, left = np.minimum(y.astype(int), h - 2), np.minimum(x.astype(int), w - 2)
    down, right = y - top, x - left
    upper, lower = (
        image[row, left] * (1 - right) + image[row, left + 1] * right for row in (top, top + 1)
    )
    return upper * (1 - down) + lower * down


def window_mean(image, radius):
    """Mean over a square window, pixel by pixel."""
    h, w = image.shape
    result = np.empty((h, w))
    window = np.arange(-radius, radius + 1)
    for y, x in np.ndindex(h, w):
        result[y, x] = image[
            np.ix_((y + window).clip(0, h - 1), (x + window).clip(0, w - 1))
        ].mean()
    return result


@pytest.mark.parametrize("radius", [0, 1, 3])
def test_box_mean_is_the_mean_of_each_window(radius, tolerance):
    image = np.random.default_rng(0).random((5, 8), np.float32)
    expected = window_mean(image, radius)
    np.testing.assert_allclose(box_mean(image, radius), expected, **tolerance("float32"))


@pytest.mark.parametrize("grid", [(5, 5), (3, 4), (1, 3)])
def test_costs_are_those_of_the_views_in_the_corrected_view_order(grid, tolerance):
    """A view that is at (v, u) view steps after the correction is read at p - d (v, u)."""
    light_field = LightField(two_planes(grid, (24, 20))[0])
    cross = view_cross(light_field, view_brightness(light_field), 256, CONFIG)
    volumes = CostVolumes(cross, 2.0)
    disparity = volumes.candidates[1]
    pixels = np.mgrid[:24, :20].astype(float)

    def high_pass(image):
        return image - window_mean(image, CONFIG.high_pass_radius_px)

    centre = high_pass(cross.centre)
    arms = [(arm, [high_pass(image) for image in arm.images]) for arm in cross.arms]
    for orientation in ORIENTATIONS:
        signs = np.where([orientation.flip_rows, orientation.flip_columns], -1, 1)
        lowest = {}
        for arm, images in arms:
            direction = np.roll([0, 1], arm.on_row == orientation.swap) * signs
            differences = [
                abs(sample_replicated(image, *project(*pixels, disparity, n * direction)) - centre)
                for n, image in zip(arm.offsets, images, strict=True)
            ]
            radius = CONFIG.cost_radii_px[len(images) - 1]
            cost = window_mean(np.mean(differences, axis=0), radius)
            lowest[arm.on_row] = np.minimum(cost, lowest.get(arm.on_row, cost))
        expected = np.mean(list(lowest.values()), axis=0)
        actual = volumes.of(orientation)[1]
        np.testing.assert_allclose(
            actual, expected, **tolerance("float32"), err_msg=orientation.name
        )
