"""File names: patterns, the patterns of unknown names, and the grid that they form."""

import re
import warnings

import numpy as np
import pytest
from PIL import Image

from occjax.cli.scene_lists import listed_scenes
from occjax.errors import InputError
from occjax.io import GridWarning, load, read_pfm
from occjax.io.arrays import write_arrays
from occjax.io.images import read_image
from occjax.io.naming.fitting_patterns import fitting_patterns
from occjax.layout import ORIENTATIONS
from occjax.lightfield import LightField
from tests.io.files import save_views
from tests.io.scenes import two_planes

LETTERS = "abcde"


def hci(v, u):
    """File name of view ``(v, u)`` of 5x5."""
    return f"input_Cam{5 * v + u:03d}.png"


@pytest.fixture(scope="module")
def views():
    """5x5 views of two planes, uint8."""
    return np.round(two_planes((5, 5), (48, 56))[0] * 255).astype(np.uint8)


def load_unchecked(path, **options):
    return load(path, check_orientation=False, **options)


@pytest.mark.filterwarnings("ignore::occjax.io.GridWarning")
@pytest.mark.parametrize("start", ["painter_059_", "IMG_"])
@pytest.mark.parametrize("columns", [5, 25])
def test_a_grid_of_numbered_views_is_told_from_one_row(tmp_path, views, columns, start):
    """The names SCENE_059_00 ... SCENE_059_24 are 25 cameras, or a row of 25 views."""
    if columns == 25:
        views = np.round(two_planes((1, 25), (48, 56), far=-0.2, near=0.3)[0] * 255).astype(
            np.uint8
        )
    folder = save_views(tmp_path, views, lambda v, u: f"{start}{columns * v + u:02d}.png")
    np.testing.assert_array_equal(load_unchecked(folder).views, views)
    assert load_unchecked(folder, grid=(1, 25)).grid == (1, 25)
    assert load_unchecked(folder, grid=(5, 5)).grid == (5, 5)


@pytest.mark.filterwarnings("ignore::occjax.io.GridWarning")
@pytest.mark.parametrize("frames", [2, 16])
def test_several_frames_are_no_grid(tmp_path, views, frames):
    """Equal frames, too, and as many as there are cameras: they look like a square grid."""
    views = views[:4, :4]
    for frame in range(frames):
        save_views(tmp_path, views, lambda v, u, f=frame: f"painter_{f:03d}_{4 * v + u:02d}.png")
    message = rf"has {frames} frames of 4x4 views, .*pass pattern .*'painter_000_\{{i\}}\.png'"
    with pytest.raises(InputError, match=message):
        load(tmp_path)
    loaded = load_unchecked(tmp_path, pattern="painter_000_{i}.png")
    np.testing.assert_array_equal(loaded.views, views)
    assert load_unchecked(tmp_path, grid=(frames, 16)).grid == (frames, 16)


@pytest.mark.parametrize(
    ("cameras", "frames"), [((2, 2), 4), ((3, 3), 9), ((2, 3), 5), ((1, 3), 3), ((1, 2), 5)]
)
def test_frames_of_any_grid_are_no_light_field(tmp_path, views, cameras, frames):
    rows, columns = cameras
    for frame in range(frames):
        cells = views[1 : 1 + rows, 1 : 1 + columns]
        save_views(tmp_path, cells, lambda v, u, f=frame: f"s_{f:03d}_{columns * v + u:02d}.png")
    message = f"has {frames} frames of {rows}x{columns} views"
    with pytest.raises(InputError, match=message) as refused:
        load(tmp_path)
    grid = "" if rows == columns else f" --grid {rows} {columns}"
    assert "--pattern 's_000_{i}.png'" + grid in str(refused.value)


