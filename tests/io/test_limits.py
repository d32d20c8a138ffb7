"""Files that claim more than they hold, and paths that are no regular files."""

import os
import struct
import zipfile
import zlib

import h5py
import numpy as np
import OpenEXR
import pytest
import tifffile
from PIL import Image

from occjax.errors import InputError
from occjax.io import load, read_arrays, read_image, read_pfm
from occjax.io.arrays import check_positions, check_views
from occjax.io.containers import read_container
from occjax.io.limits import ReadLimits
from occjax.io.naming import find_views
from tests.io import files
from tests.io.files import CONFIG, hci, npy_header, save_views

VIEWS = np.random.default_rng(0).integers(0, 256, (3, 3, 8, 10, 3), np.uint8)


def png(path, width, height):
    """Write the header of a grey PNG, and one row."""
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    row = zlib.compress(bytes(width + 1))
    path.write_bytes(files.png((b"IHDR", header), (b"IDAT", row)))


def jpeg(path, width, height):
    """Write a small JPEG, and replace the size in its header."""
    Image.fromarray(VIEWS[0, 0]).save(path)
    data = path.read_bytes()
    place = data.index(b"\xff\xc0") + 5  # after the marker, the length and the bits per sample
    path.write_bytes(data[:place] + struct.pack(">HH", height, width) + data[place + 4 :])


def bmp(path, width, height):
    Image.fromarray(VIEWS[0, 0]).save(path)
    data = path.read_bytes()
    path.write_bytes(data[:18] + struct.pack("<ii", width, height) + data[26:])  # of the header


def tiff(path, width, height):
    tifffile.imwrite(path, VIEWS[0, 0, ..., 0], photometric="minisblack")
    with tifffile.TiffFile(path, mode="r+b") as file:
        file.pages[0].tags["ImageWidth"].overwrite(width)
        file.pages[0].tags["ImageLength"].overwrite(height)
        file.pages[0].tags["RowsPerStrip"].overwrite(height)


def exr(path, width, height):
    planes = {"Y": np.zeros((4, 4), np.float32)}
    OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION}, planes).write(str(path))
    data = path.read_bytes()
    window = struct.pack("<4i", 0, 0, 3, 3)
    assert data.count(window) == 2  # data window and display window
    path.write_bytes(data.replace(window, struct.pack("<4i", 0, 0, width - 1, height - 1)))


def radiance(path, width, height):
    path.write_bytes(b"#?RADIANCE\n\n-Y %d +X %d\n" % (height, width) + bytes(16))


@pytest.mark.parametrize("write", [png, jpeg, bmp, tiff, exr, radiance])
@pytest.mark.parametrize(
    ("width", "height", "message"),
    [
        pytest.param(26947, 17232, "OCCJAX_MAX_IMAGE_PIXELS", id="above the limit"),
        pytest.param(16000, 10000, "which is damaged", id="too many for the size of the file"),
    ],
)
def test_an_image_of_false_size_is_refused_by_its_header(
    tmp_path, monkeypatch, write, width, height, message
):
    path = tmp_path / f"a.{'hdr' if write is radiance else write.__name__}"
    write(path, width, height)
    monkeypatch.setattr(np, "empty", None)  # decoders call it; the header is refused before
    with pytest.raises(InputError, match=f"claims .*{message}"):
        read_image(path)


def test_the_limit_can_be_set(tmp_path, monkeypatch):
    path = tmp_path / "a.png"
    Image.fromarray(VIEWS[0, 0]).save(path)
    monkeypatch.setenv("OCCJAX_MAX_IMAGE_PIXELS", "80")
    assert read_image(path).shape == (8, 10, 3)
    monkeypatch.setenv("OCCJAX_MAX_IMAGE_PIXELS", "79")
    with pytest.raises(InputError, match="10x8 pixels, more than the limit of 79"):
        read_image(path)
    monkeypatch.setenv("OCCJAX_MAX_IMAGE_PIXELS", "many")
    with pytest.raises(InputError, match="OCCJAX_MAX_IMAGE_PIXELS is 'many'"):
        read_image(path)


def test_the_limit_holds_for_all_views_of_a_folder_together(tmp_path, monkeypatch):
    folder = save_views(tmp_path / "boxes", VIEWS, hci)
    (folder / "parameters.cfg").write_text(CONFIG)
    monkeypatch.setenv("OCCJAX_MAX_LIGHT_FIELD_BYTES", str(VIEWS.nbytes - 1))
    with pytest.raises(InputError, match=r"boxes: claims .*OCCJAX_MAX_LIGHT_FIELD_BYTES"):
        load(folder, check_orientation=False)


def test_archives_that_unpack_to_more_than_the_limit_are_refused(tmp_path):
    path = tmp_path / "a.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("views.npy", npy_header((9, 9, 4000, 4000, 3)))
    with pytest.raises(InputError, match=r"claims 3.89 GB of data, more than the limit of 2.15 GB"):
        read_arrays(path)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        # 61 MB each, which is allowed in any file, but not 122 MB in this one.
        header = npy_header((9, 9, 250, 1000, 3))
        archive.writestr("views.npy", header + bytes(9 * 9 * 250 * 1000 * 3))
        archive.writestr("usable.npy", header)
    with pytest.raises(InputError, match=r"GB of data in a file of .* bytes"):
        read_arrays(path)


