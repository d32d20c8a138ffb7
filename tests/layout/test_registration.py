"""Spacing, shifts and camera positions of views, measured on scenes with closed-form truth."""

import dataclasses

import numpy as np
import pytest

from occjax.layout import check, registered
from occjax.layout.registration import Registration
from occjax.lightfield import LightField, view_offsets
from tests.io.scenes import two_planes

PLACES = view_offsets(5, 5)


def proportional(shifts):
    """Return shifts without the part that is the same as a constant added to the disparity."""
    return shifts - np.sum(shifts * PLACES) / np.sum(PLACES**2) * PLACES


def test_a_regular_grid_is_left_as_it_is():
    light_field = LightField(two_planes()[0])
    result, notes = registered(light_field)
    assert result.views is light_field.views
    assert result.positions is None
    assert notes == ()


@pytest.mark.parametrize("ratio", [0.5, 2.0])
def test_a_different_spacing_of_columns_is_measured(ratio):
    views, _ = two_planes(positions=PLACES * [1.0, ratio])
    result, (note,) = registered(LightField(views))
    np.testing.assert_allclose(result.positions, PLACES * [1.0, ratio], atol=0.02 * 2 * ratio)
    assert "times as far apart as the view rows, measured" in note
    low, high = result.view_order_report.declared_range
    assert -1.5 <= low < -1.0
    assert 1.5 < high <= 2.0


def test_declared_positions_are_obeyed():
    light_field = LightField(two_planes(positions=PLACES * [1.0, 2.0])[0], positions=PLACES)
    result, (note,) = registered(light_field)
    assert result.positions is PLACES
    assert "the view columns are 2 times as far apart as declared" in note


def test_random_shifts_of_all_views_are_undone():
    shifts = np.random.default_rng(3).uniform(-1.0, 1.0, PLACES.shape)
    shifts[2, 2] = 0.0
    light_field = LightField(two_planes(shifts=shifts)[0])
    report = check(light_field)
    found = report.registration.shifts
    assert not found[2, 2].any()
    assert np.abs(proportional(found) - proportional(shifts)).max() < 0.1
    assert not report.clearly_worse
    result, (note,) = registered(dataclasses.replace(light_field, view_order_report=report))
    assert "shifted against the grid by up to" in note
    inner = np.s_[:, :, 8:-8, 8:-8]
    exact = two_planes(shifts=shifts - found)[0][inner]
    before = np.abs(light_field.views[inner] - exact).mean()
    assert np.abs(result.views[inner] - exact).mean() < 0.3 * before


def test_one_shifted_view_is_named_and_does_not_flip_the_grid():
    shifts = np.zeros_like(PLACES)
    shifts[2, 3] = 3.0, -3.0
    report = check(LightField(two_planes(shifts=shifts)[0]))
    assert report.best.name == "as declared"
    np.testing.assert_allclose(report.registration.shifts, shifts, atol=0.1)


@pytest.mark.parametrize("blank_middle", [False, True])
def test_a_shifted_view_of_large_images_is_found(blank_middle):
    """The middle half of large images is measured first; here it is textured, or says nothing."""
    shifts = np.zeros((3, 3, 2))
    shifts[1, 2] = 0.4, -0.4
    views, _ = two_planes((3, 3), (144, 144), shifts=shifts)
    if blank_middle:
        for v, u in np.ndindex(3, 3):  # the square, which is the middle half of the centre view
            y, x = np.indices((144, 144)) - shifts[v, u][:, None, None] - 72
            square = (abs(y + 1.5 * (v - 1)) < 36) & (abs(x + 1.5 * (u - 1)) < 36)
            views[v, u][square] = 0.5
    report = check(LightField(views))
    np.testing.assert_allclose(report.registration.shifts[1, 2], shifts[1, 2], atol=0.15)


def test_two_swapped_views_get_the_positions_of_each_other():
    views = two_planes()[0]
    views[2, [3, 4]] = views[2, [4, 3]]
    result, (note,) = registered(LightField(views))
    assert "views (2, 3), (2, 4) are taken from other places" in note
    expected = PLACES.copy()
    expected[2, [3, 4]] = expected[2, [4, 3]]
    np.testing.assert_allclose(result.positions, expected, atol=0.1)


def test_views_that_cannot_be_used_are_not_measured():
    shifts = np.zeros_like(PLACES)
    shifts[0, 0] = shifts[4, 1] = 1.0, 1.0
    usable = np.ones((5, 5), bool)
    usable[0, 0] = False
    report = check(LightField(two_planes(shifts=shifts)[0], usable=usable))
    np.testing.assert_array_equal(np.argwhere(report.registration.shifts.any(-1)), [[4, 1]])


def test_corrections_are_made_once():
    shifts = np.zeros_like(PLACES)
    shifts[1, 1] = 1.0, 1.0
    once, notes = registered(LightField(two_planes(shifts=shifts)[0]))
    again, none = registered(once)
    assert len(notes) == 1
    assert none == ()
    assert again.views is once.views


def test_corrections_around_another_view_leave_it_in_place():
    shifts = np.zeros((1, 3, 2), np.float32)
    shifts[0, 0] = (0.5, -1.0)
    moved = np.array([[False, True, False]])
    around = Registration(1.0, None, shifts, moved).around((0, 0))
    assert around.shifts[0].tolist() == [[0, 0], [0, 0], [0, 0], [-0.5, 1.0], [-0.5, 1.0]]
    assert around.moved.tolist() == [[False, False, False, True, False]]
