import json
import sys
import warnings

import h5py
import numpy as np
import pytest
from PIL import Image

from occjax.errors import InputError
from occjax.io import Orientation, OrientationWarning, load, read_arrays, write_arrays, write_pfm
from occjax.lightfield import LightField
from tests.io.scenes import two_planes

CONFIG = """[intrinsics]
focal_length_mm = 100.0
image_resolution_x_px = 24
sensor_size_mm = 35.0
fstop = 100.0
[extrinsics]
num_cams_x = 3
num_cams_y = 3
baseline_mm = 50.0
focus_distance_m = 7.2
[meta]
scene = boxes
category = training
disp_min = -1.6
disp_max = 1.5
frustum_disp_min = -2.0
"""


@pytest.fixture(scope="module")
def views():
    """3x3 small views, [3, 3, 20, 24, 3] uint8."""
    return np.round(two_planes((3, 3), (20, 24))[0] * 255).astype(np.uint8)


def save_views(folder, views, name):
    """Write each view to the file that ``name(v, u)`` says."""
    folder.mkdir(parents=True, exist_ok=True)
    for v, u in np.ndindex(*views.shape[:2]):
        path = folder / name(v, u)
        path.parent.mkdir(exist_ok=True)
        Image.fromarray(views[v, u]).save(path)
    return folder


def hci(v, u):
    return f"input_Cam{3 * v + u:03d}.png"


def quietly(path, **options):
    return load(path, check_orientation=False, **options)


def test_hci_folder(tmp_path, views):
    folder = save_views(tmp_path / "boxes", views, hci)
    (folder / "parameters.cfg").write_text(CONFIG)
    truth = np.arange(20 * 24, dtype=np.float32).reshape(20, 24)
    write_pfm(folder / "gt_disp_lowres.pfm", truth)
    light_field = quietly(folder)
    np.testing.assert_array_equal(light_field.views, views)
    np.testing.assert_array_equal(light_field.ground_truth, truth)
    assert light_field.name == "boxes"
    assert light_field.source == folder
    assert light_field.disparity_range == (-1.6, 1.5)
    assert light_field.calibration.focal_length_mm == 100.0
    assert light_field.calibration.sensor_size_mm == 35.0
    assert light_field.calibration.baseline_mm == 50.0
    assert light_field.calibration.focus_distance_m == 7.2


@pytest.mark.parametrize(
    ("name", "options"),
    [
        (hci, {}),
        (lambda v, u: f"flower_7_{v + 1:02d}_{u + 1:02d}.png", {}),
        (lambda v, u: f"{v + 1}_{u + 1}.png", {}),
        (lambda v, u: f"view-{v + 4}-{u}.tif", {"pattern": "view-{v}-{u}.tif"}),
        (lambda v, u: f"{u}.{v}.png", {"pattern": "{u}.{v}.png"}),
        (lambda v, u: f"im{3 * v + u + 1}.png", {"pattern": "im{i}.png"}),
        (lambda v, u: f"row{v}/{u}.png", {"pattern": "row{v}/{u}.png"}),
    ],
)
def test_folders_of_views_by_their_names(tmp_path, views, name, options):
    folder = save_views(tmp_path / "scene", views, name)
    np.testing.assert_array_equal(quietly(folder, **options).views, views)


def test_numbered_views_need_not_form_a_square(tmp_path, views):
    folder = save_views(tmp_path, views[:2], lambda v, u: f"{3 * v + u}.png")
    assert quietly(folder, pattern="{i}.png", grid=(2, 3)).grid == (2, 3)


def test_urbanlf_ground_truth_is_that_of_the_centre_view(tmp_path, views):
    folder = save_views(tmp_path, views, lambda v, u: f"{v + 1}_{u + 1}.png")
    truth = np.random.default_rng(0).normal(size=(20, 24))
    np.save(folder / "2_2_disparity.npy", truth)
    np.save(folder / "2_2_depth.npy", truth + 5)
    np.testing.assert_array_equal(quietly(folder).ground_truth, truth.astype(np.float32))