def test_the_number_of_the_camera_may_come_before_that_of_the_frame(tmp_path, views):
    for frame in range(5):
        save_views(
            tmp_path, views[1:3, 1:4], lambda v, u, f=frame: f"s_{3 * v + u:03d}_{f:02d}.png"
        )
    message = r"has 5 frames of 2x3 views, .*'s_\{i\}_00\.png' --grid 2 3"
    with pytest.raises(InputError, match=message):
        load(tmp_path)


@pytest.mark.filterwarnings("ignore::occjax.io.ViewOrderWarning")
def test_frames_that_explain_the_images_as_well_are_named(tmp_path):
    """Noise is as consistent as three frames of 2x2 cameras."""
    noise = np.random.default_rng(0).integers(0, 255, (3, 4, 24, 24), np.uint8)
    save_views(tmp_path, noise, lambda v, u: f"wall_{v:03d}_{u:02d}.png")
    with pytest.warns(GridWarning, match=r"one 3x4 grid, but 3 frames of 2x2 .* 'wall_000_\{i\}"):
        assert load(tmp_path).grid == (3, 4)
    assert load(tmp_path, pattern="wall_{v}_{u}.png").grid == (3, 4)


@pytest.mark.parametrize("grid", [(3, 3), (4, 6)])
@pytest.mark.parametrize("order", ORIENTATIONS, ids=lambda order: order.name)
def test_a_grid_in_any_view_order_is_no_sequence_of_frames(tmp_path, grid, order):
    views = np.round(two_planes(grid, (48, 56), far=-0.5, near=0.8)[0] * 255).astype(np.uint8)
    folder = save_views(tmp_path, order.lay_out(views), lambda v, u: f"wall_{v:03d}_{u:02d}.png")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        load(folder)
    assert not [str(w.message) for w in caught if "frames" in str(w.message)]


def test_several_scenes_may_be_one_with_other_names(tmp_path, views):
    folder = save_views(tmp_path, views, lambda v, u: f"a{v}b{u}_{u}_{v}.png")
    with pytest.raises(InputError, match=r"of several scenes .* or pass pattern .*'a\{v\}b\{u\}_"):
        load_unchecked(folder)


@pytest.mark.parametrize("rows", [3, 9])
def test_a_grid_with_a_square_number_of_columns_is_no_sequence_of_frames(tmp_path, rows):
    views = np.round(two_planes((rows, 9), (48, 56), far=-0.5, near=0.5)[0] * 255).astype(np.uint8)
    folder = save_views(tmp_path, views, lambda v, u: f"painter_{v:03d}_{u:02d}.png")
    np.testing.assert_array_equal(load(folder).views, views)


def test_frame_camera_case(shared):
    with pytest.warns(GridWarning, match="16 views taken as 4x4; pass grid"):
        light_field = load(shared / "data/cases/frame_camera")
    assert light_field.grid == (4, 4)
    assert not light_field.view_order_report.clearly_worse
    low, high = light_field.view_order_report.disparity_range
    truth = read_pfm(shared / "data/cases/frame_camera/truth.pfm")
    assert low <= truth.min()
    assert high >= truth.max()


def test_double_underscore_case(shared, tolerance):
    light_field = load(shared / "data/cases/double_underscore")
    assert light_field.grid == (3, 3)
    np.testing.assert_allclose(
        light_field.positions, np.stack(np.mgrid[-1:2, -1:2], axis=-1), **tolerance("absolute")
    )


@pytest.mark.filterwarnings("ignore:.*views taken as 5x5")
@pytest.mark.parametrize(
    ("name", "pattern"),
    [
        (lambda v, u: f"image_{v - 2:+d}_{u - 2:+d}.png", "image_{v}_{u}.png"),
        (lambda v, u: f"cam-{LETTERS[v].upper()}{u + 1}.png", "cam-{v}{u}.png"),
        (lambda v, u: f"view{v}-{u}_{7.25 * v - 20:.6f}_{u + 0.1 * v:.3f}_.png", None),
        (lambda v, u: f"row{LETTERS[v].upper()}_{u}.png", "row{v}_{u}.png"),
        (lambda v, u: f"x{10 * v}y{10 * u}.png", "x{v}y{u}.png"),
        (lambda v, u: f"IMG_{731 + 3 * (5 * v + u):04d}.png", "IMG_{i}.png"),
    ],
)
def test_the_pattern_of_unknown_names_is_found_and_told(tmp_path, views, name, pattern):
    folder = save_views(tmp_path, views, name)
    with pytest.warns(GridWarning, match="read by --pattern") as warned:
        np.testing.assert_array_equal(load_unchecked(folder).views, views)
    if pattern is not None:
        assert f"--pattern {pattern!r}" in str(warned[0].message)


