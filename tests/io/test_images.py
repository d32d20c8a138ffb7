import struct
import zlib

import hypothesis
import hypothesis.extra.numpy as arrays
import hypothesis.strategies as st
import numpy as np
import pytest
import tifffile
from PIL import Image

from occjax.errors import InputError
from occjax.io import read_image
from tests.io.files import png

RNG = np.random.default_rng(0)


def png16(image, filters=(0, 1, 2, 3, 4)):
    """Encode a 16-bit PNG as in RFC 2083, with each row filter in turn."""
    h, w, channels = image.shape
    samples = image.astype(">u2").view(np.uint8).reshape(h, -1).astype(int)
    step = 2 * channels
    rows = []
    for y in range(h):
        kind = filters[y % len(filters)]
        row = samples[y]
        up = samples[y - 1] if y else np.zeros_like(row)
        left = np.concatenate([np.zeros(step, int), row[:-step]])
        corner = np.concatenate([np.zeros(step, int), up[:-step]])
        estimate = left + up - corner
        a, b, c = abs(estimate - left), abs(estimate - up), abs(estimate - corner)
        paeth = np.where((a <= b) & (a <= c), left, np.where(b <= c, up, corner))
        prediction = [0, left, up, (left + up) // 2, paeth][kind]
        rows.append(bytes([kind]) + ((row - prediction) % 256).astype(np.uint8).tobytes())
    colour_type = {1: 0, 2: 4, 3: 2, 4: 6}[channels]
    header = struct.pack(">IIBBBBB", w, h, 16, colour_type, 0, 0, 0)
    compressed = zlib.compress(b"".join(rows))
    return png((b"IHDR", header), (b"IDAT", compressed[:9]), (b"IDAT", compressed[9:]))


@hypothesis.given(
    st.integers(1, 4).flatmap(
        lambda c: arrays.arrays(
            np.uint16, st.tuples(st.integers(1, 7), st.integers(1, 6), st.just(c))
        )
    )
)
@hypothesis.settings(max_examples=40)
def test_all_bits_of_a_16_bit_png_are_read(tmp_path_factory, image):
    path = tmp_path_factory.mktemp("png") / "image.png"
    path.write_bytes(png16(image))
    colours = 1 if image.shape[2] < 3 else 3
    result = read_image(path)
    assert result.dtype == np.uint16
    np.testing.assert_array_equal(result, image[..., :colours])


@pytest.mark.parametrize("mode", ["L", "LA", "RGB", "RGBA"])
def test_8_bit_png_is_read_without_its_alpha(tmp_path, mode):
    image = RNG.integers(0, 256, (5, 4, len(mode)), np.uint8)
    Image.fromarray(image.squeeze(-1) if mode == "L" else image).save(tmp_path / "image.png")
    colours = 1 if len(mode) < 3 else 3
    np.testing.assert_array_equal(read_image(tmp_path / "image.png"), image[..., :colours])


def test_palettes_and_bitmaps_become_plain_images(tmp_path):
    palette = Image.fromarray(np.uint8([[0, 1]])).convert("P")
    palette.putpalette([255, 0, 0, 0, 0, 255] + [0] * 762)
    palette.save(tmp_path / "palette.png")
    assert read_image(tmp_path / "palette.png").tolist() == [[[255, 0, 0], [0, 0, 255]]]
    Image.fromarray(np.array([[True, False]])).save(tmp_path / "bits.png")
    assert read_image(tmp_path / "bits.png").tolist() == [[[255], [0]]]


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize("compression", [None, "zlib", "lzw"])
@pytest.mark.parametrize("planes", ["contig", "separate"])
def test_tiff_of_any_depth_is_read(tmp_path, dtype, channels, compression, planes):
    image = (RNG.random((6, 5, channels)) * (1 if dtype == np.float32 else 255)).astype(dtype)
    stored = image[..., 0] if channels == 1 else image
    options = {"photometric": "rgb", "planarconfig": planes} if channels > 1 else {}
    if channels > 1 and planes == "separate":
        stored = np.moveaxis(stored, -1, 0)
    if channels == 4:
        options["extrasamples"] = ["unassalpha"]
    tifffile.imwrite(tmp_path / "image.tif", stored, compression=compression, **options)
    result = read_image(tmp_path / "image.tif")
    assert result.dtype == dtype
    np.testing.assert_array_equal(result, image[..., : 1 if channels == 1 else 3])


def test_jpeg_is_read_nearly_as_written(tmp_path):
    y, x = np.mgrid[:32, :32]
    image = np.stack([4 * y, 4 * x, 2 * (x + y)], axis=-1).astype(np.uint8)
    Image.fromarray(image).save(tmp_path / "image.jpg", quality=95)
    assert abs(read_image(tmp_path / "image.jpg").astype(int) - image).max() < 12


@pytest.mark.parametrize("suffix", ["png", "bmp", "tif"])
def test_mosaics_beyond_the_limit_of_pillow_are_read(tmp_path, monkeypatch, suffix):
    """The limit is lowered for the test, since an image of 300 megapixels takes long."""
    image = RNG.integers(0, 256, (40, 30, 3), np.uint8)
    path = tmp_path / f"large.{suffix}"
    Image.fromarray(image).save(path)
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 100)
    np.testing.assert_array_equal(read_image(path), image)
    assert Image.MAX_IMAGE_PIXELS == 100


@pytest.mark.parametrize("suffix", ["png", "jpg", "bmp", "tif"])
def test_truncated_images_are_refused(tmp_path, suffix):
    path = tmp_path / f"image.{suffix}"
    Image.fromarray(RNG.integers(0, 256, (40, 30, 3), np.uint8)).save(path)
    limit = Image.MAX_IMAGE_PIXELS
    data = path.read_bytes()
    for length in (0, 10, len(data) // 2, len(data) - 50):
        path.write_bytes(data[:length])
        with pytest.raises(InputError, match=f"image.{suffix}: cannot be decoded as an image"):
            read_image(path)
    assert Image.MAX_IMAGE_PIXELS == limit is not None
