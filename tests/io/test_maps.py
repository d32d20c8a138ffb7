"""Maps in every format, against files written by the formats' definitions."""

import struct

import numpy as np
import pytest
from PIL import Image

from occjax.errors import InputError
from occjax.io.maps import Map, read_map, write_map, write_normals

VALUES = np.array([[0.5, -1.5, np.nan], [np.inf, 2.25, 3.0]], np.float32)


def bottom_up(order):
    """Return ``VALUES`` in the order of a PFM file: the last row first."""
    return struct.pack(f"{order}6f", np.inf, 2.25, 3.0, 0.5, -1.5, np.nan)


@pytest.mark.parametrize(("order", "scale"), [("<", b"-1.0"), (">", b"1.0")])
def test_a_pfm_of_either_byte_order_becomes_an_npy_with_the_top_row_first(tmp_path, order, scale):
    (tmp_path / "map.pfm").write_bytes(b"Pf\n3 2\n" + scale + b"\n" + bottom_up(order))
    assert write_map(tmp_path / "map.npy", read_map(tmp_path / "map.pfm")) == 0.0
    array = np.load(tmp_path / "map.npy")
    assert array.dtype == np.float32
    np.testing.assert_array_equal(array, VALUES)


@pytest.mark.parametrize("dtype", ["float16", "<f4", ">f4", "float64"])
def test_an_npy_of_any_float_becomes_a_little_endian_pfm_bottom_up(tmp_path, dtype):
    np.save(tmp_path / "map.npy", np.asfortranarray(VALUES.astype(dtype)))
    write_map(tmp_path / "map.pfm", read_map(tmp_path / "map.npy"))
    assert (tmp_path / "map.pfm").read_bytes() == b"Pf\n3 2\n-1.0\n" + bottom_up("<")


@pytest.mark.parametrize("suffix", [".pfm", ".npy", ".png", ".PFM", ".NPY", ".PNG"])
@pytest.mark.parametrize("quantity", ["disparity", "depth"])
def test_every_format_is_read_back(tmp_path, suffix, quantity):
    path = tmp_path / f"map{suffix}"
    precision = write_map(path, Map(VALUES, quantity))
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]
    again = read_map(path, quantity=quantity)
    assert again.quantity == quantity
    np.testing.assert_allclose(again.values, VALUES, rtol=0, atol=1.001 * precision)
    assert (precision > 0) == (suffix.lower() == ".png")


@pytest.mark.parametrize(
    ("name", "quantity"),
    [
        ("disparity.npy", "disparity"),
        ("estimate.npy", "disparity"),
        ("depth.npy", "depth"),
        ("gt_depth_lowres.npy", "depth"),
        ("Depth.npy", "depth"),
    ],
)
def test_other_files_hold_the_quantity_in_their_name(tmp_path, name, quantity):
    np.save(tmp_path / name, VALUES)
    assert read_map(tmp_path / name).quantity == quantity
    assert read_map(tmp_path / name, quantity="depth").quantity == "depth"
    assert read_map(tmp_path / name, quantity="disparity").quantity == "disparity"


def test_a_png_states_its_quantity(tmp_path):
    write_map(tmp_path / "depth.png", Map(VALUES, "disparity"))
    assert read_map(tmp_path / "depth.png").quantity == "disparity"
    with pytest.raises(InputError, match="states that it holds disparity, not depth"):
        read_map(tmp_path / "depth.png", quantity="depth")


def test_of_a_folder_of_results_the_disparity_is_read(tmp_path):
    write_map(tmp_path / "disparity.pfm", Map(VALUES, "disparity"))
    np.testing.assert_array_equal(read_map(tmp_path).values, VALUES)
    (tmp_path / "disparity.pfm").unlink()
    with pytest.raises(InputError, match=r"no disparity\.pfm; pass a folder .* or a \.pfm, \.npy"):
        read_map(tmp_path)


