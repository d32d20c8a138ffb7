"""Bad input: every fault gets one line that names the file and says what to do."""

import os

import h5py
import numpy as np
import pytest
from PIL import Image

from occjax.errors import InputError
from occjax.io import load, write_pfm
from tests.io.files import CONFIG, hci, npy_header, save_views
from tests.io.scenes import two_planes

pytestmark = pytest.mark.filterwarnings("ignore::occjax.io.GridWarning")

VIEWS = np.round(two_planes((3, 3), (20, 24))[0] * 255).astype(np.uint8)
VIEW = VIEWS[0, 0]
FRACTIONS = VIEWS / 255.0


def refused(path, words, **options):
    """Check that reading fails with one line that contains all the words."""
    with pytest.raises(InputError) as error:
        load(path, **options)
    message = str(error.value)
    assert "\n" not in message
    for word in words:
        assert word in message


def save(image, path):
    Image.fromarray(image).save(path)


def cut(path, length):
    path.write_bytes(path.read_bytes()[:length])


def replace(path, make):
    path.unlink()
    make(path)


def remove(folder, *indices):
    for index in indices:
        (folder / hci(*index)).unlink()


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (
            lambda f: remove(f, (1, 1), (0, 2)),
            [
                "the centre view input_Cam004.png (row 1, column 1 of the 3x3 grid, counted from",
                "add it",
            ],
        ),
        (lambda f: remove(f, (2, 2)), ["boxes", "8 views", "input_Cam007.png", "--grid"]),
        (
            lambda f: save_views(f, VIEWS, lambda v, u: f"{v}_{u}.png"),
            ["boxes", "hci, urbanlf", "--layout hci"],
        ),
        (
            lambda f: save(VIEW, f / "input_Cam000.tif"),
            ["input_Cam000.png", "input_Cam000.tif", "same view"],
        ),
        (
            lambda f: [cut(f / hci(v, 0), length) for v, length in enumerate((300, 40, 0))],
            [hci(0, 0), "cannot be decoded as an image"],
        ),
        (
            lambda f: [(f / hci(v, 0)).write_text("<html>not found</html>") for v in (1, 2)],
            [hci(1, 0), "cannot identify image file"],
        ),
        (
            lambda f: replace(f / hci(1, 1), lambda path: path.symlink_to("gone.png")),
            [hci(1, 1), "is a link to a missing file"],
        ),
        (
            lambda f: replace(f / hci(1, 1), lambda path: path.mkdir()),
            [hci(1, 1), "is a folder, not an image"],
        ),
        (
            lambda f: write_pfm(f / "gt_disp_lowres.pfm", np.zeros((20, 20))),
            ["gt_disp_lowres.pfm", "[20, 20]", "[20, 24]"],
        ),
        (
            lambda f: (f / "gt_disp_lowres.pfm").write_bytes(b"Pf\n24 20\n-1\n1234"),
            ["gt_disp_lowres.pfm", "truncated"],
        ),
    ],
)
def test_damaged_folders(tmp_path, damage, words):
    folder = save_views(tmp_path / "boxes", VIEWS, hci)
    damage(folder)
    refused(folder, words)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("baseline_mm", "base", ["baseline_mm", "[extrinsics]"]),
        ("7.2", "far", ["focus_distance_m", "'far'"]),
        (CONFIG, '{"baseline_mm": 50}', ["cannot be decoded as a configuration file"]),
        ("disp_min = -1.6", "disp_min = 1.6", ["disp_min is 1.6 and disp_max is 1.5"]),
        ("disp_min = -1.6", "disp_min = 1.5", ["disp_min is 1.5"]),
        ("disp_max = 1.5", "disp_max = 1500", ["-1.6 to 1500", "(24)"]),
        ("num_cams_x = 3", "num_cams_x = 5.5", ["num_cams_x", "5.5", "whole number"]),
        ("num_cams_y = 3", "num_cams_y = 0", ["num_cams_y", "positive"]),
        ("num_cams_y = 3", "num_cams_y = -5", ["num_cams_y", "-5"]),
        ("x_px = 24", "x_px = 2.5", ["image_resolution_x_px in [intrinsics] is 2.5"]),
    ],
)
def test_wrong_camera_parameters(tmp_path, old, new, words):
    folder = save_views(tmp_path / "boxes", VIEWS, hci)
    (folder / "parameters.cfg").write_text(CONFIG.replace(old, new))
    refused(folder, ["parameters.cfg", *words])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"grid": (4, 4)}, ["boxes", "the centre view input_Cam010.png"]),
        ({"grid": (2, 2)}, ["input_Cam008.png", "2x2 grid"]),
        ({"grid": (0, 3)}, ["grid is (0, 3)"]),
        ({"pattern": "input_{u}.png"}, ["{v} and {u}"]),
        ({"pattern": "view_{i}.png"}, ["boxes", "view_{i}.png", "input_Cam000.png"]),
        ({"layout": "lytro"}, ["boxes", "NAME_01_01.png"]),
        ({"layout": "hdr"}, ["'hdr'", "macpi"]),
        ({"layout": "lenslet"}, ["'lenslet'", "'tiled' or 'macpi'"]),
        ({"layout": "lyto"}, ["'lyto'; did you mean 'lytro'?"]),
        ({"views": (4, 4)}, ["views 4 4", "4 rows and 4 columns", "has 3 rows and 3 columns"]),
        ({"layout": "macpi"}, ["boxes", "is a folder"]),
        ({"order": "rows"}, ["'rows'", "'uv'"]),
    ],
)
def test_options_that_do_not_fit_the_folder(tmp_path, options, words):
    refused(save_views(tmp_path / "boxes", VIEWS, hci), words, **options)


