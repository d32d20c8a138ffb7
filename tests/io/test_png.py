"""PNG files of values, checked by the text that they store and by the format's definition."""

import struct
import zlib

import numpy as np
import pytest
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from occjax.errors import InputError
from occjax.io.png import read_value_png, write_value_png

VALUES = np.random.default_rng(0).uniform(-3.5, 4.25, (7, 9))
VALUES[2, 3], VALUES[4, 5], VALUES[6, 0] = np.nan, np.inf, -np.inf


def write(path, values=VALUES):
    return write_value_png(path, values, quantity="disparity", unit="pixels per view step")


def test_values_are_read_back_within_the_stated_precision(tmp_path):
    precision = write(tmp_path / "map.png")
    finite = np.isfinite(VALUES)
    # Half of one of the 65533 steps from the least to the greatest value.
    assert precision == pytest.approx(0.5 * np.ptp(VALUES[finite]) / 65533)
    values, quantity = read_value_png(tmp_path / "map.png")
    error = np.abs(values[finite] - VALUES[finite])
    assert 0.9 * precision < error.max() <= precision * (1 + 1e-9)
    assert quantity == "disparity"


def test_infinity_and_no_value_are_kept_apart_from_numbers(tmp_path):
    write(tmp_path / "map.png")
    values = read_value_png(tmp_path / "map.png")[0]
    np.testing.assert_array_equal(np.isnan(values), np.isnan(VALUES) | np.isneginf(VALUES))
    np.testing.assert_array_equal(np.isposinf(values), np.isposinf(VALUES))


def test_the_text_describes_how_to_decode_the_file(tmp_path):
    precision = write(tmp_path / "map.png")
    with Image.open(tmp_path / "map.png") as image:
        text, codes = image.text, np.asarray(image)
    assert codes.dtype == np.uint16
    assert text["occjax:quantity"] == "disparity"
    assert text["occjax:unit"] == "pixels per view step"
    assert "value = scale * code + offset" in text["occjax:formula"]
    scale, offset = float(text["occjax:scale"]), float(text["occjax:offset"])
    finite = np.isfinite(VALUES)
    np.testing.assert_allclose(
        scale * codes[finite] + offset, VALUES[finite], rtol=0, atol=precision * (1 + 1e-9)
    )
    assert codes[2, 3] == codes[6, 0] == 0
    assert codes[4, 5] == 65535


@pytest.mark.parametrize("value", [0.0, -2.75, 1e-30, 3e7])
def test_one_value_everywhere_is_exact(tmp_path, value):
    assert write(tmp_path / "map.png", np.full((2, 3), value)) == 0.0
    values = read_value_png(tmp_path / "map.png")[0]
    np.testing.assert_allclose(values, value, rtol=1e-12, atol=1e-15)


def test_a_map_without_any_value_is_read_back(tmp_path):
    write(tmp_path / "map.png", np.full((2, 3), np.nan))
    assert np.isnan(read_value_png(tmp_path / "map.png")[0]).all()


def test_the_range_of_32_bit_floats_fits(tmp_path):
    ends = np.array([[-3e38, 3e38, 0.0]], np.float32)
    precision = write(tmp_path / "map.png", ends)
    values = read_value_png(tmp_path / "map.png")[0]
    np.testing.assert_allclose(values, ends, rtol=0, atol=precision * 1.001)