@pytest.mark.parametrize(("tail", "down"), [("_", 1), ("", -1)])
@pytest.mark.parametrize("backwards", [False, True])
def test_gantry_views_are_sorted_by_where_the_camera_stood(tmp_path, views, tail, down, backwards):
    """The names count exposures; positions are in millimetres, 2 mm apart, one of them off."""
    error = {(0, 2): (0.5, -0.25)}

    def name(v, u):
        dy, dx = error.get((v, u), (0.0, 0.0))
        y, x = down * (100 + 2 * v + dy), -7 + 2 * u + dx
        row, column = (2 - v, 2 - u) if backwards else (v, u)
        return f"out_{row:02d}_{column:02d}_{y:.6f}_{x:.6f}{tail}.png"

    light_field = quietly(save_views(tmp_path, views, name))
    np.testing.assert_array_equal(light_field.views, views)
    positions = light_field.positions
    # The one misplaced camera shortens the mean spacing: one of three columns by -0.5 mm over two
    # steps in rows, one of three rows by -0.25 mm in columns.
    spacing = ((2 - 0.5 / 6) + (2 - 0.25 / 6)) / 2
    expected = 2 * np.stack(np.mgrid[-1:2, -1:2], axis=-1).astype(float)
    expected[0, 2] += error[0, 2]
    np.testing.assert_allclose(positions, expected / spacing, atol=1e-5)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float16, np.float32, np.float64])
@pytest.mark.parametrize("channels", [0, 1, 3, 4])
def test_arrays_of_any_kind(tmp_path, views, dtype, channels):
    scale = np.iinfo(dtype).max if np.issubdtype(dtype, np.integer) else 1
    full = (np.repeat(views, 2, axis=-1) / 255 * scale).astype(dtype)
    stored = full[..., 0] if channels == 0 else full[..., :channels]
    np.save(tmp_path / "scene.npy", stored)
    loaded = quietly(tmp_path / "scene.npy").views
    expected = full[..., : 1 if channels < 3 else 3]
    np.testing.assert_array_equal(loaded, expected.astype(loaded.dtype))
    assert loaded.dtype == (dtype if scale != 1 else np.float32)


def test_npz_with_views_under_any_name(tmp_path, views):
    np.savez(tmp_path / "one.npz", anything=views)
    np.savez(tmp_path / "two.npz", views=views, other=np.zeros(3))
    np.savez(tmp_path / "named.npz", lf=views, other=np.zeros(3))
    for name, key in (("one", None), ("two", None), ("named", "lf")):
        np.testing.assert_array_equal(quietly(tmp_path / f"{name}.npz", key=key).views, views)


def test_written_arrays_come_back(tmp_path, views):
    light_field = LightField(
        views,
        disparity_range=(-1.0, 2.5),
        ground_truth=np.ones((20, 24), np.float32),
        positions=np.ones((3, 3, 2), np.float32),
    )
    write_arrays(tmp_path / "scene.npz", light_field)
    again = read_arrays(tmp_path / "scene.npz")
    np.testing.assert_array_equal(again.views, views)
    np.testing.assert_array_equal(again.ground_truth, light_field.ground_truth)
    np.testing.assert_array_equal(again.positions, light_field.positions)
    assert again.disparity_range == (-1.0, 2.5)


def test_old_hci_file_turns_depth_into_disparity(tmp_path, views):
    """A camera 0.02 m from its neighbour, 600 pixels of focal length, converging at 4 m."""
    depth = np.linspace(3.0, 6.0, 20 * 24, dtype=np.float32).reshape(20, 24)
    with h5py.File(tmp_path / "buddha.h5", "w") as file:
        file["LF"] = views
        file["GT_DEPTH"] = np.broadcast_to(depth, (3, 3, 20, 24))
        file.attrs.update({"dH": [0.02], "focalLength": 600.0, "camDistance": 4.0, "vRes": 3})
    light_field = quietly(tmp_path / "buddha.h5")
    np.testing.assert_array_equal(light_field.views, views)
    expected = 0.02 * 600 / depth - 0.02 * 600 / 4.0
    np.testing.assert_allclose(light_field.ground_truth, expected, atol=1e-5)
    again = light_field.calibration.depth(light_field.ground_truth, light_field.image_size)
    np.testing.assert_allclose(again, depth, rtol=1e-4)


def test_old_hci_file_without_camera_has_views_only(tmp_path, views):
    with h5py.File(tmp_path / "buddha.h5", "w") as file:
        file["LF"] = views
        file["GT_DEPTH"] = np.ones((20, 24))
    light_field = quietly(tmp_path / "buddha.h5")
    assert light_field.calibration is None
    assert light_field.ground_truth is None


def test_without_h5py_the_command_that_installs_it_is_named(tmp_path, monkeypatch):
    (tmp_path / "buddha.h5").touch()
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(InputError, match=r"buddha\.h5.*pip install 'occjax\[published\]'"):
        load(tmp_path / "buddha.h5")


def test_order_and_flip_undo_how_the_files_are_stored(tmp_path, views):
    folder = save_views(tmp_path, views, lambda v, u: f"{u}_{2 - v}.png")
    loaded = quietly(folder, order="uv", flip="v", name="mine")
    np.testing.assert_array_equal(loaded.views, views)
    assert loaded.name == "mine"


