import itertools

import numpy as np
import pytest

from occjax.errors import InputError
from occjax.layout.orientation import ORIENTATIONS, Orientation, declared_orientation
from occjax.lightfield import LightField


@pytest.fixture
def light_field():
    """3x5 views with grey value 10 v + u, and the positions of a regular grid."""
    v, u = np.mgrid[:3, :5]
    views = np.broadcast_to((10 * v + u)[:, :, None, None, None], (3, 5, 2, 2, 1)).astype(np.uint8)
    positions = np.stack([v - 1, u - 2], axis=-1).astype(np.float32)
    truth, usable = np.zeros((2, 2), np.float32), views[:, :, 0, 0, 0] < 20
    return LightField(views, positions=positions, usable=usable, ground_truth=truth)


def labels(light_field):
    return light_field.views[:, :, 0, 0, 0]


def test_the_eight_orientations_have_different_names():
    assert len({orientation.name for orientation in ORIENTATIONS}) == 8
    assert ORIENTATIONS[0].name == "as declared"


def test_swapping_makes_the_first_index_the_column(light_field):
    swapped = Orientation(swap=True).apply(light_field)
    assert labels(swapped)[4, 2] == 24
    assert swapped.grid == (5, 3)


def test_flips_are_applied_after_the_swap(light_field):
    laid_out = Orientation(swap=True, flip_rows=True).apply(light_field)
    assert labels(laid_out)[0].tolist() == [4, 14, 24]


@pytest.mark.parametrize(("first", "second"), list(itertools.product(ORIENTATIONS, repeat=2)))
def test_two_orientations_combine_into_one(light_field, first, second):
    one_by_one = second.apply(first.apply(light_field))
    at_once = first.then(second).apply(light_field)
    np.testing.assert_array_equal(labels(at_once), labels(one_by_one))
    np.testing.assert_array_equal(at_once.positions, one_by_one.positions)
    np.testing.assert_array_equal(at_once.usable, labels(at_once) < 20)


@pytest.mark.parametrize("orientation", ORIENTATIONS, ids=lambda orientation: orientation.name)
def test_positions_follow_the_views(light_field, orientation):
    laid_out = orientation.apply(light_field)
    rows, columns = laid_out.grid
    v, u = np.mgrid[:rows, :columns]
    expected = np.stack([v - rows // 2, u - columns // 2], axis=-1)
    np.testing.assert_array_equal(laid_out.positions, expected)


def test_ground_truth_is_dropped_if_another_view_becomes_the_centre():
    even = LightField(np.zeros((2, 3, 4, 4, 1)), ground_truth=np.zeros((4, 4), np.float32))
    assert Orientation(flip_rows=True).apply(even).ground_truth is None
    assert Orientation(flip_columns=True).apply(even).ground_truth is not None


@pytest.mark.parametrize("orientation", ORIENTATIONS, ids=lambda orientation: orientation.name)
def test_order_and_flip_declare_an_orientation(orientation):
    assert declared_orientation(orientation.order, orientation.flip) == orientation


@pytest.mark.parametrize(("order", "flip"), [("xy", ""), ("vu", "x"), ("vu", "vv"), ("", "")])
def test_other_declarations_are_refused(order, flip):
    with pytest.raises(InputError, match="choose"):
        declared_orientation(order, flip)
