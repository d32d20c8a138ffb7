"""Flips, turns and frames against closed forms and photo-consistency."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.data import transforms
from occjax.data.samples import Sample
from occjax.data.transforms import flip_columns, flip_rows, rotate, transpose
from occjax.errors import InputError
from tests.data.scenes import DISC, assert_consistent, disc_before_a_wall, grid, star
from tests.scenes import plane

frame = jax.jit(transforms.frame, static_argnames=("size", "interpolate"))

ARRANGEMENTS = {
    "grid": grid(5, 5),
    "even grid": grid(4, 4),
    "wide grid": grid(3, 5),
    "row": grid(1, 7),
    "star": star(5),
}
SYMMETRIES = {
    "flip_rows": flip_rows,
    "flip_columns": flip_columns,
    "transpose": transpose,
    "quarter turn": lambda sample: rotate(sample, 1),
    "three quarter turns": lambda sample: rotate(sample, 3),
}
ON_IMAGES = {
    "flip_rows": np.flipud,
    "flip_columns": np.fliplr,
    "transpose": np.transpose,
    "quarter turn": np.rot90,
    "three quarter turns": lambda image: np.rot90(image, 3),
}


def test_the_scene_itself_is_consistent_and_has_occlusions():
    assert assert_consistent(*disc_before_a_wall(grid(5, 5))) > 100


@pytest.mark.parametrize("arrangement", ARRANGEMENTS)
@pytest.mark.parametrize("name", SYMMETRIES)
def test_flips_and_turns_keep_the_light_field_consistent(name, arrangement):
    sample, masks = disc_before_a_wall(ARRANGEMENTS[arrangement])
    hidden = assert_consistent(SYMMETRIES[name](sample), SYMMETRIES[name](masks))
    assert hidden == assert_consistent(sample, masks)


@pytest.mark.parametrize("name", SYMMETRIES)
def test_maps_and_the_centre_view_are_turned_as_images_are(name):
    sample, _ = disc_before_a_wall(grid(3, 5))
    changed = SYMMETRIES[name](sample)
    v, u = changed.views.shape[:2]
    for field, before in [
        (changed.views[v // 2, u // 2], sample.views[1, 2]),
        (changed.disparity, sample.disparity),
        (changed.valid, sample.valid),
    ]:
        np.testing.assert_array_equal(field, ON_IMAGES[name](np.asarray(before)))


@pytest.mark.parametrize("name", SYMMETRIES)
def test_a_regular_grid_stays_regular(name):
    """Networks for full grids do not ask for offsets."""
    sample, _ = disc_before_a_wall(grid(5, 5))
    np.testing.assert_array_equal(SYMMETRIES[name](sample).offsets, grid(5, 5))


def test_four_quarter_turns_are_none():
    sample, _ = disc_before_a_wall(grid(3, 3))
    turned = sample
    for _ in range(4):
        turned = rotate(turned, 1)
    jax.tree.map(np.testing.assert_array_equal, turned, sample)


def plane_sample(disparity, offsets=(5, 5), **options):
    """A textured plane without occlusions, in closed form, from the tests of the readers."""
    field = plane(offsets, disparity=disparity, **options)
    seen = np.ones(field.views.shape[:4], bool)
    seen[0, 0, 0, 0] = False  # known, not unknown
    return Sample(
        *map(jnp.asarray, (field.grey(), grid(*offsets), field.ground_truth, seen, seen[1, 1]))
    )


@pytest.mark.parametrize("shear", [-1.0, 2.0])
def test_a_whole_shear_is_the_plane_at_another_disparity(shear):
    size, margin = (20, 24), 6
    sample = plane_sample(0.6, size=(size[0] + 2 * margin, size[1] + 2 * margin))
    framed = frame(sample, jnp.array([margin, margin]), size, shear=shear, interpolate=False)
    # The plane nearer by the shear, seen through the same frame, whose first pixel is `margin`.
    nearer = plane_sample(0.6 + shear, size=(size[0] + margin, size[1] + margin))
    inner = np.s_[..., margin:, margin:]
    np.testing.assert_allclose(framed.views, nearer.views[inner], atol=1e-4)
    np.testing.assert_allclose(framed.disparity, 0.6 + shear, rtol=1e-6)


def test_a_shear_between_pixels_is_the_plane_at_another_disparity():
    sample, _ = disc_before_a_wall(grid(5, 5), size=(40, 40))
    y, x = np.mgrid[:40, :40].astype(np.float32)
    offsets = grid(5, 5)[..., None, None]

    def waves(disparity, first=0.0):
        at_y = y + first + disparity * offsets[:, :, 0]
        at_x = x + first + disparity * offsets[:, :, 1]
        return 0.5 + 0.2 * np.sin(0.5 * at_y + 0.2) + 0.2 * np.cos(0.4 * at_x - 0.3 * at_y)

    sample = sample._replace(
        views=jnp.asarray(waves(0.3)), disparity=jnp.full_like(sample.disparity, 0.3)
    )
    framed = frame(sample, jnp.array([8, 8]), (24, 24), shear=0.45)
    np.testing.assert_allclose(framed.views, waves(0.75, 8.0)[..., :24, :24], atol=2e-3)


@pytest.mark.parametrize("arrangement", ["even grid", "star"])
@pytest.mark.parametrize(
    ("stride", "shear", "tolerance"),
    [
        (1, 0.0, 0.02),
        (1, 1.0, 0.02),
        (1, -1.0, 0.02),
        (2, 0.0, 0.03),
        (2, -1.0, 0.03),
        (3, 0.0, 0.04),
    ],
)
def test_frames_are_consistent(stride, shear, tolerance, arrangement):
    sample, masks = disc_before_a_wall(ARRANGEMENTS[arrangement], size=(48, 54))
    corner = jnp.array([6, 5]) if stride > 1 else jnp.array([16, 14])
    cut = [
        frame(one, corner, (14, 16), stride=stride, shear=shear, interpolate=False)
        for one in (sample, masks)
    ]
    assert assert_consistent(*cut, tolerance) > 10
    assert float(jnp.max(cut[0].disparity)) == pytest.approx(DISC / stride + shear)
    row, column = np.asarray(corner)
    expected = np.asarray(sample.valid)[row : row + 14 * stride : stride, column:][:, ::stride]
    np.testing.assert_array_equal(cut[0].valid, expected[:, :16])


def test_points_that_leave_the_frame_are_not_visible():
    sample = plane_sample(1.0, size=(12, 12))
    cut = frame(sample, jnp.array([2, 2]), (8, 8))
    column = np.arange(8)
    for u in range(5):  # seen at column - 1.0 * (u - 2)
        inside = (column - (u - 2) >= 0) & (column - (u - 2) <= 7)
        np.testing.assert_array_equal(cut.visibility[2, u, 4], inside)


def test_unknown_visibility_stays_unknown():
    sample = plane_sample(1.0, size=(12, 12))
    sample = sample._replace(visibility=jnp.ones_like(sample.visibility))
    assert bool(jnp.all(frame(sample, jnp.array([2, 2]), (8, 8)).visibility))


def test_a_frame_larger_than_the_views_is_refused():
    with pytest.raises(InputError, match="frame of 13x12 pixels"):
        frame(plane_sample(1.0, size=(12, 12)), jnp.array([0, 0]), (13, 12))