@pytest.mark.parametrize(
    ("scenes", "message"),
    [("a", r"of one scene; pass .*/a$"), ("ab", r"of 2 scenes \(a, b\); pass .*, such as .*/a$")],
)
def test_in_a_folder_of_several_results_they_are_named(tmp_path, scenes, message):
    for name in scenes:
        (tmp_path / name).mkdir()
        write_map(tmp_path / name / "disparity.pfm", Map(VALUES, "disparity"))
    with pytest.raises(InputError, match=message):
        read_map(tmp_path)


@pytest.mark.parametrize(
    ("name", "write", "options", "reason"),
    [
        ("map.txt", lambda path: path.write_text("1 2"), {}, r"\.npy, \.png, \.tif or \.exr"),
        ("map", lambda path: path.write_text("1 2"), {}, r"\.npy, \.png, \.tif or \.exr"),
        ("map.npz", lambda path: np.savez(path, VALUES), {}, r"save the map alone, as a \.npy"),
        ("map.npy", lambda path: np.save(path, np.zeros((2, 2, 3))), {}, r"\[2, 2, 3\], not a map"),
        ("map.npy", lambda path: np.save(path, np.zeros((0, 3))), {}, r"\[0, 3\], not a map"),
        ("map.npy", lambda path: np.save(path, VALUES), {"scale": 2.0}, "only to a PNG"),
        ("map.npy", lambda path: np.save(path, VALUES), {"offset": 2.0}, "only to a PNG"),
        ("map.npy", lambda path: np.save(path, VALUES > 0), {}, "real numbers"),
        ("map.npy", lambda path: path.write_text("text"), {}, "cannot be decoded as a NumPy file"),
        ("map.png", lambda path: path.write_text("text"), {}, "cannot be decoded as an image"),
    ],
)
def test_other_files_are_refused_in_one_line(tmp_path, name, write, options, reason):
    write(tmp_path / name)
    with pytest.raises(InputError, match=reason) as error:
        read_map(tmp_path / name, **options)
    assert str(tmp_path / name) in str(error.value)
    assert "\n" not in str(error.value)


def test_other_suffixes_are_not_written(tmp_path):
    with pytest.raises(InputError, match=r"must end in \.pfm, \.npy, \.png"):
        write_map(tmp_path / "map.tif", Map(VALUES, "depth"))
    with pytest.raises(InputError, match=r"must be \[H, W, 3\]"):
        write_normals(tmp_path / "normals.png", VALUES)
    assert not list(tmp_path.iterdir())


NORMALS = np.array([[[1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, -0.6, 0.8], [-1, 0, 0], [np.nan] * 3]])


def test_normals_have_the_usual_colours(tmp_path):
    write_normals(tmp_path / "normals.png", NORMALS)
    with Image.open(tmp_path / "normals.png") as image:
        assert image.mode == "RGB"
        colours = np.asarray(image).tolist()
    # 127.5 (n + 1), rounded; -0.6 is 51 and 0.8 is 229.5.
    assert colours[0] == [[255, 128, 128], [128, 255, 128], [128, 128, 255]]
    assert colours[1] == [[128, 51, 230], [0, 128, 128], [0, 0, 0]]


def test_normals_are_kept_as_floats(tmp_path):
    write_normals(tmp_path / "normals.npy", NORMALS)
    np.testing.assert_array_equal(np.load(tmp_path / "normals.npy"), NORMALS.astype(np.float32))
    write_normals(tmp_path / "normals.pfm", NORMALS)
    header, body = (tmp_path / "normals.pfm").read_bytes().split(b"-1.0\n")
    assert header == b"PF\n3 2\n"
    top_row = np.frombuffer(body, "<f4").reshape(2, 3, 3)[1]
    np.testing.assert_array_equal(top_row, NORMALS[0])


def test_a_missing_folder_of_results_is_named_as_missing(tmp_path):
    with pytest.raises(InputError, match="scene: there is no such file or folder"):
        read_map(tmp_path / "scene")