@pytest.mark.parametrize("name", ["image_{}_{}.png", "{}_{}.png"])
def test_negative_indices_are_not_left_out_of_a_known_layout(tmp_path, views, name):
    """Four of the nine names fit the names of a Lytro grid or of UrbanLF."""
    save_views(tmp_path, views[:3, :3], lambda v, u: name.format(v - 1, u - 1))
    with pytest.warns(GridWarning, match="file names read by --pattern"):
        np.testing.assert_array_equal(load_unchecked(tmp_path).views, views[:3, :3])


def test_several_patterns_are_listed():
    names = [f"a{v}b{u}c{w}.png" for v in range(2) for u in range(2) for w in range(2)]
    assert fitting_patterns(names) == []
    latin = [f"a{v}b{u}c{(u + v) % 3}.png" for v in range(3) for u in range(3)]
    assert fitting_patterns(latin) == ["a{v}b{u}c*.png", "a{v}b*c{u}.png", "a*b{v}c{u}.png"]


def test_several_patterns_are_refused(tmp_path, views):
    save_views(tmp_path, views, lambda v, u: f"a{v}b{u}c{(u + v) % 5}.png")
    with pytest.raises(InputError, match=r"pass pattern \(--pattern 'a\{v\}b\{u\}c\*\.png' or"):
        load_unchecked(tmp_path)


def test_wildcards_in_patterns(tmp_path, views):
    folder = save_views(tmp_path, views, lambda v, u: f"{v}_{u}_{17 * v - u}.png")
    loaded = load_unchecked(folder, pattern="{v}_{u}_*.png")
    np.testing.assert_array_equal(loaded.views, views)


@pytest.mark.filterwarnings("ignore::occjax.io.GridWarning")
def test_serpentine_order(tmp_path, views):
    folder = save_views(tmp_path, views, lambda v, u: f"{5 * v + (4 - u if v % 2 else u)}.png")
    np.testing.assert_array_equal(load_unchecked(folder, order="serpentine").views, views)
    tiles = np.concatenate([np.concatenate(list(row), axis=1) for row in views], axis=0)
    Image.fromarray(tiles).save(tmp_path / "tiles.png")
    turned = load_unchecked(tmp_path / "tiles.png", grid=(5, 5), order="serpentine").views
    np.testing.assert_array_equal(turned[1], views[1, ::-1])
    np.testing.assert_array_equal(turned[::2], views[::2])


def test_camera_positions_follow_views_in_serpentine_order(tmp_path, views):
    positions = np.stack(np.meshgrid(np.arange(-2.0, 3.0), np.arange(-2.0, 3.0), indexing="ij"), -1)
    stored_views, stored_positions = views.copy(), positions.copy()
    for row in (1, 3):
        stored_views[row], stored_positions[row] = views[row, ::-1], positions[row, ::-1]
    np.savez(tmp_path / "scene.npz", views=stored_views, positions=stored_positions)
    loaded = load_unchecked(tmp_path / "scene.npz", order="serpentine")
    np.testing.assert_array_equal(loaded.views, views)
    np.testing.assert_array_equal(loaded.positions, positions)