def test_progress_counts_the_views(tmp_path, views):
    calls = []
    quietly(save_views(tmp_path, views, hci), progress=lambda *counts: calls.append(counts))
    assert calls == [(done, 9) for done in range(1, 10)]


def test_another_order_than_declared_is_warned_about_with_its_cure(tmp_path):
    views = two_planes()[0]
    swapped = Orientation(swap=True, flip_rows=True).apply(LightField(views)).views
    np.save(tmp_path / "scene.npy", swapped)
    with pytest.warns(OrientationWarning, match=r"scene\.npy.*pass order='uv', flip='u'") as caught:
        load(tmp_path / "scene.npy")
    assert "\n" not in str(caught[0].message)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        cured = load(tmp_path / "scene.npy", order="uv", flip="u")
    np.testing.assert_array_equal(cured.views, views)
    with pytest.warns(OrientationWarning, match="pass order='uv', flip='u'"):
        load(tmp_path / "scene.npy", order="vu", flip="u")


def test_real_folders_load_as_declared(shared):
    antinous = load(shared / "data/hci/antinous")
    assert antinous.views.shape == (9, 9, 512, 512, 3)
    assert antinous.ground_truth.shape == (512, 512)
    lytro = load(shared / "data/lytro/2067")
    assert lytro.views.shape == (9, 9, 383, 552, 3)
    assert lytro.name == "2067"


