"""Which views a selection takes, by their offsets."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.data.samples import Sample
from occjax.data.views import select_views
from occjax.errors import InputError


def grid(v, u, lead=(), library=jnp):
    """A sample in which every pixel of a view is the view's own offset, 100 row + column."""
    row, column = np.meshgrid(np.arange(v) - v // 2, np.arange(u) - u // 2, indexing="ij")
    offsets = np.stack([row, column], axis=-1).astype(np.float32)
    images = np.tile((100.0 * row + column)[..., None, None], (2, 3)).astype(np.float32)
    parts = (images, offsets, np.zeros((2, 3), np.float32), images > 0, np.ones((2, 3), bool))
    return Sample(*(library.asarray(np.broadcast_to(part, (*lead, *part.shape))) for part in parts))


def places(sample):
    """Offsets of the views of one sample, after checking that the other fields agree with them."""
    assert sample.views.shape == sample.visibility.shape
    assert sample.views.shape[:2] == sample.offsets.shape[:2]
    offsets = np.asarray(sample.offsets)
    np.testing.assert_array_equal(sample.views[..., 0, 0], 100 * offsets[..., 0] + offsets[..., 1])
    np.testing.assert_array_equal(sample.visibility, np.asarray(sample.views) > 0)
    v, u = offsets.shape[:2]
    np.testing.assert_array_equal(offsets[v // 2, u // 2], 0)
    return {tuple(place) for place in offsets.reshape(-1, 2).astype(int).tolist()}


@pytest.mark.parametrize("size", [(9, 9), (5, 5), (3, 7), (4, 4), (17, 17)])
def test_a_star_is_row_column_and_diagonals_of_the_centre_view(size):
    selected = select_views(grid(*size), "star")
    expected = {
        (row - size[0] // 2, column - size[1] // 2)
        for row in range(size[0])
        for column in range(size[1])
        if (row - size[0] // 2) in (0, column - size[1] // 2, size[1] // 2 - column)
        or column == size[1] // 2
    }
    assert places(selected) == expected
    assert selected.views.shape[:2] == (1, len(expected))


def test_the_star_of_nine_by_nine_views_has_the_published_number_of_views():
    assert select_views(grid(9, 9), "star").views.shape[:2] == (1, 33)


@pytest.mark.parametrize(
    ("size", "expected"),
    [
        ((1, 9), {-4, -3, 3, 4}),
        ((1, 4), {-2, -1, 1}),
        ((1, 2), {-1}),
    ],
)
def test_of_a_row_the_outer_star_has_two_views_on_each_side(size, expected):
    found = places(select_views(grid(*size), "outer_star"))
    assert found == {(0, 0)} | {(0, column) for column in expected}


def test_the_outer_star_is_the_two_outermost_rings_of_the_star():
    found = places(select_views(grid(7, 7), "outer_star"))
    star = places(select_views(grid(7, 7), "star"))
    assert found == {place for place in star if max(map(abs, place)) != 1}
    of_a_list = select_views(select_views(grid(7, 7), "star"), "outer_star")
    assert places(of_a_list) == found


def test_arms_of_different_length_end_where_they_end():
    """In 3x7 views a diagonal has one view on each side, the row three."""
    found = places(select_views(grid(3, 7), "outer_star"))
    diagonals = {(row, column) for row in (-1, 1) for column in (-1, 0, 1)}
    assert found == {(0, 0)} | diagonals | {(0, column) for column in (-3, -2, 2, 3)}


def test_a_cross_is_the_row_and_the_column_of_the_centre_view():
    expected = {(0, i) for i in range(-3, 4)} | {(i, 0) for i in range(-2, 3)}
    assert places(select_views(grid(5, 7), "cross")) == expected


@pytest.mark.parametrize("inner", [(3, 3), (1, 9), (9, 1), (4, 2)])
def test_a_smaller_grid_is_around_the_centre_view(inner):
    selected = select_views(grid(9, 9), inner)
    assert selected.views.shape[:2] == inner
    rows, columns = (range(-(count // 2), count - count // 2) for count in inner)
    assert places(selected) == {(row, column) for row in rows for column in columns}


def test_all_views_stay_as_they_are():
    sample = grid(4, 5)
    assert select_views(sample, "all") is sample


@pytest.mark.parametrize(
    ("selection", "expected"),
    [
        ("cross", {(0, i) for i in range(-2, 3)} | {(i, 0) for i in range(-2, 3)}),
        ((3, 3), {(i, j) for i in range(-1, 2) for j in range(-1, 2)}),
        ((1, 5), {(0, i) for i in range(-2, 3)}),
    ],
)
def test_a_star_has_smaller_selections_in_it(selection, expected):
    selected = select_views(select_views(grid(5, 5), "star"), selection)
    assert selected.views.shape[0] == 1
    assert places(selected) == expected


@pytest.mark.parametrize("selection", [(3, 3), (5, 5), (9, 9)])
def test_a_list_without_the_views_that_are_asked_for_is_refused(selection):
    outer = select_views(grid(9, 9), "outer_star")
    with pytest.raises(InputError, match=f"of the {selection[0]}x{selection[1]} views"):
        select_views(outer, selection)


def test_views_of_a_list_are_found_in_whatever_order_each_sample_has_them():
    star = select_views(grid(5, 5), "star")
    order = np.arange(17)
    order[[1, 14]], order[[3, 5]] = order[[14, 1]], order[[5, 3]]
    shuffled = star._replace(
        views=star.views[:, order],
        offsets=star.offsets[:, order],
        visibility=star.visibility[:, order],
    )
    batch = jax.tree.map(lambda *parts: jnp.stack(parts), star, shuffled)
    selected = select_views(batch, "cross")
    for number in range(2):
        one = jax.tree.map(lambda values, number=number: values[number], selected)
        np.testing.assert_array_equal(one.offsets, select_views(star, "cross").offsets)
        assert len(places(one)) == 9


@pytest.mark.parametrize("selection", ["star", "cross", (3, 1)])
def test_a_batch_is_selected_as_its_samples_are(selection):
    batch = select_views(grid(5, 3, lead=(2,)), selection)
    for number in range(2):
        one = jax.tree.map(lambda values, number=number: values[number], batch)
        jax.tree.map(np.testing.assert_array_equal, one, select_views(grid(5, 3), selection))


def test_numpy_samples_stay_numpy():
    for sample in (grid(5, 5, library=np), select_views(grid(5, 5, library=np), "star")):
        selected = select_views(sample, "cross")
        assert all(isinstance(field, np.ndarray) for field in selected)


def test_a_grid_can_be_selected_from_inside_jit_but_not_a_list():
    selected = jax.jit(lambda sample: select_views(sample, "star"))(grid(3, 3))
    assert len(places(selected)) == 9
    with pytest.raises(InputError, match="jit"):
        jax.jit(lambda sample: select_views(sample, "cross"))(selected)


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("selection", ["ring", (0, 3), (3, 3, 3), (7, 3)])
@pytest.mark.parametrize("as_list", [False, True])
def test_impossible_selections_are_refused(selection, as_list):
    sample = grid(5, 5)
    with pytest.raises(InputError):
        select_views(select_views(sample, "star") if as_list else sample, selection)


def test_a_list_without_its_centre_view_is_refused():
    sample = select_views(grid(3, 3), "star")
    with pytest.raises(InputError, match="centre"):
        select_views(sample._replace(offsets=sample.offsets + 10.0), "cross")
