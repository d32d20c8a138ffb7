"""HDF5 and .mat files: the order of axes, the camera, and the choice among several arrays."""

import sys
import warnings

import h5py
import numpy as np
import pytest
import scipy.io

from occjax.errors import InputError
from occjax.io import GridWarning, join_tiles, load, read_pfm
from occjax.io.matlab import read_mat_arrays
from tests.io.scenes import two_planes

VIEWS = np.round(two_planes((3, 5), (40, 48))[0] * 255).astype(np.uint8)
CAMERA = {"dH": [0.02], "focalLength": 600.0, "camDistance": 4.0}


def load_unchecked(path, **options):
    return load(path, check_orientation=False, **options)


def write(path, arrays, attributes=None, userblock=0):
    with h5py.File(path, "w", userblock_size=userblock) as file:
        for name, array in arrays.items():
            file[name] = array
        file.attrs.update(attributes or {})
    return path


@pytest.mark.filterwarnings("ignore::occjax.io.GridWarning")
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("version", ["7", "7.3"])
@pytest.mark.parametrize("order", ["VUHWC", "HWVUC", "HWCVU", "VUCHW", "CHWVU"])
def test_axes_of_mat_files_are_found(tmp_path, version, order, channels):
    views = VIEWS[..., :channels]
    array = views.transpose(["VUHWC".index(letter) for letter in order])
    if channels == 1:
        array = array.squeeze(order.index("C"))
    if version == "7":
        scipy.io.savemat(tmp_path / "scene.mat", {"light": array, "name": "scene"})
    else:
        write(tmp_path / "scene.mat", {"light": array.T, "#refs#/a": VIEWS}, userblock=512)
    np.testing.assert_array_equal(load_unchecked(tmp_path / "scene.mat").views, views)


def test_axes_of_hdf5_of_matlab_are_reversed_and_told(tmp_path):
    path = write(tmp_path / "scene.h5", {"light": VIEWS.T})
    with pytest.warns(GridWarning, match=r"light is .*, read as \[C, W, H, U, V\]"):
        np.testing.assert_array_equal(load_unchecked(path).views, VIEWS)


@pytest.mark.filterwarnings("ignore::occjax.io.GridWarning")
@pytest.mark.parametrize("place", ["group", "group/light"])
@pytest.mark.parametrize("axes", ["y:x:v:u:c", [b"y", b"x", b"v", b"u", b"c"]])
def test_named_axes_are_obeyed(tmp_path, place, axes):
    path = write(tmp_path / "scene.h5", {"group/light": VIEWS.transpose(2, 3, 0, 1, 4)})
    with h5py.File(path, "a") as file:
        file[place].attrs["axes"] = axes
    np.testing.assert_array_equal(load_unchecked(path).views, VIEWS)


@pytest.mark.parametrize("name", ["group.h5", "superresolution.h5", "depth_with_holes.h5"])
@pytest.mark.parametrize("grid", [None, (3, 3)])
def test_files_of_other_projects(shared, name, grid):
    folder = shared / "data/cases/hdf5"
    light_field = load(folder / name, grid=grid)
    truth = read_pfm(folder / "truth.pfm")
    assert light_field.grid == (3, 3)
    assert light_field.image_size == truth.shape
    report = light_field.view_order_report
    assert not report.clearly_worse
    assert report.disparity_range[0] <= truth.min()
    assert report.disparity_range[1] >= truth.max()


def test_holes_in_depth_are_masked(shared, tolerance):
    folder = shared / "data/cases/hdf5"
    disparity = load_unchecked(folder / "depth_with_holes.h5").ground_truth
    assert np.isnan(disparity).sum() == 9
    visible = np.isfinite(disparity)
    np.testing.assert_allclose(
        disparity[visible], read_pfm(folder / "truth.pfm")[visible], **tolerance("amplified")
    )