def test_text_after_the_pixels_is_found(tmp_path):
    """Some programs put the text there when they save the image again."""
    write(tmp_path / "map.png")
    data = (tmp_path / "map.png").read_bytes()
    start, text, rest = 8, [], []
    while start < len(data):
        length = struct.unpack(">I", data[start : start + 4])[0] + 12
        chunk = data[start : start + length]
        (text if chunk[4:8] == b"tEXt" else rest).append(chunk)
        start += length
    assert len(text) == 5
    (tmp_path / "moved.png").write_bytes(data[:8] + b"".join(rest[:-1] + text + rest[-1:]))
    moved = read_value_png(tmp_path / "moved.png")[0]
    np.testing.assert_array_equal(moved, read_value_png(tmp_path / "map.png")[0])


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_codes_of_other_programs_are_all_values(tmp_path, dtype):
    codes = np.array([[0, 1, np.iinfo(dtype).max]], dtype)
    Image.fromarray(codes).save(tmp_path / "map.png")
    values, quantity = read_value_png(tmp_path / "map.png", scale=0.5, offset=-1.0)
    assert values.tolist() == [[-1.0, -0.5, 0.5 * np.iinfo(dtype).max - 1.0]]
    assert quantity is None
    assert read_value_png(tmp_path / "map.png", scale=2.0)[0][0, 1] == 2.0


def png_with_text(path, codes, **text):
    chunks = PngInfo()
    for key, value in text.items():
        chunks.add_text(f"occjax:{key}", value)
    Image.fromarray(codes).save(path, pnginfo=chunks)


GREY = np.zeros((2, 2), np.uint8)
DEEP = np.zeros((2, 2), np.uint16)
COLOUR = np.zeros((2, 2, 3), np.uint8)


@pytest.mark.parametrize(
    ("codes", "text", "options", "reason"),
    [
        (GREY, {}, {}, r"grey PNG of 8 bits .* --scale S --offset O"),
        (DEEP, {}, {}, r"grey PNG of 16 bits .* --scale S --offset O"),
        (DEEP, {}, {"offset": 1.0}, "does not store its scale"),
        (COLOUR, {}, {}, "in colour"),
        (COLOUR, {}, {"scale": 1.0}, "in colour"),
        (GREY, {}, {"scale": 0.0}, "not zero"),
        (GREY, {}, {"scale": float("nan")}, "must be numbers"),
        (GREY, {}, {"scale": 1.0, "offset": float("inf")}, "must be numbers"),
        (DEEP, {"scale": "1", "offset": "0"}, {"scale": 2.0}, "stores its own scale"),
        (DEEP, {"scale": "1", "offset": "0"}, {"offset": 2.0}, "stores its own scale"),
        (GREY, {"scale": "1", "offset": "0"}, {}, "another program changed"),
        (DEEP, {"scale": "one", "offset": "0"}, {}, "damaged"),
        (DEEP, {"scale": "1"}, {}, "damaged"),
        (DEEP, {"scale": "1", "offset": "nan"}, {}, "damaged"),
    ],
)
def test_ambiguous_files_are_refused_in_one_line(tmp_path, codes, text, options, reason):
    png_with_text(tmp_path / "map.png", codes, **text)
    with pytest.raises(InputError, match=reason) as error:
        read_value_png(tmp_path / "map.png", **options)
    assert "\n" not in str(error.value)


def test_a_damaged_file_is_reported(tmp_path):
    write(tmp_path / "map.png")
    data = (tmp_path / "map.png").read_bytes()
    (tmp_path / "cut.png").write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match=r"cut\.png: .*cannot be decoded"):
        read_value_png(tmp_path / "cut.png")


def test_text_of_huge_size_is_refused(tmp_path):
    write(tmp_path / "map.png")
    data = (tmp_path / "map.png").read_bytes()
    content = b"Comment\0\0" + zlib.compress(bytes(2**27))
    chunk = b"zTXt" + content
    chunk = struct.pack(">I", len(content)) + chunk + struct.pack(">I", zlib.crc32(chunk))
    (tmp_path / "bomb.png").write_bytes(data[:33] + chunk + data[33:])
    with pytest.raises(InputError, match=r"bomb\.png"):
        read_value_png(tmp_path / "bomb.png")


@pytest.mark.parametrize("shape", [(3,), (2, 2, 3), (0, 2)])
def test_other_shapes_are_refused_and_nothing_is_written(tmp_path, shape):
    with pytest.raises(InputError, match=r"map\.png"):
        write(tmp_path / "map.png", np.zeros(shape))
    assert not list(tmp_path.iterdir())
