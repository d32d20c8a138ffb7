import json

import h5py
import numpy as np
import pytest
from PIL import Image

from occjax.errors import InputError
from occjax.io import load, write_pfm
from tests.io.files import CONFIG, hci, save_views
from tests.io.scenes import two_planes


@pytest.fixture(scope="module")
def views():
    """3x3 small views, [3, 3, 20, 24, 3] uint8."""
    return np.round(two_planes((3, 3), (20, 24))[0] * 255).astype(np.uint8)


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
        said = "2 of the 3x3 views are missing (input_Cam002.png, input_Cam004.png); add them"
        return folder, {}, [said]

    def missing_last_view(self):
        folder = self.views_folder()
        (folder / hci(2, 2)).unlink()
        return folder, {}, ["boxes", "8 views", "input_Cam007.png", "--grid"]

    def missing_view_of_a_placed_grid(self):
        save_views(self.path / "lytro", self.views, lambda v, u: f"x_{v + 1:02d}_{u + 1:02d}.png")
        (self.path / "lytro/x_02_03.png").unlink()
        return self.path / "lytro", {}, ["1 of the 3x3 views is missing (x_02_03.png); add it"]

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
        return folder, {}, ["boxes", "hci, urbanlf", "--layout hci"]

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

    def config(self, old, new):
        folder = self.views_folder()
        (folder / "parameters.cfg").write_text(CONFIG.replace(old, new))
        return folder

    def config_of_reversed_disparities(self):
        folder = self.config("disp_min = -1.6", "disp_min = 1.6")
        return folder, {}, ["parameters.cfg", "disp_min is 1.6 and disp_max is 1.5"]

    def config_of_equal_disparities(self):
        folder = self.config("disp_min = -1.6", "disp_min = 1.5")
        return folder, {}, ["parameters.cfg", "disp_min is 1.5"]

    def config_of_huge_disparities(self):
        folder = self.config("disp_max = 1.5", "disp_max = 1500")
        return folder, {}, ["parameters.cfg", "-1.6 to 1500", "(24)"]

    def config_of_half_a_camera(self):
        folder = self.config("num_cams_x = 3", "num_cams_x = 5.5")
        return folder, {}, ["parameters.cfg", "num_cams_x", "5.5", "whole number"]

    def config_of_no_camera(self):
        folder = self.config("num_cams_y = 3", "num_cams_y = 0")
        return folder, {}, ["parameters.cfg", "num_cams_y", "positive"]

    def config_of_negative_cameras(self):
        folder = self.config("num_cams_y = 3", "num_cams_y = -5")
        return folder, {}, ["parameters.cfg", "num_cams_y", "-5"]

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

    def folder_of_folders(self):
        save_views(self.path / "scenes/2067", self.views, hci)
        (self.path / "scenes/notes.txt").touch()
        return self.path / "scenes", {}, ["no images", "folders: 2067;", "--pattern"]

    def folder_of_images_of_another_kind(self):
        for i in range(9):
            (self.path / f"input_Cam{i:03d}.webp").touch()
        return self.path, {}, ["input_Cam000.webp", "convert them to PNG"]

    def image_of_another_kind(self):
        (self.path / "all.gif").touch()
        return self.path / "all.gif", {"grid": (3, 3)}, ["all.gif", "convert it to PNG"]

    def link_to_nothing(self):
        folder = self.views_folder()
        (folder / hci(1, 1)).unlink()
        (folder / hci(1, 1)).symlink_to(self.path / "gone.png")
        return folder, {}, [hci(1, 1), "is a link to a file that is not there"]

    def folder_named_like_a_view(self):
        folder = self.views_folder()
        (folder / hci(1, 1)).unlink()
        (folder / hci(1, 1)).mkdir()
        return folder, {}, [hci(1, 1), "is a folder, not an image"]

    def gantry_that_stands_still(self):
        save_views(self.path, self.views, lambda v, u: f"out_{v:02d}_{u:02d}_5.0_7.0_.png")
        return self.path, {}, [str(self.path), "stand at the same place"]

    def gantry_that_moves_along_one_axis(self):
        save_views(self.path, self.views, lambda v, u: f"out_{v:02d}_{u:02d}_{v}.0_7.0_.png")
        return self.path, {}, [str(self.path), "stand at the same place"]

    def unknown_order(self):
        return self.views_folder(), {"order": "rows"}, ["'rows'", "'uv'"]

    def file_of_unknown_suffix(self):
        (self.path / "scene.lfp").touch()
        return self.path / "scene.lfp", {}, ["scene.lfp", "unknown kind"]

    def image(self, name="all.png"):
        Image.fromarray(self.views[0, 0]).save(self.path / name)
        return self.path / name

    def mosaic_without_grid(self):
        return self.image(), {}, ["all.png", "--grid"]

    def mosaic_that_the_grid_does_not_divide(self):
        return self.image(), {"grid": (3, 3)}, ["all.png", "20x24", "3x3"]

    def mosaic_without_texture(self):
        Image.fromarray(np.zeros((20, 20), np.uint8)).save(self.path / "all.png")
        return self.path / "all.png", {"grid": (2, 2)}, ["all.png", "--layout tiled"]

    def folder_layout_for_a_file(self):
        return self.image(), {"layout": "hci"}, ["all.png", "is a file"]

    def array(self, name="scene.npz", **arrays):
        np.savez(self.path / name, **arrays)
        return self.path / name

    def npz_without_views(self):
        path = self.array(a=self.views, b=self.views)
        return path, {}, ["scene.npz", "'views'", "a, b", "--key a"]

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

    def array_of_pixels_first(self):
        return (
            self.array(views=np.moveaxis(self.views, (0, 1), (2, 3))),
            {},
            ["[H, W, V, U", "transpose"],
        )

    def array_of_tiny_views(self):
        return (
            self.array(views=np.zeros((2, 2, 2, 8, 3), np.uint8)),
            {},
            ["scene.npz", "2x8 pixels"],
        )

    def array_of_equal_positions(self):
        path = self.array(views=self.views, positions=np.full((3, 3, 2), [3, 7]))
        return path, {}, ["scene.npz", "positions are all the same"]

    def npz_with_unknown_keys(self):
        path = self.array(views=self.views, disparities=np.zeros(2))
        return path, {}, ["scene.npz", "(disparities)", "disparity_range", "positions"]

    def npz_with_one_key_in_two_cases(self):
        return self.array(views=self.views, Views=self.views), {}, ["scene.npz", "case"]

    def npy_of_petabytes(self):
        header = "{'descr': '|u1', 'fortran_order': False, 'shape': (9, 9, 4000000, 4000000, 3), }"
        line = header.ljust(117) + "\n"
        data = b"\x93NUMPY\x01\x00" + len(line).to_bytes(2, "little") + line.encode()
        (self.path / "scene.npy").write_bytes(data + bytes(100))
        return self.path / "scene.npy", {}, ["scene.npy", "more memory than there is"]

    def mosaic_of_tiny_views(self):
        return self.image(), {"grid": (10, 12)}, ["all.png", "2x2", "10x12", "--grid"]

    def hdf5_that_is_none(self):
        (self.path / "scene.h5").write_text("nothing")
        return self.path / "scene.h5", {}, ["scene.h5", "HDF5"]

    def hdf5_without_views(self):
        with h5py.File(self.path / "scene.h5", "w") as file:
            file["model_weights"] = 1.0
        return self.path / "scene.h5", {}, ["scene.h5", "'LF'", "model_weights"]


pytestmark = pytest.mark.filterwarnings("ignore::occjax.io.GridWarning")

FAULTS = [
    name
    for name in vars(BadFolder)
    if not name.startswith("_") and name not in ("views_folder", "image", "array", "config")
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
