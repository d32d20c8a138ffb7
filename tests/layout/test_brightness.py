"""Gains of the views, views that are too dark, and what is estimated from the others."""

import dataclasses

import numpy as np
import pytest

from occjax.layout import check, view_brightness
from occjax.lightfield import LightField
from tests.io.scenes import two_planes


@pytest.fixture(scope="module")
def scene():
    """5x5 views of two planes of disparity -1 and 1.5, no brighter than 0.75."""
    views, disparity = two_planes(size=(96, 96))
    return LightField(0.75 * views, ground_truth=disparity)


def dimmed(scene, gain):
    """Return the scene in 8 bits, times a gain ``[V, U]`` or ``[V, U, H, W]``."""
    gain = gain.reshape(*gain.shape, *[1] * (5 - gain.ndim))
    views = np.round(255 * np.clip(scene.views * gain, 0, 1)).astype(np.uint8)
    return dataclasses.replace(scene, views=views)


@pytest.fixture(scope="module")
def gain():
    gain = np.random.default_rng(0).uniform(0.7, 1.3, (5, 5))
    gain[2, 2] = 1.0
    return gain


def test_equal_views_are_left_exactly_as_they_are(scene):
    brightness = view_brightness(scene)
    assert brightness.usable.all()
    assert not brightness.notes
    np.testing.assert_array_equal(brightness.grey(scene, 0, 1), scene.grey()[0, 1])


def test_gains_are_measured_and_divided_out(scene, gain):
    light_field = dimmed(scene, gain)
    brightness = view_brightness(light_field)
    np.testing.assert_allclose(brightness.gain, gain, atol=0.03)
    assert "equalised" in brightness.notes[0]
    equalised = brightness.grey(light_field, 1, 3)
    np.testing.assert_allclose(equalised, scene.grey()[1, 3], atol=0.03)


def test_gains_are_more_exact_where_the_disparity_is_known(scene, gain):
    light_field = dimmed(scene, gain)
    without = np.abs(view_brightness(light_field).gain - gain).max()
    brightness = view_brightness(light_field, disparity=scene.ground_truth)
    np.testing.assert_allclose(brightness.gain, gain, atol=0.003)
    assert without > 0.006
    np.testing.assert_allclose(check(light_field).brightness.gain, gain, atol=0.006)


def test_fall_off_within_a_view_is_measured(scene):
    y, x = np.mgrid[-1:1:96j, -1:1:96j]
    v, u = np.indices((5, 5))[..., None, None] - 2
    gain = np.exp(-0.15 * (v * y + u * x + 0.5 * (v**2 + u**2) / 2))
    light_field = dimmed(scene, gain * np.ones((5, 5, 96, 96)))
    brightness = view_brightness(light_field)
    assert brightness.usable.all()
    error = np.abs(brightness.grey(light_field, 0, 0) - scene.grey()[0, 0])
    assert np.median(error) < 0.01
    assert error.max() < 0.05


def test_black_and_half_black_views_are_not_usable(scene):
    gain = np.ones((5, 5, 96, 96))
    gain[0, 0], gain[4, 2, :, :40] = 0, 0.02
    light_field = dimmed(scene, gain)
    brightness = view_brightness(light_field)
    assert np.argwhere(~brightness.usable).tolist() == [[0, 0], [4, 2]]
    assert brightness.notes == (
        "2 of 25 views are too dark to be compared with the centre view and were not used",
    )


def test_a_black_centre_view_says_nothing_of_the_others(scene):
    views = scene.views.copy()
    views[2, 2] = 0
    assert view_brightness(LightField(views)).usable.all()


def test_range_and_view_order_do_not_depend_on_the_brightness(scene, gain):
    expected = check(scene)
    gain = gain.copy()
    gain[:, 0] = gain[0] = 0.0  # the outermost views above and on the left are black
    report = check(dimmed(scene, gain))
    assert report.conclusive
    assert report.best == expected.best
    np.testing.assert_allclose(report.disparity_range, expected.disparity_range, atol=0.5)
    assert report.brightness.usable.sum() == 16


def test_brightness_around_another_view_is_relative_to_it():
    image = np.random.default_rng(0).uniform(100, 200, (24, 24, 1))
    factors = np.array([[1.0, 0.5, 0.8]])
    views = (factors[..., None, None, None] * image).astype(np.uint8)
    around = view_brightness(LightField(views)).around((0, 0))
    np.testing.assert_allclose(around.gain[0, 2:], factors[0] / factors[0, 0], atol=0.01)
    assert around.usable.tolist() == [[False, False, True, True, True]]