class BadFolder:
    """Makes inputs that are wrong in one way each; returns path, options and words to be said."""

    def __init__(self, tmp_path, views):
        self.path, self.views = tmp_path, views

    def views_folder(self):
        return save_views(self.path / "boxes", self.views, hci)

    def nonexistent_path(self):
        return self.path / "nowhere", {}, ["nowhere", "no such file"]

    def empty_folder(self):
        (self.path / "empty").mkdir()
        return self.path / "empty", {}, ["empty", "no images"]

    def folder_without_images(self):
        (self.path / "notes.txt").touch()
        return self.path, {}, [str(self.path), "no images", "notes.txt"]

    def folder_of_unknown_names(self):
        save_views(self.path / "mine", self.views, lambda v, u: f"a{v}b{u}.png")
        return self.path / "mine", {}, ["mine", "a0b0.png", "pattern"]

    def missing_views(self):
        folder = self.views_folder()
        (folder / hci(1, 1)).unlink()
        (folder / hci(0, 2)).unlink()
        return folder, {}, ["boxes", "input_Cam002.png, input_Cam004.png", "2 of the 3x3"]

    def missing_last_view(self):
        folder = self.views_folder()
        (folder / hci(2, 2)).unlink()
        return folder, {}, ["boxes", "8 views", "input_Cam007.png", "grid="]

    def missing_view_of_a_placed_grid(self):
        save_views(self.path / "lytro", self.views, lambda v, u: f"x_{v + 1:02d}_{u + 1:02d}.png")
        (self.path / "lytro/x_02_03.png").unlink()
        return self.path / "lytro", {}, ["lytro", "x_02_03.png"]

    def missing_gantry_view(self):
        save_views(self.path, self.views, lambda v, u: f"out_{v:02d}_{u:02d}_{v}.0_{u}.0_.png")
        (self.path / "out_01_00_1.0_0.0_.png").unlink()
        return self.path, {}, ["out_01_00_..."]

    def smaller_than_the_grid(self):
        return self.views_folder(), {"grid": (4, 4)}, ["boxes", "input_Cam009.png", "7 of the 4x4"]

    def larger_than_the_grid(self):
        return self.views_folder(), {"grid": (2, 2)}, ["input_Cam008.png", "2x2 grid"]

    def several_layouts(self):
        folder = self.views_folder()
        save_views(folder, self.views, lambda v, u: f"{v}_{u}.png")
        return folder, {}, ["boxes", "hci, urbanlf", "layout="]

    def several_scenes(self):
        for scene in "ab":
            save_views(self.path, self.views, lambda v, u, s=scene: f"{s}_{v:02d}_{u:02d}.png")
        return self.path, {}, [str(self.path), "(a, b)"]

    def one_view_twice(self):
        folder = self.views_folder()
        Image.fromarray(self.views[0, 0]).save(folder / "input_Cam000.tif")
        return folder, {}, ["input_Cam000.png", "input_Cam000.tif", "same view"]

    def differing_sizes(self):
        folder = self.views_folder()
        Image.fromarray(self.views[0, 0][:, :-1]).save(folder / hci(1, 2))
        return folder, {}, [hci(1, 2), "23x20", "24x20"]

    def grey_among_colour(self):
        folder = self.views_folder()
        Image.fromarray(self.views[0, 0][..., 0]).save(folder / hci(1, 2))
        return folder, {}, [hci(1, 2), "grey", "RGB"]

    def truncated_image(self):
        folder = self.views_folder()
        data = (folder / hci(2, 0)).read_bytes()
        (folder / hci(2, 0)).write_bytes(data[: len(data) // 2])
        return folder, {}, [hci(2, 0), "cannot be decoded"]

    def truncated_first_image(self):
        folder = self.views_folder()
        (folder / hci(0, 0)).write_bytes((folder / hci(0, 0)).read_bytes()[:40])
        return folder, {}, [hci(0, 0), "cannot be decoded"]

    def image_that_is_none(self):
        folder = self.views_folder()
        (folder / hci(2, 0)).write_text("<html>not found</html>")
        return folder, {}, [hci(2, 0), "not an image"]

    def empty_image(self):
        folder = self.views_folder()
        (folder / hci(2, 0)).write_bytes(b"")
        return folder, {}, [hci(2, 0), "not an image"]

    def ground_truth_of_another_size(self):
        folder = self.views_folder()
        write_pfm(folder / "gt_disp_lowres.pfm", np.zeros((20, 20)))
        return folder, {}, ["gt_disp_lowres.pfm", "[20, 20]", "[20, 24]"]

    def truncated_ground_truth(self):
        folder = self.views_folder()
        (folder / "gt_disp_lowres.pfm").write_bytes(b"Pf\n24 20\n-1\n1234")
        return folder, {}, ["gt_disp_lowres.pfm", "truncated"]

    def config_without_a_field(self):
        folder = self.views_folder()
        (folder / "parameters.cfg").write_text(CONFIG.replace("baseline_mm", "base"))
        return folder, {}, ["parameters.cfg", "baseline_mm", "[extrinsics]"]

    def config_with_a_word_for_a_number(self):
        folder = self.views_folder()
        (folder / "parameters.cfg").write_text(CONFIG.replace("7.2", "far"))
        return folder, {}, ["parameters.cfg", "focus_distance_m", "'far'"]

    def config_that_is_none(self):
        folder = self.views_folder()
        (folder / "parameters.cfg").write_text(json.dumps({"baseline_mm": 50}))
        return folder, {}, ["parameters.cfg", "not a configuration file"]

    def pattern_without_places(self):
        return self.views_folder(), {"pattern": "input_{u}.png"}, ["{v} and {u}"]

    def pattern_that_matches_nothing(self):
        options = {"pattern": "view_{i}.png"}
        return self.views_folder(), options, ["boxes", "view_{i}.png", "input_Cam000.png"]

    def layout_that_matches_nothing(self):
        return self.views_folder(), {"layout": "lytro"}, ["boxes", "NAME_01_01.png"]

    def layout_that_does_not_exist(self):
        return self.views_folder(), {"layout": "hdr"}, ["'hdr'", "macpi"]

    def layout_of_a_file_for_a_folder(self):
        return self.views_folder(), {"layout": "macpi"}, ["boxes", "is a folder"]

    def grid_of_nothing(self):
        return self.views_folder(), {"grid": (0, 3)}, ["grid is (0, 3)"]

    def unknown_order(self):
        return self.views_folder(), {"order": "rows"}, ["'rows'", "'uv'"]

    def file_of_unknown_suffix(self):
        (self.path / "scene.lfp").touch()
        return self.path / "scene.lfp", {}, ["scene.lfp", "unknown kind"]

    def image(self, name="all.png"):
        Image.fromarray(self.views[0, 0]).save(self.path / name)
        return self.path / name

    def mosaic_without_grid(self):
        return self.image(), {}, ["all.png", "grid="]

    def mosaic_that_the_grid_does_not_divide(self):
        return self.image(), {"grid": (3, 3)}, ["all.png", "20x24", "3x3"]

    def mosaic_without_texture(self):
        Image.fromarray(np.zeros((20, 20), np.uint8)).save(self.path / "all.png")
        return self.path / "all.png", {"grid": (2, 2)}, ["all.png", "layout='tiled'"]

    def folder_layout_for_a_file(self):
        return self.image(), {"layout": "hci"}, ["all.png", "is a file"]

    def array(self, name="scene.npz", **arrays):
        np.savez(self.path / name, **arrays)
        return self.path / name

    def npz_without_views(self):
        path = self.array(a=self.views, b=self.views)
        return path, {}, ["scene.npz", "'views'", "a, b", "key="]

    def npz_without_the_key(self):
        return self.array(a=self.views), {"key": "b"}, ["scene.npz", "'b'"]

    def npz_that_is_none(self):
        (self.path / "scene.npz").write_text("no archive")
        return self.path / "scene.npz", {}, ["scene.npz", "NumPy file"]

    def npz_cut_short(self):
        path = self.array(views=self.views)
        path.write_bytes(path.read_bytes()[:-200])
        return path, {}, ["scene.npz", "NumPy file"]

    def npy_cut_short(self):
        np.save(self.path / "scene.npy", self.views)
        path = self.path / "scene.npy"
        path.write_bytes(path.read_bytes()[:-200])
        return path, {}, ["scene.npy", "NumPy file"]

    def pickled_npy(self):
        np.save(self.path / "scene.npy", np.array([{"views": 1}]), allow_pickle=True)
        return self.path / "scene.npy", {}, ["scene.npy", "pickled"]

    def pickled_npz(self):
        return self.array(views=np.array([{}, []], object)), {}, ["scene.npz", "pickled"]

    def array_of_another_rank(self):
        return self.array(views=self.views[0, 0]), {}, ["scene.npz", "[V, U, H, W"]

    def array_of_views_in_one_row(self):
        return self.array(views=self.views[0]), {}, ["scene.npz", "[V, U, H, W"]

    def array_of_many_channels(self):
        many = np.concatenate([self.views, self.views], axis=-1)
        return self.array(views=many), {}, ["scene.npz", "[V, U, H, W"]

    def array_of_whole_numbers(self):
        return self.array(views=self.views.astype(np.int64)), {}, ["scene.npz", "int64"]

    def nan_pixels(self):
        views = self.views / 255.0
        views[1, 1, 3, 3] = np.nan
        return self.array(views=views), {}, ["scene.npz", "NaN"]

    def infinite_pixels(self):
        views = self.views / 255.0
        views[1, 1, 3, 3] = np.inf
        return self.array(views=views), {}, ["scene.npz", "infinite"]

    def floats_beyond_one(self):
        views = self.views.astype(np.float32)
        return self.array(views=views), {}, ["scene.npz", "[0, 1]"]

    def array_of_another_grid(self):
        return self.array(views=self.views), {"grid": (9, 9)}, ["scene.npz", "3x3", "9x9"]

    def array_with_wrong_ground_truth(self):
        path = self.array(views=self.views, ground_truth=np.zeros((3, 3)))
        return path, {}, ["scene.npz", "ground truth"]

    def array_with_empty_range(self):
        path = self.array(views=self.views, disparity_range=np.array([1.0, 1.0]))
        return path, {}, ["scene.npz", "disparity_range"]

    def array_with_wrong_positions(self):
        path = self.array(views=self.views, positions=np.zeros((3, 3)))
        return path, {}, ["scene.npz", "positions"]

    def hdf5_that_is_none(self):
        (self.path / "scene.h5").write_text("nothing")
        return self.path / "scene.h5", {}, ["scene.h5", "HDF5"]

    def hdf5_without_views(self):
        with h5py.File(self.path / "scene.h5", "w") as file:
            file["model_weights"] = 1.0
        return self.path / "scene.h5", {}, ["scene.h5", "'LF'", "model_weights"]


FAULTS = [
    name
    for name in vars(BadFolder)
    if not name.startswith("_") and name not in ("views_folder", "image", "array")
]


@pytest.mark.parametrize("fault", FAULTS)
def test_bad_input_gets_one_line_that_names_it(tmp_path, views, fault):
    path, options, words = getattr(BadFolder(tmp_path, views), fault)()
    with pytest.raises(InputError) as error:
        load(path, **options)
    message = str(error.value)
    assert "\n" not in message
    for word in words:
        assert word in message


@pytest.mark.parametrize("reader", ["folder", "file"])
def test_what_may_not_be_read_is_named(tmp_path, views, monkeypatch, reader):
    """Refused by a stand-in for the operating system, since the superuser may read everything."""

    def refuse(path, *_, **__):
        raise PermissionError(13, "Permission denied", str(path))

    folder = save_views(tmp_path / "boxes", views, hci)
    if reader == "folder":
        monkeypatch.setattr("os.scandir", refuse)
        named = "boxes"
    else:
        monkeypatch.setattr("pathlib.Path.read_bytes", refuse)
        named = hci(0, 0)
    with pytest.raises(InputError, match=f"{named}: may not be read"):
        load(folder)
