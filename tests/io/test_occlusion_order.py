import numpy as np
import pytest

from occjax.io.checking import SURE_OF_SIGN
from occjax.io.occlusion_order import nearer_in_front
from occjax.io.orientation import Orientation
from occjax.io.photoconsistency import box_mean, cross
from occjax.lightfield import LightField
from tests.io.scenes import two_planes


@pytest.fixture(scope="module")
def scene():
    views, disparity = two_planes()
    return cross(LightField(views), 256), disparity


@pytest.mark.parametrize("spread", [0, 2, 3])
def test_the_nearer_surface_is_in_front_although_the_map_spreads_it_over_the_wall(scene, spread):
    """As the windows of block matching do: pixels of the wall get the square's disparity."""
    views, disparity = scene
    near = box_mean((disparity > 0).astype(np.float32), spread) > 1e-3
    assert near.sum() == (48 - 1 + 2 * spread) ** 2
    spread_out = np.where(near, disparity.max(), disparity.min()).astype(np.float32)
    assert nearer_in_front(views, spread_out, Orientation()) > SURE_OF_SIGN
    assert nearer_in_front(views, -spread_out, Orientation().reversed_sign) < 1 - SURE_OF_SIGN


def test_nothing_is_said_where_nothing_collides(scene):
    views, disparity = scene
    assert nearer_in_front(views, np.zeros_like(disparity), Orientation()) is None
