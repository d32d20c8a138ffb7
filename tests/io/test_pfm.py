import struct

import hypothesis
import hypothesis.extra.numpy as arrays
import hypothesis.strategies as st
import numpy as np
import pytest

from occjax.errors import InputError
from occjax.io.pfm import read_pfm, write_pfm

BOTTOM_UP = struct.pack("<6f", 4, 5, 6, 1, 2, 3)
IMAGE = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]


@pytest.mark.parametrize(
    "header",
    [
        b"Pf\n3 2\n-1.0\n",
        b"Pf\r\n3 2\r\n-1.0\r\n",
        b"Pf\n# a comment\n3 2\n#another 9\n-1.0\n",
        b"Pf 3 2 -1\n",
        b"Pf\n3\n2\n-0.003922\n",
        b"Pf # magic\n3 2 # size\n-1.0 # little-endian\n",
    ],
)
def test_the_first_row_of_the_file_is_the_bottom_of_the_image(tmp_path, header):
    path = tmp_path / "map.pfm"
    path.write_bytes(header + BOTTOM_UP)
    image = read_pfm(path)
    assert image.dtype == np.float32
    assert image.tolist() == IMAGE


def test_a_positive_scale_means_big_endian(tmp_path):
    path = tmp_path / "map.pfm"
    path.write_bytes(b"Pf\n3 2\n1.0\n" + struct.pack(">6f", 4, 5, 6, 1, 2, 3))
    assert read_pfm(path).tolist() == IMAGE


def test_colour_has_three_values_per_pixel(tmp_path):
    path = tmp_path / "map.pfm"
    path.write_bytes(b"PF\n1 2\n-1.0\n" + BOTTOM_UP)
    assert read_pfm(path).tolist() == [[[1.0, 2.0, 3.0]], [[4.0, 5.0, 6.0]]]


def test_pixels_that_look_like_white_space_stay_pixels(tmp_path):
    path = tmp_path / "map.pfm"
    path.write_bytes(b"Pf\n1 1\n-1.0\n" + b"\n\r\n ")
    assert read_pfm(path).view(np.uint32)[0, 0] == int.from_bytes(b"\n\r\n ", "little")


def test_written_files_are_little_endian_and_bottom_up(tmp_path):
    path = tmp_path / "map.pfm"
    write_pfm(path, np.array(IMAGE, np.float64))
    assert path.read_bytes() == b"Pf\n3 2\n-1.0\n" + BOTTOM_UP


@hypothesis.given(
    arrays.arrays(
        np.float32,
        st.one_of(
            st.tuples(st.integers(1, 5), st.integers(1, 5)),
            st.tuples(st.integers(1, 5), st.integers(1, 5), st.just(3)),
        ),
        elements=st.floats(width=32),
    )
)
def test_any_map_survives_writing_and_reading(tmp_path_factory, image):
    path = tmp_path_factory.mktemp("pfm") / "map.pfm"
    write_pfm(path, image)
    np.testing.assert_array_equal(read_pfm(path), image)


@pytest.mark.parametrize("shape", [(4,), (2, 2, 1), (1, 2, 2, 3), (0, 2)])
def test_other_shapes_are_refused_and_nothing_is_written(tmp_path, shape):
    with pytest.raises(InputError, match=r"map\.pfm"):
        write_pfm(tmp_path / "map.pfm", np.zeros(shape, np.float32))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"P6\n3 2\n255\n" + BOTTOM_UP, "not a PFM file"),
        (b"", "it is empty"),
        (b"PFM\n3 2\n-1.0\n" + BOTTOM_UP, "header"),
        (b"Pf\n3 2\n", "incomplete"),
        (b"Pf\n3 two\n-1.0\n" + BOTTOM_UP, "header"),
        (b"Pf\n3 0\n-1.0\n" + BOTTOM_UP, "header"),
        (b"Pf\n-3 2\n-1.0\n" + BOTTOM_UP, "header"),
        (b"Pf\n3 2\n0\n" + BOTTOM_UP, "scale"),
        (b"Pf\n3 2\nnan\n" + BOTTOM_UP, "scale"),
        (b"Pf\n3 2\nlittle\n" + BOTTOM_UP, "scale"),
        (b"Pf\n3 2 1 1\n-1.0\n" + BOTTOM_UP, "header"),
        (b"Pf\n3 2\n-1.0\n" + BOTTOM_UP[:-1], "truncated"),
        (b"Pf\n3 2\n-1.0\n" + BOTTOM_UP + b"\n", "damaged"),
        (b"PF\n3 2\n-1.0\n" + BOTTOM_UP, "truncated"),
    ],
)
def test_a_damaged_file_is_reported_with_its_fault(tmp_path, content, reason):
    path = tmp_path / "map.pfm"
    path.write_bytes(content)
    with pytest.raises(InputError) as error:
        read_pfm(path)
    assert str(path) in str(error.value)
    assert reason in str(error.value)
    assert "\n" not in str(error.value)


def test_a_missing_file_and_a_folder_are_reported(tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.pfm.*no such file"):
        read_pfm(tmp_path / "nowhere.pfm")
    with pytest.raises(InputError, match="is a folder"):
        read_pfm(tmp_path)


def test_published_ground_truth_is_read_the_right_way_up(shared):
    """The cotton statue stands before a wall: the far wall fills the top corners of the map."""
    disparity = read_pfm(shared / "data/hci/cotton_maps/gt_disp_lowres.pfm")
    assert disparity.shape == (512, 512)
    assert disparity[:32, :32].max() < disparity[448:, 192:320].min()
