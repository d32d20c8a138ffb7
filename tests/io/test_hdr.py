"""EXR, Radiance and TIFF files of floating point values, as views and as maps."""

import sys

import imagecodecs
import numpy as np
import pytest
import tifffile

from occjax.errors import InputError
from occjax.io import join_tiles, load, read_image, read_map
from tests.io.files import hci, save_views
from tests.io.scenes import two_planes

pytestmark = pytest.mark.filterwarnings("ignore::occjax.io.GridWarning")

VIEWS = (50.0 * two_planes((3, 3), (40, 48))[0] ** 3).astype(np.float32)


def write_exr(path, channels):
    exr = pytest.importorskip("OpenEXR")
    header = {"compression": exr.ZIP_COMPRESSION, "type": exr.scanlineimage}
    with exr.File(header, channels) as file:
        file.write(str(path))
    return path


def write_tiff(path, image):
    tifffile.imwrite(path, image, photometric="rgb")


def write_hdr(path, image):
    path.write_bytes(imagecodecs.rgbe_encode(image))


@pytest.mark.parametrize(
    ("suffix", "write"),
    [
        (".exr", lambda path, image: write_exr(path, {"RGB": image})),
        (".hdr", write_hdr),
        (".tif", write_tiff),
    ],
)
def test_views_of_high_dynamic_range_are_tone_mapped_and_told(tmp_path, suffix, write):
    for v, u in np.ndindex(3, 3):
        write(tmp_path / f"a_{v}_{u}{suffix}", VIEWS[v, u])
    with pytest.warns(UserWarning, match="tone-mapped by a mu-law with white at"):
        light_field = load(tmp_path)
    white = np.percentile(VIEWS, 99.9)
    expected = np.log1p(5000 * np.clip(VIEWS / white, 0, 1)) / np.log1p(5000)
    mean_difference = np.abs(light_field.views - expected).mean()
    assert mean_difference < (0.01 if suffix == ".hdr" else 1e-5)  # RGBE has 8 bits of precision
    assert not light_field.view_order_report.clearly_worse


@pytest.mark.parametrize(("dtype", "white", "bits"), [(np.uint8, 235, 8), (np.uint16, 4095, 16)])
def test_integers_stored_as_floating_point_are_read_as_integers(tmp_path, dtype, white, bits):
    views = np.round(white * two_planes((3, 3), (40, 48))[0]).astype(dtype)
    for v, u in np.ndindex(3, 3):
        write_tiff(tmp_path / f"a_{v}_{u}.tif", views[v, u].astype(np.float32))
    with pytest.warns(UserWarning, match=f"whole numbers .* read as {bits} bits"):
        read = load(tmp_path).views
    np.testing.assert_array_equal(read, views)
    assert read.dtype == dtype


def test_a_mosaic_of_high_dynamic_range_is_tone_mapped(tmp_path):
    write_tiff(tmp_path / "all.tif", join_tiles(VIEWS))
    with pytest.warns(UserWarning, match="tone-mapped"):
        views = load(tmp_path / "all.tif", grid=(3, 3), layout="tiled").views
    assert views.max() == 1.0


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_maps_of_floating_point_values(tmp_path, dtype):
    values = np.random.default_rng(0).normal(size=(20, 24)).astype(dtype)
    tifffile.imwrite(tmp_path / "truth.tif", values)
    np.testing.assert_array_equal(read_map(tmp_path / "truth.tif").values, values)
    write_exr(tmp_path / "depth.exr", {"Z": values})
    assert read_map(tmp_path / "depth.exr").quantity == "depth"
    np.testing.assert_array_equal(read_map(tmp_path / "depth.exr").values, values)


def test_depth_maps_next_to_the_views_are_no_views(tmp_path):
    views = np.round(VIEWS / VIEWS.max() * 255).astype(np.uint8)
    save_views(tmp_path, views, hci)
    (tmp_path / "input_Cam000.exr").touch()
    np.testing.assert_array_equal(load(tmp_path, check_orientation=False).views, views)


def test_other_channels_and_integer_maps_are_refused(tmp_path):
    zeros = np.zeros((4, 4), np.float32)
    tifffile.imwrite(tmp_path / "codes.tif", zeros.astype(np.uint16))
    with pytest.raises(InputError, match="holds uint16 codes; save the map as 32-bit floats"):
        read_map(tmp_path / "codes.tif")
    write_exr(tmp_path / "normal.exr", {"X": zeros, "Y": zeros})
    with pytest.raises(InputError, match="has the channels X, Y; save it with R, G and B"):
        read_image(tmp_path / "normal.exr")


def test_a_missing_openexr_is_reported_with_the_install_command(tmp_path, monkeypatch):
    (tmp_path / "view.exr").write_bytes(b"v/1\x01")
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    with pytest.raises(InputError, match=r"needs OpenEXR; run pip install 'occjax\[exr\]'"):
        read_image(tmp_path / "view.exr")