@pytest.mark.parametrize(
    ("attributes", "shift"),
    [
        (CAMERA, 0.02 * 600 / 4.0),
        ({**CAMERA, "shift": [2.5]}, 2.5),
        ({**CAMERA, "shift": 0.0}, 0.0),
        ({"dH": 0.02, "focalLength": 600.0, "shift": -1.5}, -1.5),
    ],
)
@pytest.mark.parametrize("stored", ["grid", "centre", "matlab"])
def test_old_hci_files_have_disparity_from_depth(tmp_path, attributes, shift, stored, tolerance):
    depth = np.linspace(2.0, 6.0, 40 * 48).reshape(40, 48)
    arrays = {"LF": VIEWS, "GT_DEPTH": depth}
    if stored == "grid":
        arrays["GT_DEPTH"] = np.broadcast_to(depth, (3, 5, 40, 48))
    if stored == "matlab":
        arrays = {name: array.T for name, array in arrays.items()}
    path = write(tmp_path / "buddha.h5", arrays, attributes)
    if stored == "matlab":
        with pytest.warns(GridWarning, match=r"\[3, 48, 40, 5, 3\], read as \[C, W, H, U, V\]"):
            light_field = load_unchecked(path)
    else:
        light_field = load_unchecked(path)
    np.testing.assert_array_equal(light_field.views, VIEWS)
    np.testing.assert_allclose(
        light_field.ground_truth, 0.02 * 600 / depth - shift, **tolerance("absolute")
    )
    again = light_field.calibration.depth(light_field.ground_truth, light_field.image_size)
    np.testing.assert_allclose(again, depth, **tolerance("relative"))


@pytest.mark.parametrize("hole", [0.0, -1.0, np.inf, np.nan, 1e10, 1e30])
def test_holes_of_the_depth_are_no_truth(tmp_path, hole):
    depth = np.full((40, 48), 3.0)
    depth[3:5, 7:9] = hole
    path = write(tmp_path / "buddha.h5", {"LF": VIEWS, "GT_DEPTH": depth}, CAMERA)
    np.testing.assert_array_equal(np.isnan(load_unchecked(path).ground_truth), depth != 3.0)


def test_missing_attributes_are_named(tmp_path):
    arrays = {"LF": VIEWS, "GT_DEPTH": np.ones((40, 48))}
    path = write(tmp_path / "buddha.h5", arrays, {"dH": 0.1})
    with pytest.warns(UserWarning, match=r"no attribute focalLength and shift \(or camDistance\)"):
        light_field = load_unchecked(path)
    assert light_field.calibration is None
    assert light_field.ground_truth is None


def test_depth_is_transposed_together_with_tiles(tmp_path, tolerance):
    depth = np.linspace(2.0, 6.0, 40 * 48).reshape(40, 48)
    tiles = join_tiles(VIEWS[..., :1])[..., 0]
    path = write(tmp_path / "a.h5", {"Hr_SAI_y": tiles.T, "GT_DEPTH": depth.T}, CAMERA)
    light_field = load_unchecked(path, grid=(3, 5))
    np.testing.assert_allclose(
        light_field.ground_truth, 0.02 * 600 / depth - 3.0, **tolerance("absolute")
    )


def test_tiles_of_superresolution_sets_are_transposed(tmp_path):
    grey = VIEWS[..., :1]
    path = write(tmp_path / "a.h5", {"Hr_SAI_y": join_tiles(grey)[..., 0].T, "Lr_SAI_y": [[1.0]]})
    np.testing.assert_array_equal(load_unchecked(path).views, grey)


def test_the_key_chooses_among_arrays(tmp_path):
    arrays = {"a/left": VIEWS, "a/right": VIEWS[::-1], "weights": np.ones((3, 2))}
    path = write(tmp_path / "scene.h5", arrays)
    content = r"\(it has: a/left \[3, 5, 40, 48, 3\], a/right .*, weights \[3, 2\]\); pass key"
    with pytest.raises(InputError, match=f"has several arrays of views {content}"):
        load(path)
    with pytest.raises(InputError, match=f"has no array 'LF' {content}"):
        load(path, key="LF")
    for key in ("right", "a/right"):
        np.testing.assert_array_equal(load_unchecked(path, key=key).views, VIEWS[::-1])


