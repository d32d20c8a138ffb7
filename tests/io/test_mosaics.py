import warnings

import hypothesis
import hypothesis.extra.numpy as arrays
import hypothesis.strategies as st
import numpy as np
import pytest
from PIL import Image

from occjax.errors import InputError
from occjax.io import GridWarning, join_macpi, join_tiles, load, split_macpi, split_tiles
from occjax.io.mosaics import detect_mosaic, split_quilt
from tests.io.scenes import two_planes

VIEWS = arrays.arrays(np.uint8, st.tuples(*[st.integers(1, 4)] * 4, st.sampled_from([1, 3])))


@hypothesis.given(VIEWS)
def test_tiles_are_laid_out_like_the_grid(views):
    v_count, u_count, h, w, _ = views.shape
    tiled = join_tiles(views)
    for v, u in np.ndindex(v_count, u_count):
        tile = tiled[v * h : (v + 1) * h, u * w : (u + 1) * w]
        np.testing.assert_array_equal(tile, views[v, u])
    np.testing.assert_array_equal(split_tiles(tiled, (v_count, u_count)), views)


@hypothesis.given(VIEWS)
def test_a_macpi_image_has_a_grid_at_each_pixel(views):
    v_count, u_count = views.shape[:2]
    macpi = join_macpi(views)
    for v, u in np.ndindex(v_count, u_count):
        np.testing.assert_array_equal(macpi[v::v_count, u::u_count], views[v, u])
    np.testing.assert_array_equal(split_macpi(macpi, (v_count, u_count)), views)


@pytest.mark.parametrize("split", [split_tiles, split_macpi])
def test_a_grid_that_does_not_divide_the_image_is_refused(split):
    with pytest.raises(InputError, match="10x12 pixels are not a multiple of the 3x4 grid"):
        split(np.zeros((10, 12, 3)), (3, 4))


@pytest.mark.parametrize("split", [split_tiles, split_macpi, split_quilt])
@pytest.mark.parametrize("grid", [(0, 3), (5, -4), (2.0, 3.0), (5,)])
@pytest.mark.usefixtures("unchecked")
def test_a_grid_that_is_not_two_positive_numbers_is_refused(split, grid):
    with pytest.raises(InputError, match=r"must be two whole numbers .* of at least 1"):
        split(np.zeros((10, 12, 3)), grid)


@pytest.mark.parametrize("join", [join_tiles, join_macpi])
def test_views_without_channels_are_not_joined(join):
    with pytest.raises(InputError, match=r"must be \[V, U, H, W, C\], not \[3, 3, 4, 5\]"):
        join(np.zeros((3, 3, 4, 5)))


@pytest.mark.parametrize(("kind", "join"), [("tiled", join_tiles), ("macpi", join_macpi)])
@pytest.mark.parametrize("grid", [(5, 5), (3, 4), (1, 5)])
def test_the_arrangement_is_detected(tmp_path, kind, join, grid):
    views = np.round(two_planes(grid, (60, 72))[0] * 255).astype(np.uint8)
    image = join(views)
    assert detect_mosaic(image, grid) == kind
    Image.fromarray(image).save(tmp_path / "scene.png")
    loaded = load(tmp_path / "scene.png", grid=grid)
    np.testing.assert_array_equal(loaded.views, views)
    assert loaded.name == "scene"


@pytest.mark.parametrize("scene", ["hci/antinous", "rendered/s013", "lytro/2067"])
def test_the_arrangement_of_real_views_is_detected(shared, scene):
    views = load(shared / "data" / scene, check_orientation=False).views[2:7, 2:7]
    assert detect_mosaic(join_tiles(views), (5, 5)) == "tiled"
    assert detect_mosaic(join_macpi(views), (5, 5)) == "macpi"