@pytest.mark.parametrize(
    ("name", "removed", "words"),
    [
        (lambda v, u: f"{'pqrstuvwx'[v] * 2}.png", None, ["pp.png", "--pattern"]),
        (
            lambda v, u: f"x_{v + 1:02d}_{u + 1:02d}.png",
            "x_02_02.png",
            ["the centre view x_02_02.png", "is missing"],
        ),
        (
            lambda v, u: f"out_{v:02d}_{u:02d}_{v}.0_{u}.0_.png",
            "out_01_01_1.0_1.0_.png",
            ["out_01_01_..."],
        ),
        (lambda v, u: f"out_{v:02d}_{u:02d}_5.0_7.0_.png", None, ["have the same position"]),
        (lambda v, u: f"out_{v:02d}_{u:02d}_{v}.0_7.0_.png", None, ["have the same position"]),
        (lambda v, u: f"{'ab'[u % 2]}_{v:02d}_{u:02d}.png", None, ["several scenes (a, b)"]),
        (lambda v, u: f"2067/{hci(v, u)}", None, ["no images", "folders: 2067;", "--pattern"]),
    ],
)
def test_file_names_that_do_not_form_a_grid(tmp_path, name, removed, words):
    folder = save_views(tmp_path / "scene", VIEWS, name)
    if removed:
        (folder / removed).unlink()
    refused(folder, [str(folder), *words])


@pytest.mark.parametrize(
    ("names", "options", "words"),
    [
        (("all_15x15.png", "blue_15x15.png"), {}, ["/all_15x15.png, and", "(--grid 15 15)"]),
        (("all.png", "blue.png"), {"grid": (3, 4)}, ["/all.png, and", "(--grid 3 4)"]),
        (("all_512x512.png", "blue.png"), {}, ["/all_512x512.png, and", "(--grid V U)"]),
    ],
)
def test_folders_of_images_of_all_views(tmp_path, names, options, words):
    for name in names:
        save(VIEW, tmp_path / name)
    refused(tmp_path, ["if each image holds all views, name one", *words, "--pattern"], **options)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ([], ["no images"]),
        (["notes.txt"], ["no images", "notes.txt"]),
        ([f"input_Cam{i:03d}.webp" for i in range(9)], ["input_Cam000.webp", "convert them to"]),
    ],
)
def test_folders_without_images(tmp_path, names, words):
    for name in names:
        (tmp_path / name).touch()
    refused(tmp_path, [str(tmp_path), *words])


@pytest.mark.parametrize(
    ("image", "options", "words"),
    [
        (VIEW, {}, ["--grid"]),
        (VIEW, {"grid": (3, 3)}, ["20x24", "3x3"]),
        (VIEW, {"grid": (10, 12)}, ["2x2", "10x12", "--grid"]),
        (VIEW, {"layout": "hci"}, ["is a file"]),
        (np.zeros((20, 20), np.uint8), {"grid": (2, 2)}, ["--layout tiled"]),
    ],
)
def test_mosaics_that_cannot_be_split(tmp_path, image, options, words):
    save(image, tmp_path / "all.png")
    refused(tmp_path / "all.png", ["all.png", *words], **options)


def with_value(value):
    views = FRACTIONS.copy()
    views[1, 1, 3, 3] = value
    return views