def test_implausible_shapes_are_refused_with_the_axes_named(tmp_path):
    path = write(tmp_path / "scene.h5", {"LF": np.zeros((9, 9, 6, 6, 6))})
    with pytest.raises(InputError, match=r"no order of the axes V, U \(views\), H, W \(pixels\)"):
        load(path)
    np.save(tmp_path / "scene.npy", np.zeros((3, 80, 64, 3, 3), np.uint8))
    with pytest.raises(InputError, match=r"looks like \[C, H, W, V, U\]; transpose it"):
        load(tmp_path / "scene.npy")


@pytest.mark.parametrize("channels", [1, 3])
def test_stacked_views_need_the_grid(tmp_path, channels):
    stack = VIEWS[..., :channels].reshape(15, 40, 48, channels)
    stack = stack[..., 0] if channels == 1 else stack
    np.save(tmp_path / "scene.npy", stack)
    np.savez(tmp_path / "scene.npz", views=stack)
    scipy.io.savemat(tmp_path / "scene.mat", {"light": stack})
    write(tmp_path / "scene.h5", {"light": stack})
    for suffix in (".npy", ".npz", ".mat", ".h5"):
        path = tmp_path / f"scene{suffix}"
        with pytest.raises(InputError, match=r"pass grid \(--grid V U\)"):
            load_unchecked(path)
        np.testing.assert_array_equal(
            load_unchecked(path, grid=(3, 5)).views, VIEWS[..., :channels]
        )
        with pytest.raises(InputError, match="views have the shape"):
            load_unchecked(path, grid=(4, 4))


def test_the_only_array_may_be_tiled(tmp_path):
    write(tmp_path / "scene.h5", {"image": join_tiles(VIEWS[..., :1])[..., 0]})
    loaded = load_unchecked(tmp_path / "scene.h5", grid=(3, 5))
    np.testing.assert_array_equal(loaded.views, VIEWS[..., :1])


def test_a_missing_h5py_is_reported_with_the_install_command(tmp_path, monkeypatch):
    (tmp_path / "buddha.h5").touch()
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(InputError, match=r"buddha\.h5.*pip install 'occjax\[published\]'"):
        load(tmp_path / "buddha.h5")


@pytest.mark.parametrize("compressed", [False, True])
def test_numeric_arrays_of_mat_files_are_those_that_scipy_reads(tmp_path, compressed):
    kinds = (*(f"{sign}{size}" for sign in "iu" for size in (1, 2, 4, 8)), "f4", "f8", "?")
    arrays = {f"a{n}": (VIEWS[..., 0] % 99).astype(kind) for n, kind in enumerate(kinds)}
    others = {"text": "a", "complex": np.eye(2) * 1j, "structure": {"x": 1}}
    scipy.io.savemat(tmp_path / "a.mat", arrays | others, do_compression=compressed)
    expected, found = scipy.io.loadmat(tmp_path / "a.mat"), read_mat_arrays(tmp_path / "a.mat")
    assert set(found) == set(arrays)
    for name, array in found.items():
        assert array.dtype == expected[name].dtype
        np.testing.assert_array_equal(array, expected[name])


@pytest.mark.parametrize(("order", "told"), [("UVWHC", True), ("VUHWC", False)])
def test_images_that_may_lie_on_their_side_are_told(tmp_path, order, told):
    """A light field whose rows and columns are all exchanged is as consistent."""
    axes = ["VUHWC".index(letter) for letter in order]
    scipy.io.savemat(tmp_path / "scene.mat", {"LF": VIEWS.transpose(axes)})
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        load(tmp_path / "scene.mat", check_orientation=False)
    messages = [str(warning.message) for warning in caught]
    assert ["if they lie on their side, it is [U, V, W, H, C]" in m for m in messages] == [
        True
    ] * told
