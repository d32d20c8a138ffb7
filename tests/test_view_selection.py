"""Which views a selection takes, by their offsets."""

import numpy as np
import pytest

from occjax.errors import InputError
from occjax.lightfield import centre_index, view_offsets
from occjax.view_selection import select_from_grid, select_view_indices


def selected(offsets, selection):
    """Offsets of the selected views; the centre view is in the centre of their array."""
    found = offsets[select_from_grid(offsets, selection)]
    np.testing.assert_array_equal(found[centre_index(found.shape[:2])], 0)
    return found


def places(offsets):
    """Offsets as a set."""
    return {tuple(place) for place in offsets.reshape(-1, 2).astype(int).tolist()}


@pytest.mark.parametrize("size", [(9, 9), (3, 7), (4, 4)])
def test_a_star_is_row_column_and_diagonals_of_the_centre_view(size):
    found = selected(view_offsets(*size), "star")
    rows, columns = (range(-(count // 2), count - count // 2) for count in size)
    expected = {(r, c) for r in rows for c in columns if r == 0 or c in (0, r, -r)}
    assert places(found) == expected
    assert found.shape == (1, len(expected), 2)


def test_a_cross_is_the_row_and_the_column_of_the_centre_view():
    expected = {(0, i) for i in range(-3, 4)} | {(i, 0) for i in range(-2, 3)}
    assert places(selected(view_offsets(5, 7), "cross")) == expected


@pytest.mark.parametrize(
    ("size", "expected"), [((1, 9), {-4, -3, 0, 3, 4}), ((1, 4), {-2, -1, 0, 1}), ((1, 2), {-1, 0})]
)
def test_the_outer_star_of_a_row_has_two_views_on_each_side(size, expected):
    found = selected(view_offsets(*size), "outer_star")
    assert places(found) == {(0, column) for column in expected}


def test_the_outer_star_has_the_two_outermost_views_in_each_direction():
    star = selected(view_offsets(9, 9), "star")
    expected = {place for place in places(star) if max(map(abs, place)) in (0, 3, 4)}
    assert places(selected(view_offsets(9, 9), "outer_star")) == expected
    assert places(selected(star, "outer_star")) == expected
    # In 3x7 views a diagonal has one view on each side, the row three.
    diagonals = {(row, column) for row in (-1, 1) for column in (-1, 0, 1)}
    row = {(0, column) for column in (-3, -2, 0, 2, 3)}
    assert places(selected(view_offsets(3, 7), "outer_star")) == diagonals | row


@pytest.mark.parametrize("inner", [(3, 3), (1, 9), (9, 1), (4, 2)])
def test_a_smaller_grid_is_around_the_centre_view(inner):
    np.testing.assert_array_equal(selected(view_offsets(9, 9), inner), view_offsets(*inner))


def test_all_views_keep_their_places():
    np.testing.assert_array_equal(selected(view_offsets(4, 5), "all"), view_offsets(4, 5))


@pytest.mark.parametrize(
    ("selection", "expected"),
    [
        ("cross", places(selected(view_offsets(5, 5), "cross"))),
        ((3, 3), places(view_offsets(3, 3))),
        ((1, 5), places(view_offsets(1, 5))),
    ],
)
def test_a_list_is_selected_from_by_its_offsets_in_any_order(selection, expected):
    star = selected(view_offsets(5, 5), "star")
    shuffled = np.random.default_rng(0).permutation(star, axis=1)
    for views in (star, shuffled + 0.2):
        found = np.rint(views[select_from_grid(views, selection)] - 0.2 * (views is not star))
        assert found.shape[0] == 1
        assert places(found) == expected


def test_irregular_positions_of_a_grid_do_not_matter():
    positions = view_offsets(3, 3) * 1.7
    rows, columns = select_from_grid(positions, "cross")
    assert list(zip(rows[0], columns[0], strict=True)) == [(0, 1), (1, 0), (1, 1), (1, 2), (2, 1)]


@pytest.mark.parametrize("selection", ["ring", (0, 3), (3, 3, 3), (7, 3)])
@pytest.mark.usefixtures("unchecked")
def test_impossible_selections_are_refused(selection):
    for offsets in (view_offsets(5, 5), selected(view_offsets(5, 5), "star")):
        with pytest.raises(InputError):
            select_from_grid(offsets, selection)


def test_missing_views_are_named():
    outer = selected(view_offsets(9, 9), "outer_star")
    with pytest.raises(InputError, match="has 1 of the 3x3 views"):
        select_from_grid(outer, (3, 3))
    with pytest.raises(InputError, match="0 views have the offset"):
        select_view_indices(outer[0] + 10.0, "cross")