def test_numbers_with_gaps_are_counted_not_subtracted(tmp_path, views):
    save_views(tmp_path, views[:, :4], lambda v, u: f"IMG_{731 + 3 * (5 * v + u):04d}.png")
    with pytest.raises(InputError, match=r"20 views up to .* do not form a square grid"):
        load_unchecked(tmp_path, pattern="IMG_{i}.png")
    assert load_unchecked(tmp_path, pattern="IMG_{i}.png", grid=(5, 4)).grid == (5, 4)


def test_no_advice_repeats_what_was_passed(tmp_path, views):
    folder = save_views(tmp_path, views, lambda v, u: f"s_{v + 1:02d}_{u + 1:02d}.png")
    with pytest.raises(InputError, match="show 5x5 views, not 4x4; leave out grid"):
        load_unchecked(folder, grid=(4, 4))
    with pytest.raises(InputError, match=r"5x5 views; on which side.* unknown; leave out grid"):
        load_unchecked(folder, grid=(6, 5))
    assert load_unchecked(folder).grid == (5, 5)


ROUND = np.hypot(*(np.indices((5, 5)) - 2)) < 2.5
"""Views of a round aperture: without the four corners."""


@pytest.mark.parametrize(
    ("name", "options"),
    [
        (lambda v, u: f"s_{v + 1:02d}_{u + 1:02d}.png", {}),
        (lambda v, u: f"s_{v + 1:02d}_{u + 1:02d}.png", {"grid": (5, 5)}),
        (hci, {}),
        (lambda v, u: f"{5 * v + u + 1:02d}.png", {"pattern": "{i}.png"}),
        (lambda v, u: f"{5 * v + u:02d}.png", {"pattern": "{i}.png", "grid": (5, 5)}),
        (lambda v, u: f"out_{v:02d}_{u:02d}_{7.5 * v}_{7.5 * u}_.png", {}),
    ],
)
def test_missing_views_are_named_and_not_usable(tmp_path, views, name, options):
    folder = save_views(tmp_path, views, name)
    for v, u in np.argwhere(~ROUND):
        (folder / name(v, u)).unlink()
    with pytest.warns(
        GridWarning, match=r"4 of the 5x5 views are missing \(.*\) and not"
    ) as warned:
        loaded = load_unchecked(folder, **options)
    assert name(4, 4)[:10] in str(warned[0].message)
    np.testing.assert_array_equal(loaded.usable, ROUND)
    np.testing.assert_array_equal(loaded.views, np.where(ROUND[..., None, None, None], views, 0))
    if loaded.positions is not None:
        np.testing.assert_allclose(loaded.positions, np.moveaxis(np.indices((5, 5)) - 2, 0, -1))


def test_missing_outer_rows_need_a_grid_to_count(tmp_path, views):
    """The names of 5x3 views from column 2 to 4 are those of a 5x5 grid without two columns."""
    folder = save_views(tmp_path, views[:, 1:4], lambda v, u: f"s_{v + 1:02d}_{u + 2:02d}.png")
    assert load_unchecked(folder).usable is None
    with pytest.warns(GridWarning, match="10 of the 5x5 views are missing"):
        usable = load_unchecked(folder, grid=(5, 5)).usable
    assert usable.any(0).tolist() == [False, True, True, True, False]


