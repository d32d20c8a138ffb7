import subprocess
import sys
import warnings

import numpy as np
import pytest
from PIL import Image

from occjax.io import (
    GridWarning,
    ViewOrderWarning,
    load,
    read_arrays,
    write_arrays,
    write_pfm,
)
from occjax.io.hci_config import read_hci_config
from occjax.layout.orientation import Orientation
from occjax.lightfield import Calibration, LightField
from tests.io.files import CONFIG, hci, save_views
from tests.io.scenes import texture, two_planes

pytestmark = pytest.mark.filterwarnings("ignore::occjax.io.GridWarning")


@pytest.fixture(scope="module")
def views():
    """3x3 small views, [3, 3, 20, 24, 3] uint8."""
    return np.round(two_planes((3, 3), (20, 24))[0] * 255).astype(np.uint8)


def load_unchecked(path, **options):
    return load(path, check_orientation=False, **options)


def test_hci_folder(tmp_path, views):
    folder = save_views(tmp_path / "boxes", views, hci)
    (folder / "parameters.cfg").write_text(CONFIG)
    truth = np.arange(20 * 24, dtype=np.float32).reshape(20, 24) / 100
    write_pfm(folder / "gt_disp_lowres.pfm", truth)
    light_field = load_unchecked(folder)
    np.testing.assert_array_equal(light_field.views, views)
    np.testing.assert_array_equal(light_field.ground_truth, truth)
    assert light_field.name == "boxes"
    assert light_field.source == folder
    assert light_field.disparity_range == (-1.6, 1.5)
    assert light_field.calibration == Calibration(100.0, 35.0, 50.0, 7.2)
    config = CONFIG.replace("x_px = 24", "x_px = 24\nimage_resolution_y_px = 20")
    (folder / "parameters.cfg").write_text(config)
    assert read_hci_config(folder / "parameters.cfg").image_size == (20, 24)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        (hci, {}),
        (lambda v, u: f"flower_7_{v + 1:02d}_{u + 1:02d}.png", {}),
        (lambda v, u: f"flower_{v + 1}_{u + 1}.png", {}),
        (lambda v, u: f"flower_{v + 1:03d}_{u + 1:03d}.png", {}),
        (lambda v, u: f"input_Cam{3 * v + u + 36:03d}.png", {}),
        (lambda v, u: f"view_{3 * v + u + 7}.png", {"pattern": "view_{i}.png"}),
        (lambda v, u: f"view_{3 * v + u + 7}.png", {"pattern": "view_{i}.png", "grid": (3, 3)}),
        (lambda v, u: f"{v + 1}_{u + 1}.png", {}),
        (lambda v, u: f"view-{v + 4}-{u}.tif", {"pattern": "view-{v}-{u}.tif"}),
        (lambda v, u: f"{u}.{v}.png", {"pattern": "{u}.{v}.png"}),
        (lambda v, u: f"im{3 * v + u + 1}.png", {"pattern": "im{i}.png"}),
        (lambda v, u: f"row{v}/{u}.png", {"pattern": "row{v}/{u}.png"}),
    ],
)
def test_folders_of_views_by_their_names(tmp_path, views, name, options):
    folder = save_views(tmp_path / "scene", views, name)
    np.testing.assert_array_equal(load_unchecked(folder, **options).views, views)


@pytest.mark.filterwarnings("error::occjax.io.GridWarning")
def test_a_grid_guessed_from_the_number_of_views_is_announced(tmp_path, views):
    folder = save_views(tmp_path / "boxes", views, hci)
    with pytest.warns(GridWarning, match=r"boxes: 9 views taken as 3x3; pass grid \(--grid V U\)"):
        load_unchecked(folder)
    assert load_unchecked(folder, grid=(1, 9)).grid == (1, 9)
    (folder / "parameters.cfg").write_text(CONFIG)
    assert load_unchecked(folder).grid == (3, 3)


@pytest.mark.filterwarnings("error::occjax.io.GridWarning")
def test_81_views_are_9x9_without_a_warning(tmp_path, views):
    names = [f"input_Cam{i:03d}.png" for i in range(81)]
    for name in names:
        Image.fromarray(views[0, 0]).save(tmp_path / name)
    assert load_unchecked(tmp_path).grid == (9, 9)
    for name in names[64:]:
        (tmp_path / name).unlink()
    with pytest.warns(GridWarning, match="64 views taken as 8x8"):
        load_unchecked(tmp_path)


