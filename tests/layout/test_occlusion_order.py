import numpy as np
import pytest

from occjax.layout.brightness import view_brightness
from occjax.layout.config import ViewOrderConfig
from occjax.layout.consistency import view_cross
from occjax.layout.filters import box_mean
from occjax.layout.occlusion_order import nearer_in_front
from occjax.layout.orientation import Orientation
from occjax.lightfield import LightField
from tests.io.scenes import two_planes


@pytest.fixture(scope="module")
def scene():
    views, disparity = two_planes()
    light_field = LightField(views)
    cross = view_cross(light_field, view_brightness(light_field), 256, ViewOrderConfig())
    return cross, disparity


@pytest.mark.parametrize("spread", [0, 2, 3])
def test_the_nearer_surface_is_in_front_even_if_its_disparity_edge_is_too_wide(scene, spread):
    """Block matching gives pixels of the wall next to the square the disparity of the square."""
    cross, disparity = scene
    near = box_mean((disparity > 0).astype(np.float32), spread) > 1e-3
    assert near.sum() == (32 - 1 + 2 * spread) ** 2
    spread_out = np.where(near, disparity.max(), disparity.min()).astype(np.float32)
    assert nearer_in_front(cross, spread_out, Orientation()) > 0.8
    assert nearer_in_front(cross, -spread_out, Orientation().reversed_sign) < 0.2


def test_without_collisions_there_is_no_result(scene):
    cross, disparity = scene
    assert nearer_in_front(cross, np.zeros_like(disparity), Orientation()) is None