@pytest.mark.parametrize(
    ("arrays", "options", "words"),
    [
        ({"a": VIEWS, "b": VIEWS}, {}, ["'views'", "a [3, 3, 20, 24, 3], b", "--key NAME"]),
        ({"a": VIEWS}, {"key": "b"}, ["'b'"]),
        ({"images": VIEWS}, {"key": "Image"}, ["'Image'", "did you mean 'images'?"]),
        ({"views": np.array([{}, []], object)}, {}, ["NumPy file", "allow_pickle=False"]),
        ({"views": VIEW}, {}, ["[V, U, H, W"]),
        ({"views": VIEWS[0]}, {}, ["[V, U, H, W"]),
        ({"views": np.concatenate([VIEWS, VIEWS], axis=-1)}, {}, ["[V, U, H, W"]),
        ({"views": np.moveaxis(VIEWS, (0, 1), (2, 3))}, {}, ["[H, W, V, U", "transpose"]),
        ({"views": np.zeros((2, 2, 2, 8, 3), np.uint8)}, {}, ["2x8 pixels"]),
        ({"views": VIEWS.astype(np.int64)}, {}, ["int64"]),
        ({"views": with_value(np.nan)}, {}, ["NaN"]),
        ({"views": with_value(np.inf)}, {}, ["infinite"]),
        ({"views": VIEWS.astype(np.float32)}, {}, ["[0, 1]"]),
        ({"views": VIEWS}, {"grid": (9, 9)}, ["3x3", "9x9"]),
        ({"views": VIEWS, "ground_truth": np.zeros((3, 3))}, {}, ["ground truth is [3, 3]"]),
        ({"views": VIEWS, "disparity_range": np.array([1.0, 1.0])}, {}, ["disparity_range"]),
        ({"views": VIEWS, "positions": np.zeros((3, 3))}, {}, ["positions"]),
        ({"views": VIEWS, "positions": np.full((3, 3, 2), [3, 7])}, {}, ["are all the same"]),
        (
            {"views": VIEWS, "disparities": np.zeros(2)},
            {},
            ["(disparities)", "disparity_range", "positions"],
        ),
        ({"views": VIEWS, "Views": VIEWS}, {}, ["only in case"]),
    ],
)
def test_archives_that_are_no_light_field(tmp_path, arrays, options, words):
    np.savez(tmp_path / "scene.npz", **arrays)
    refused(tmp_path / "scene.npz", ["scene.npz", *words], **options)


def npy_of_petabytes(path):
    path.write_bytes(npy_header((9, 9, 4000000, 4000000, 3)) + bytes(100))


def hdf5_without_views(path):
    with h5py.File(path, "w") as file:
        file["model/weights"] = np.ones((3, 2, 4))


def npz_cut_short(path):
    np.savez(path, views=VIEWS)
    cut(path, -200)


def npy_cut_short(path):
    np.save(path, VIEWS)
    cut(path, -200)


def folder_of_raw_files(path):
    path.mkdir()
    (path / "IMG.LFR").touch()


@pytest.mark.parametrize(
    ("name", "write", "words"),
    [
        ("nowhere", lambda path: None, ["there is no such file"]),
        ("all.gif", lambda path: path.touch(), ["convert it to PNG"]),
        ("all.png", lambda path: path.write_text("text"), ["cannot be decoded as an image"]),
        ("scene.xyz", lambda path: path.touch(), ["unknown kind"]),
        ("IMG.LFR", lambda path: path.touch(), ["PlenoptiCam", "{v}_{u}.png", "Light Field Too"]),
        ("raw", folder_of_raw_files, ["raw/IMG.LFR", "PlenoptiCam"]),
        ("scene.npz", lambda path: path.write_text("no archive"), ["NumPy file"]),
        ("scene.npz", npz_cut_short, ["NumPy file"]),
        ("scene.npy", npy_cut_short, ["NumPy file"]),
        (
            "scene.npy",
            lambda path: np.save(path, np.array([{"views": 1}]), allow_pickle=True),
            ["allow_pickle=False"],
        ),
        ("scene.npy", npy_of_petabytes, ["claims 3.89e+", "OCCJAX_MAX_LIGHT_FIELD_BYTES"]),
        ("scene.h5", lambda path: path.write_text("nothing"), ["HDF5"]),
        ("scene.h5", hdf5_without_views, ["model/weights is [3, 2, 4]", "[V, U, H, W, C]"]),
    ],
)
def test_files_that_are_no_light_field(tmp_path, name, write, words):
    write(tmp_path / name)
    refused(tmp_path / name, [name, *words])


@pytest.mark.parametrize(("function", "named"), [("os.scandir", "boxes"), ("os.open", hci(1, 1))])
def test_missing_permissions(tmp_path, monkeypatch, function, named):
    """The operating system is replaced, since the superuser may read everything."""
    folder = save_views(tmp_path / "boxes", VIEWS, hci)

    def refuse(path, *_, **__):
        raise PermissionError(13, os.strerror(13), str(path))

    monkeypatch.setattr(function, refuse)
    refused(folder, [f"{named}: may not be read"])


def test_an_npy_file_has_no_keys(tmp_path):
    np.save(tmp_path / "scene.npy", VIEWS)
    refused(tmp_path / "scene.npy", ["without a name; leave out key (--key views)"], key="views")