@pytest.mark.parametrize("visible", [4.5, 6.5])
def test_black_outer_views_do_not_hide_the_arrangement(visible):
    """The views in the corners of a plenoptic camera are black, or all views outside a disc."""
    views = np.round(two_planes((14, 14), (40, 48))[0] * 255).astype(np.uint8)
    v, u = np.mgrid[:14, :14] - 6.5
    views[np.hypot(v, u) > visible + 1] = 0
    assert detect_mosaic(join_macpi(views), (14, 14)) == "macpi"
    assert detect_mosaic(join_tiles(views), (14, 14)) == "tiled"


@pytest.mark.parametrize("name", ["bee_qs4x3a0.75.png", "bee_QS4x3.png", "bee.png"])
def test_a_quilt_is_one_row_of_views_from_the_bottom_left_tile(tmp_path, name):
    views = np.round(two_planes((1, 12), (40, 48), far=-0.2, near=0.5)[0] * 255).astype(np.uint8)
    quilt = join_tiles(views.reshape(3, 4, *views.shape[2:])[::-1])
    Image.fromarray(np.pad(quilt, ((2, 0), (0, 3), (0, 0)))).save(tmp_path / name)
    options = {} if "4x3" in name else {"layout": "quilt", "grid": (3, 4)}
    np.testing.assert_array_equal(load(tmp_path / name, **options).views, views)


def test_a_quilt_whose_name_states_other_tiles_is_named(tmp_path):
    views = np.round(two_planes((1, 12), (40, 48), far=-0.2, near=0.5)[0] * 255).astype(np.uint8)
    quilt = join_tiles(views.reshape(3, 4, *views.shape[2:])[::-1])
    wrong = tmp_path / "bee_qs3x4.png"
    Image.fromarray(quilt).save(wrong)
    with pytest.warns(GridWarning, match=r"3x4 tiles .* repeats as in 4x3 tiles.*--grid 3 4"):
        load(wrong, check_orientation=False)
    np.testing.assert_array_equal(load(wrong, grid=(3, 4)).views, views)


def test_a_quilt_needs_its_tiles(tmp_path):
    Image.fromarray(np.zeros((20, 20), np.uint8)).save(tmp_path / "bee.png")
    with pytest.raises(InputError, match=r"a quilt needs its tiles; pass grid \(--grid ROWS COL"):
        load(tmp_path / "bee.png", layout="quilt")


def test_a_quilt_without_its_name_is_told_from_a_grid(tmp_path):
    views = np.round(two_planes((1, 12), (40, 48), far=-0.2, near=0.5)[0] * 255).astype(np.uint8)
    quilt = join_tiles(views.reshape(3, 4, *views.shape[2:])[::-1])
    Image.fromarray(quilt).save(tmp_path / "bee.png")
    with pytest.warns(
        GridWarning, match=r"a quilt of 3x4 tiles, .* pass layout \(--layout tiled\)"
    ):
        loaded = load(tmp_path / "bee.png", grid=(3, 4), check_orientation=False)
    np.testing.assert_array_equal(loaded.views, views)
    with pytest.raises(InputError, match="--layout quilt --grid ROWS COLUMNS"):
        load(tmp_path / "bee.png")
    with pytest.raises(InputError, match="if it is a quilt, pass layout"):
        load(tmp_path / "bee.png", grid=(3, 5))


@pytest.mark.parametrize(
    ("join", "declared", "told"),
    [
        (join_macpi, (4, 4), "5x5"),
        (join_macpi, (5, 4), "5x5"),
        (join_macpi, (10, 10), "5x5"),
        (join_macpi, (5, 5), None),
        (join_tiles, (5, 5), None),
        (join_tiles, (4, 4), None),
    ],
)
def test_another_grid_of_lenses_is_named(tmp_path, join, declared, told):
    views = np.round(two_planes((5, 5), (40, 48))[0] * 255).astype(np.uint8)
    Image.fromarray(join(views)).save(tmp_path / "all.png")
    layout = "macpi" if join is join_macpi else "tiled"
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        load(tmp_path / "all.png", grid=declared, layout=layout, check_orientation=False)
    messages = [str(w.message) for w in caught]
    assert len(messages) == (told is not None)
    assert told is None or f"those of a MacPI image of {told} views" in messages[0]
