"""Flips, rotations and crops against closed forms and photo-consistency."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.data.transforms import (
    crop,
    transform_images,
    transform_offsets,
    transform_sample,
)
from occjax.errors import InputError
from occjax.lightfield import centre_index, view_offsets
from tests.data.scenes import DISC, assert_consistent, disc_before_a_wall, star

cut = jax.jit(crop, static_argnames="size")

ARRANGEMENTS = {
    "grid": view_offsets(5, 5),
    "even grid": view_offsets(4, 4),
    "wide grid": view_offsets(3, 5),
    "row": view_offsets(1, 7),
    "star": star(5),
}
ON_IMAGES = {
    "flip_rows": np.flipud,
    "flip_columns": np.fliplr,
    "transpose": np.transpose,
    "quarter turn": np.rot90,
    "three quarter turns": lambda image: np.rot90(image, 3),
}


QUARTER_TURNS = {
    "quarter turn": ("transpose", "flip_rows"),
    "three quarter turns": ("flip_rows", "transpose"),
}


def turned(name, sample):
    """The sample changed by one of ``ON_IMAGES``."""
    for symmetry in QUARTER_TURNS.get(name, (name,)):
        sample = transform_sample(sample, symmetry)
    return sample


def test_the_scene_itself_is_consistent_and_has_occlusions():
    assert assert_consistent(*disc_before_a_wall(view_offsets(5, 5))) > 100


@pytest.mark.parametrize("arrangement", ARRANGEMENTS)
@pytest.mark.parametrize("name", ON_IMAGES)
def test_flips_and_rotations_keep_the_light_field_consistent(name, arrangement):
    sample, masks = disc_before_a_wall(ARRANGEMENTS[arrangement])
    changed = turned(name, sample)
    hidden = assert_consistent(changed, turned(name, masks))
    assert hidden == assert_consistent(sample, masks)
    centres = [one.views[centre_index(one.views.shape[:2])] for one in (changed, sample)]
    for field, before in [
        centres,
        (changed.disparity, sample.disparity),
        (changed.valid, sample.valid),
    ]:
        np.testing.assert_array_equal(field, ON_IMAGES[name](np.asarray(before)))
    if arrangement == "grid":  # networks for full grids take no offsets
        np.testing.assert_array_equal(changed.offsets, sample.offsets)


@pytest.mark.parametrize("name", ["transpose", "flip_rows", "flip_columns"])
def test_offsets_turn_as_the_pixels_of_a_map_of_them(name):
    offsets = view_offsets(5, 5)
    np.testing.assert_array_equal(
        transform_offsets(transform_images(offsets, name, (0, 1)), name), offsets
    )


@pytest.mark.parametrize("arrangement", ["even grid", "star"])
@pytest.mark.parametrize("corner", [(0, 0), (6, 5)])
def test_crops_are_consistent(corner, arrangement):
    sample, masks = disc_before_a_wall(ARRANGEMENTS[arrangement], size=(48, 54))
    size = (30, 33)
    parts = [cut(one, jnp.array(corner), size) for one in (sample, masks)]
    assert assert_consistent(*parts) > 10
    assert float(jnp.max(parts[0].disparity)) == DISC
    window = np.s_[..., corner[0] : corner[0] + size[0], corner[1] : corner[1] + size[1]]
    for name in ("views", "disparity", "valid"):
        expected = getattr(sample, name)[window]
        np.testing.assert_array_equal(getattr(parts[0], name), expected)


def test_points_that_leave_the_window_are_not_visible():
    sample, _ = disc_before_a_wall(view_offsets(1, 5), size=(12, 12))
    known = jnp.ones((1, 5, 12, 12), bool).at[0, 0, 0, 0].set(False)
    sample = sample._replace(disparity=jnp.ones((12, 12)), visibility=known)
    found = cut(sample, jnp.array([2, 2]), (8, 8)).visibility
    column = np.arange(8)
    for u in range(5):  # seen at column - 1.0 * (u - 2)
        inside = (column - (u - 2) >= 0) & (column - (u - 2) <= 7)
        np.testing.assert_array_equal(found[0, u, 4], inside)
    unknown = sample._replace(visibility=jnp.ones_like(known))
    assert bool(jnp.all(cut(unknown, jnp.array([2, 2]), (8, 8)).visibility))


def test_a_window_larger_than_the_views_is_refused():
    sample, _ = disc_before_a_wall(view_offsets(1, 1), size=(12, 12))
    with pytest.raises(InputError, match="window of 13x12 pixels"):
        crop(sample, jnp.array([0, 0]), (13, 12))