@pytest.mark.filterwarnings("ignore::occjax.io.GridWarning")
@pytest.mark.parametrize(
    ("name", "grid", "missing", "options", "advice"),
    [
        ("s_{v}_{u}.png", (5, 5), [(2, 2)], {}, r"move the first row of views \(s_0_0.png"),
        ("s_{v}_{u}.png", (5, 5), [(2, 2), (3, 2)], {}, r"first column .* s_2_3.png is the"),
        ("s_{v}_{u}.png", (4, 4), [(1, 1)], {"flip": "vu"}, "last row|first row"),
        ("input_Cam0{i:02}.png", (5, 5), [(2, 2)], {}, r"last two rows .*--grid 3 5"),
        ("input_Cam0{i:02}.png", (4, 5), [(2, 2)], {"grid": (4, 5)}, r"last row .*--grid 3 5"),
    ],
)
def test_the_advice_on_a_missing_centre_view_works(
    tmp_path, views, name, grid, missing, options, advice
):
    rows, columns = grid

    def named(v, u):
        return name.format(v=v, u=u, i=columns * v + u)

    folder = save_views(tmp_path, views[:rows, :columns], named)
    for index in missing:
        (folder / named(*index)).unlink()
    with pytest.raises(InputError, match=rf"the centre view {named(*missing[0])} .*{advice}") as e:
        load_unchecked(folder, **options)
    side = re.search("move the (first|last|last two) (row|column)s? of", str(e.value))
    assert side is not None
    places = {"first": [0], "last": [-1], "last two": [-2, -1]}[side[1]]
    axis = ("row", "column").index(side[2])
    for index in np.argwhere(np.isin(np.indices(grid)[axis], np.array(places) % grid[axis])):
        (folder / named(*index)).unlink(missing_ok=True)
    option = re.search(r"--grid (\d+) (\d+)", str(e.value))
    options = {**options, **({"grid": (int(option[1]), int(option[2]))} if option else {})}
    loaded = load_unchecked(folder, **options)
    new_centre = re.search(r"([\w.]+) is the centre view of the (\d)x(\d) views", str(e.value))
    assert new_centre is not None
    assert loaded.grid == (int(new_centre[2]), int(new_centre[3]))
    np.testing.assert_array_equal(loaded.centre, read_image(folder / new_centre[1]))


@pytest.mark.filterwarnings("ignore::occjax.io.GridWarning")
def test_the_centre_view_is_that_of_the_declared_order(tmp_path, views):
    """A flip of four rows makes row 1 of the files the centre row."""
    folder = save_views(tmp_path, views[:4], lambda v, u: f"s_{v}_{u}.png")
    (folder / "s_2_2.png").unlink()
    loaded = load_unchecked(folder, flip="v")
    np.testing.assert_array_equal(loaded.centre, views[1, 2])
    assert np.argwhere(~loaded.usable).tolist() == [[1, 2]]


def test_views_of_several_suffixes_are_read_together(tmp_path, views):
    def name(v, u):
        return f"cam-{v}-{u}.{'png' if v + u < 3 else 'bmp'}"

    save_views(tmp_path, views, name)
    with pytest.warns(GridWarning, match=r"--pattern 'cam-\{v\}-\{u\}\.\*'"):
        np.testing.assert_array_equal(load_unchecked(tmp_path).views, views)
    (tmp_path / "cam-0-0.txt").write_text("no image")
    loaded = load_unchecked(tmp_path, pattern="cam-{v}-{u}.*")
    np.testing.assert_array_equal(loaded.views, views)


@pytest.mark.filterwarnings("ignore::occjax.io.GridWarning")
@pytest.mark.parametrize("suffix", ["bmp", "webp"])
def test_images_of_another_suffix_that_are_not_read_are_named(tmp_path, views, suffix):
    folder = save_views(tmp_path, views, lambda v, u: f"a{v}b{u}.png")
    for u in range(3):
        Image.fromarray(views[0, 0]).save(folder / f"a9b{u}.{suffix}")
    with pytest.warns(GridWarning, match=rf"3 images of another .*\(a9b0.{suffix}, a9b1"):
        assert load_unchecked(folder).grid == (5, 5)


def test_of_views_in_two_formats_one_is_read(tmp_path, views):
    for suffix in ("bmp", "png"):
        save_views(tmp_path, views, lambda v, u, suffix=suffix: f"a{v}b{u}.{suffix}")
    with pytest.warns(GridWarning, match=r"read by --pattern 'a\{v\}b\{u\}.png'") as warned:
        np.testing.assert_array_equal(load_unchecked(tmp_path).views, views)
    assert len(warned) == 1