def test_hidden_files_are_ignored(tmp_path, views):
    folder = save_views(tmp_path, views, lambda v, u: f"sc_{v + 1:02d}_{u + 1:02d}.png")
    for path in list(folder.iterdir()):
        (folder / f"._{path.name}").write_bytes(b"resource fork")
    np.testing.assert_array_equal(load_unchecked(folder).views, views)


def test_numbered_views_need_not_form_a_square(tmp_path, views):
    folder = save_views(tmp_path, views[:2], lambda v, u: f"{3 * v + u}.png")
    assert load_unchecked(folder, pattern="{i}.png", grid=(2, 3)).grid == (2, 3)


def test_urbanlf_ground_truth_is_that_of_the_centre_view(tmp_path, views):
    folder = save_views(tmp_path, views, lambda v, u: f"{v + 1}_{u + 1}.png")
    truth = np.random.default_rng(0).normal(size=(20, 24))
    np.save(folder / "2_2_disparity.npy", truth)
    np.save(folder / "2_2_depth.npy", truth + 5)
    np.testing.assert_array_equal(load_unchecked(folder).ground_truth, truth.astype(np.float32))


@pytest.mark.parametrize(("tail", "down"), [("_", 1), ("", -1)])
@pytest.mark.parametrize("backwards", [False, True])
def test_gantry_views_are_sorted_by_camera_position(
    tmp_path, views, tail, down, backwards, tolerance
):
    """The names count exposures; positions are in millimetres, 2 mm apart, one of them off."""
    error = {(0, 2): (0.5, -0.25)}

    def name(v, u):
        dy, dx = error.get((v, u), (0.0, 0.0))
        y, x = down * (100 + 2 * v + dy), -7 + 2 * u + dx
        row, column = (2 - v, 2 - u) if backwards else (v, u)
        return f"out_{row:02d}_{column:02d}_{y:.6f}_{x:.6f}{tail}.png"

    light_field = load_unchecked(save_views(tmp_path, views, name))
    np.testing.assert_array_equal(light_field.views, views)
    positions = light_field.positions
    # The one misplaced camera shortens the mean spacing: one of three columns by -0.5 mm over two
    # steps in rows, one of three rows by -0.25 mm in columns.
    spacing = ((2 - 0.5 / 6) + (2 - 0.25 / 6)) / 2
    expected = 2 * np.stack(np.mgrid[-1:2, -1:2], axis=-1).astype(float)
    expected[0, 2] += error[0, 2]
    np.testing.assert_allclose(positions, expected / spacing, **tolerance("absolute"))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float16, np.float32, np.float64])
@pytest.mark.parametrize("channels", [0, 1, 3, 4])
def test_arrays_of_any_type(tmp_path, views, dtype, channels):
    scale = np.iinfo(dtype).max if np.issubdtype(dtype, np.integer) else 1
    full = (np.repeat(views, 2, axis=-1) / 255 * scale).astype(dtype)
    stored = full[..., 0] if channels == 0 else full[..., :channels]
    np.save(tmp_path / "scene.npy", stored)
    loaded = load_unchecked(tmp_path / "scene.npy").views
    expected = full[..., : 1 if channels < 3 else 3]
    np.testing.assert_array_equal(loaded, expected.astype(loaded.dtype))
    assert loaded.dtype == (dtype if scale != 1 else np.float32)


def test_npz_with_views_under_any_name(tmp_path, views):
    np.savez(tmp_path / "one.npz", anything=views)
    np.savez(tmp_path / "two.npz", Views=views, Disparity_Range=np.array([-1.0, 2.0]))
    np.savez(tmp_path / "named.npz", lf=views, other=np.zeros(3))
    for name, key in (("one", None), ("two", None), ("named", "lf")):
        np.testing.assert_array_equal(
            load_unchecked(tmp_path / f"{name}.npz", key=key).views, views
        )
    assert load_unchecked(tmp_path / "two.npz").disparity_range == (-1.0, 2.0)


