"""Where views lie: sectors of the aperture, and the views next to the centre view."""

import jax.numpy as jnp
import numpy as np
import pytest

from occjax.errors import InputError
from occjax.ops import sector_of
from occjax.ops.aperture import views_around, views_beside


def test_sectors_go_round_from_the_right_over_below():
    around = [(0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1)]
    assert sector_of(jnp.array(around, jnp.float32)).tolist() == list(range(8))


def test_the_other_views_come_row_by_row_with_their_offsets():
    around = views_around((2, 3), None)
    assert around.centre == 4
    assert around.view.tolist() == [0, 1, 2, 3, 5]
    assert around.offset.tolist() == [[-1, -1], [-1, 0], [-1, 1], [0, -1], [0, 1]]
    assert around.numbers.tolist() == [1, 0, 0, 0, 1, 1, 1, 1]


def test_a_view_at_the_place_of_the_centre_view_does_not_count():
    offsets = jnp.array([[0.0, 0.0], [0.0, 0.0], [0.0, 1.0]])[None]
    around = views_around((1, 3), offsets)
    assert around.present.tolist() == [False, True]
    assert float(around.numbers.sum()) == 1.0
    beside, nearest = views_beside(around)
    assert set(beside.tolist()) == {2}
    assert np.all(np.asarray(nearest) == [0.0, 1.0])


@pytest.mark.parametrize(
    ("grid", "expected"),
    [((3, 3), {1, 3, 5, 7}), ((1, 5), {1, 3}), ((2, 2), {1, 2}), ((5, 1), {1, 3}), ((1, 2), {0})],
)
def test_the_nearest_views_are_one_step_away(grid, expected):
    beside, _ = views_beside(views_around(grid, None))
    assert set(beside.tolist()) == expected


def test_the_nearest_views_are_found_wherever_they_stand_in_the_list():
    offsets = jnp.array([[2.0, 2.0], [0.0, 1.1], [0.0, 0.0], [0.0, -1.0], [-1.0, 0.0]])[None]
    beside, nearest = views_beside(views_around((1, 5), offsets))
    assert set(beside.tolist()) == {1, 3, 4}
    np.testing.assert_allclose(nearest, offsets[0][beside])


def test_one_view_or_offsets_of_another_shape_are_refused():
    with pytest.raises(InputError, match="one view has no disparity"):
        views_around((1, 1), None)
    with pytest.raises(InputError, match=r"offsets must be \[1, 3, 2\], not \[3, 2\]"):
        views_around((1, 3), jnp.zeros((3, 2)))
