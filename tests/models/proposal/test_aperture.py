"""Sectors of the aperture and nearest views."""

import jax.numpy as jnp
import numpy as np
import pytest

from occjax.errors import InputError
from occjax.models.proposal.aperture import nearest_views, other_views, sector_of, sum_over_views


def test_sectors_count_from_right_to_below():
    around = [(0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1)]
    assert sector_of(jnp.array(around, jnp.float32)).tolist() == list(range(8))


def test_other_views_are_listed_row_by_row_with_their_offsets():
    others = other_views((2, 3), None)
    assert others.centre == 4
    assert others.indices.tolist() == [0, 1, 2, 3, 5]
    assert others.offset.tolist() == [[-1, -1], [-1, 0], [-1, 1], [0, -1], [0, 1]]
    assert others.sector_counts.tolist() == [1, 0, 0, 0, 1, 1, 1, 1]


def test_views_can_be_ordered_by_their_sector():
    ordered = other_views((3, 4), None).by_sector()  # around the view of index 6
    assert ordered.centre == 6
    assert ordered.indices.tolist() == [7, 11, 10, 8, 9, 4, 5, 0, 1, 2, 3]
    assert ordered.sector.tolist() == [0, 1, 2, 3, 3, 4, 4, 5, 5, 6, 7]
    assert sector_of(ordered.offset).tolist() == [0, 1, 2, 3, 3, 4, 4, 5, 5, 6, 7]


def test_views_are_summed_by_sector_or_all_together():
    sectors, values = [0, 1, 2, 3, 3, 4, 4, 5, 5, 7, 7], np.arange(1.0, 12.0, dtype=np.float32)
    views, zero = jnp.asarray(values), (jnp.zeros(2), jnp.zeros(()))

    def term(view):
        return jnp.stack([view, 2 * view]), view * view

    doubled, squares = sum_over_views(term, views, zero, jnp.array(sectors))
    of_each = [[v for v, s in zip(values, sectors, strict=True) if s == k] for k in range(8)]
    assert doubled.tolist() == [[sum(each), 2 * sum(each)] for each in of_each]
    assert squares.tolist() == [sum(v * v for v in each) for each in of_each]
    doubled, squares = sum_over_views(term, views, zero, None)
    assert (doubled.tolist(), squares.tolist()) == ([[66.0, 132.0]], [506.0])


def test_view_at_the_position_of_the_centre_view_is_ignored():
    offsets = jnp.array([[0.0, 0.0], [0.0, 0.0], [0.0, 1.0]])[None]
    others = other_views((1, 3), offsets)
    assert others.present.tolist() == [False, True]
    assert float(others.sector_counts.sum()) == 1.0
    indices, nearest = nearest_views(others)
    assert set(indices.tolist()) == {2}
    assert np.all(np.asarray(nearest) == [0.0, 1.0])


IRREGULAR = jnp.array([[2.0, 2.0], [0.0, 1.1], [0.0, 0.0], [0.0, -1.0], [-1.0, 0.0]])[None]


@pytest.mark.parametrize(
    ("grid", "offsets", "expected"),
    [
        ((3, 3), None, {1, 3, 5, 7}),
        ((1, 5), None, {1, 3}),
        ((2, 2), None, {1, 2}),
        ((1, 2), None, {0}),
        ((1, 5), IRREGULAR, {1, 3, 4}),
    ],
)
def test_nearest_views_are_about_one_step_away(grid, offsets, expected):
    indices, _ = nearest_views(other_views(grid, offsets))
    assert set(indices.tolist()) == expected


def test_single_view_and_offsets_of_another_shape_are_refused():
    with pytest.raises(InputError, match="one view has no disparity"):
        other_views((1, 1), None)
    with pytest.raises(InputError, match=r"offsets must be \[1, 3, 2\], not \[3, 2\]"):
        other_views((1, 3), jnp.zeros((3, 2)))