def test_written_arrays_are_read_back(tmp_path, views):
    light_field = LightField(
        views,
        disparity_range=(-1.0, 2.5),
        ground_truth=np.ones((20, 24), np.float32),
        positions=np.random.default_rng(0).normal(size=(3, 3, 2)).astype(np.float32),
    )
    write_arrays(tmp_path / "scene.npz", light_field)
    again = read_arrays(tmp_path / "scene.npz")
    np.testing.assert_array_equal(again.views, views)
    np.testing.assert_array_equal(again.ground_truth, light_field.ground_truth)
    np.testing.assert_array_equal(again.positions, light_field.positions)
    assert again.disparity_range == (-1.0, 2.5)


def test_order_and_flip_undo_how_the_files_are_stored(tmp_path, views):
    folder = save_views(tmp_path, views, lambda v, u: f"{u}_{2 - v}.png")
    loaded = load_unchecked(folder, order="uv", flip="v", name="mine")
    np.testing.assert_array_equal(loaded.views, views)
    assert loaded.name == "mine"


def test_progress_counts_the_views(tmp_path, views):
    calls = []
    load_unchecked(save_views(tmp_path, views, hci), progress=lambda *counts: calls.append(counts))
    assert calls == [(done, 9) for done in range(1, 10)]


def test_a_wrong_order_is_warned_about_with_the_right_options(tmp_path):
    views = two_planes()[0]
    swapped = Orientation(swap=True, flip_rows=True).apply(LightField(views)).views
    np.save(tmp_path / "scene.npy", swapped)
    with pytest.warns(ViewOrderWarning, match=r"scene\.npy.*pass order \(--order uv\)") as caught:
        load(tmp_path / "scene.npy")
    assert "\n" not in str(caught[0].message)
    assert "and flip (--flip u)" in str(caught[0].message)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        corrected = load(tmp_path / "scene.npy", order="uv", flip="u")
    np.testing.assert_array_equal(corrected.views, views)
    with pytest.warns(ViewOrderWarning, match=r"pass order \(--order uv\) and flip \(--flip u\)"):
        load(tmp_path / "scene.npy", order="vu", flip="u")


def test_of_two_equally_likely_orders_the_simpler_comes_first(tmp_path):
    """A slanted wall has no occlusion, so the sign of its disparity is unknown."""
    y = x = np.arange(80.0)
    columns = [[texture(y + 1.3 * v, x + 1.3 * u) for v in range(-2, 3)] for u in range(-2, 3)]
    np.save(tmp_path / "wall.npy", np.float32(columns))
    advice = r"pass order \(--order uv\) alone or pass order \(--order uv\) and flip \(--flip vu\)$"
    for flip in ("", "vu"):
        with pytest.warns(ViewOrderWarning, match=advice):
            load(tmp_path / "wall.npy", flip=flip)


def test_unrelated_views_are_warned_about(tmp_path):
    noise = np.random.default_rng(0).integers(0, 256, (5, 5, 64, 64, 1), np.uint8)
    np.save(tmp_path / "noise.npy", noise)
    with pytest.warns(ViewOrderWarning, match="no view order of the 5x5 grid is consistent"):
        load(tmp_path / "noise.npy")


@pytest.mark.slow
def test_real_folders_load_as_declared(shared):
    antinous = load(shared / "data/hci/antinous")
    assert antinous.views.shape == (9, 9, 512, 512, 3)
    assert antinous.ground_truth.shape == (512, 512)
    lytro = load(shared / "data/lytro/2067")
    assert lytro.views.shape == (9, 9, 383, 552, 3)
    assert lytro.name == "2067"


def test_a_warning_names_the_line_of_the_user(tmp_path, views):
    folder = save_views(tmp_path / "boxes", views, hci)
    (folder / hci(0, 0)).unlink()
    # In another process, where no check of annotations calls the functions of the package.
    code = f"import occjax\n\noccjax.load({str(folder)!r}, grid=(3, 3), check_orientation=False)\n"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stderr.startswith(
        f"<string>:3: GridWarning: {folder}: 1 of the 3x3 views is missing"
    )