def test_chunked_arrays_without_chunks_are_refused(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("LF", (9, 9, 1000, 1000, 3), "u1", chunks=(1, 1, 100, 100, 3))
    with pytest.raises(InputError, match=r"GB of data in a file of .* bytes"):
        read_container(tmp_path / "a.h5")


def test_arrays_in_other_files_are_refused(tmp_path):
    (tmp_path / "other").write_bytes(VIEWS.tobytes())
    with h5py.File(tmp_path / "a.h5", "w") as file:
        external = [(str(tmp_path / "other"), 0, VIEWS.nbytes)]
        file.create_dataset("LF", VIEWS.shape, "u1", external=external)
    with pytest.raises(InputError, match="stored in another file"):
        read_container(tmp_path / "a.h5")


def test_a_heap_with_an_object_of_no_size_is_refused(tmp_path):
    """The HDF5 library would loop forever."""
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["LF"] = VIEWS
        file["LF"].attrs["axes"] = "v:u:y:x:c"  # of variable length
    data = path.read_bytes()
    first = data.index(b"GCOL") + 16
    rest = first + 32  # after the text, which takes 16 + 16 bytes
    assert struct.unpack_from("<H6xQ", data, rest) == (0, 4096 - 48)
    path.write_bytes(data[: rest + 8] + bytes(8) + data[rest + 16 :])
    with pytest.raises(InputError, match="an object of a heap has an impossible size"):
        read_container(path)


def pipe(path):
    os.mkfifo(path)


@pytest.mark.parametrize(
    "make", [pipe, lambda path: path.symlink_to("/dev/zero"), lambda path: path.symlink_to("/proc")]
)
@pytest.mark.parametrize("name", ["a.pfm", "a.npz", "a.png", "a.h5", "a.mat"])
def test_only_regular_files_are_opened(tmp_path, make, name):
    make(tmp_path / name)
    reader = read_pfm if name == "a.pfm" else load
    options = {"grid": (2, 2)} if name == "a.png" else {}
    with pytest.raises(InputError, match=r"is a pipe or a device|folder|no images"):
        reader(tmp_path / name, **options)


@pytest.mark.parametrize("digits", [5, 5000])
def test_a_header_of_many_digits_is_refused(tmp_path, digits):
    path = tmp_path / "a.pfm"
    path.write_bytes(b"Pf\n%s 1\n-1.0\n1234" % (b"1" * digits))
    with pytest.raises(InputError, match=r"a\.pfm: "):
        read_pfm(path)


@pytest.mark.parametrize(
    ("names", "grid", "words"),
    [
        ([f"input_Cam{i:03d}.png" for i in range(9)], (3000, 3000), "has 9 of the 3000x3000 views"),
        ([f"input_Cam{i:03d}.png" for i in range(9)], (1, 10**308), "has 9 of the 1x1.00e"),
        (["input_Cam000.png", "input_Cam99999999.png"], None, "2 views up to"),
        ([f"out_0_{u}_1.0_{u}.0_.png" for u in (0, 1, 10**12)], None, "has 3 of the 1x1.00e"),
        ([f"v{i}_u{i}.png" for i in range(60)], None, "has 60 of the 60x60 views"),
    ],
)
def test_a_grid_of_far_more_views_than_files_is_refused(names, grid, words):
    pattern = "v{v}_u{u}.png" if names[0] == "v0_u0.png" else None
    with pytest.raises(InputError, match=f"folder: {words}"):
        find_views("folder", names, grid=grid, pattern=pattern)


def test_a_camera_file_cannot_claim_endless_views(tmp_path):
    folder = save_views(tmp_path / "boxes", VIEWS, hci)
    (folder / "parameters.cfg").write_text(CONFIG.replace("cams_x = 3", "cams_x = 1e308"))
    with pytest.raises(InputError, match=r"boxes: has 9 of the 3x1\.00e\+308"):
        load(folder)


@pytest.mark.parametrize("dtype", [">u2", "<u2", "u1"])
def test_either_byte_order_is_read(tmp_path, dtype):
    expected = VIEWS.astype(dtype)
    np.save(tmp_path / "a.npy", expected)
    for views in (read_arrays(tmp_path / "a.npy").views, check_views(tmp_path, expected)):
        assert views.dtype.isnative
        np.testing.assert_array_equal(views, expected)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300])
def test_positions_that_are_not_finite_are_refused(tmp_path, value):
    positions = np.stack(np.mgrid[:3, :3], axis=-1).astype(float)
    positions[1, 2, 0] = value
    with pytest.raises(InputError, match="positions are NaN, infinite or too large"):
        check_positions(tmp_path, positions, (3, 3))


def test_default_limits_admit_known_light_fields():
    """17x17 views of 1024x1024 pixels in colour, in one image and in one file."""
    limits = ReadLimits()
    assert limits.light_field_bytes > 17 * 17 * 1024**2 * 3
    assert limits.image_pixels > 9 * 9 * 1024**2