def test_a_view_of_another_size_is_not_used(tmp_path, views):
    folder = save_views(tmp_path, views, hci)
    Image.fromarray(views[0, 0, :40, :50]).save(folder / hci(1, 3))
    with pytest.warns(GridWarning, match="input_Cam008.png: is 50x40 RGB uint8, not 56x48 RGB"):
        loaded = load_unchecked(folder, grid=(5, 5))
    assert np.argwhere(~loaded.usable).tolist() == [[1, 3]]
    for u in range(4):
        Image.fromarray(views[0, 0, :40, :50]).save(folder / hci(0, u))
    with pytest.raises(InputError, match=r"20 of 56x48 RGB uint8 and 5 of 50x40 .*_Cam000.png"):
        load_unchecked(folder, grid=(5, 5))


def test_a_stray_file_makes_no_grid(tmp_path, views):
    folder = save_views(tmp_path, views, lambda v, u: f"s_{v + 1:02d}_{u + 1:02d}.png")
    (folder / "s_01_01.png").rename(folder / "s_90_01.png")
    with pytest.raises(InputError, match="most rows have none"):
        load_unchecked(folder)


def test_an_image_that_cannot_be_decoded_is_a_missing_view(tmp_path, views):
    folder = save_views(tmp_path, views, hci)
    (folder / hci(0, 0)).write_bytes(b"")
    with pytest.warns(GridWarning, match="input_Cam000.png: .* the view is not used"):
        loaded = load_unchecked(folder, grid=(5, 5))
    assert np.argwhere(~loaded.usable).tolist() == [[0, 0]]


def test_usable_views_are_stored(tmp_path, views):
    write_arrays(tmp_path / "scene.npz", LightField(views, usable=ROUND))
    np.testing.assert_array_equal(load_unchecked(tmp_path / "scene.npz").usable, ROUND)


@pytest.mark.parametrize(
    ("name", "pattern", "grid"),
    [
        (lambda v, u: f"row{v}/c{u}.png", "row{v}/c{u}.png", (5, 3)),
        (lambda v, u: f"cam{5 * v + u:02d}/image.png", "cam{i}/image.png", (5, 5)),
    ],
)
def test_views_in_subfolders_are_one_light_field(tmp_path, views, name, pattern, grid):
    """Three or one image in a folder are no light field, so that the folders are not scenes."""
    views = views[: grid[0], : grid[1]]
    save_views(tmp_path, views, name)
    assert listed_scenes((tmp_path,), None) == (tmp_path,)
    with pytest.raises(InputError, match=re.escape(f"pass pattern (--pattern {pattern!r})")):
        load_unchecked(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", GridWarning)
        loaded = load_unchecked(tmp_path, pattern=pattern)
    np.testing.assert_array_equal(loaded.views, views)
    folders = sorted(path for path in tmp_path.iterdir())
    assert listed_scenes((tmp_path,), None, grid=(1, 3)) == tuple(folders)


@pytest.mark.parametrize("name", ["input_Cam{:03d}.png", "NAME_01_{:02d}.png"])
def test_scenes_of_a_known_layout_are_no_parts_of_a_light_field(tmp_path, views, name):
    save_views(tmp_path, views[:2, :3], lambda v, u: f"scene{v}/{name.format(u)}")
    assert listed_scenes((tmp_path,), None) == (tmp_path / "scene0", tmp_path / "scene1")


def test_two_capitals_are_row_and_column():
    for prefix in ("cam", "cam_", "", "2024_HR_"):
        names = [f"{prefix}{v}{u}.png" for v in "ABC" for u in "ABCD"]
        assert fitting_patterns(names) == [f"{prefix}{{v}}{{u}}.png"]
    assert fitting_patterns([f"IMG{v}{u}.png" for v in "AB" for u in "AB"]) == []


def test_a_file_without_a_name_is_no_view():
    grid = [f"{v}-{u}.png" for v in range(3) for u in range(3)]
    assert fitting_patterns([".png", *grid]) == ["{v}-{u}.png"]
    assert fitting_patterns([".png"]) == []
