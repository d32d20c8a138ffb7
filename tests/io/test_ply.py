"""PLY files, read back by a minimal parser that follows the header."""

import numpy as np
import pytest

from occjax.errors import InputError
from occjax.io.ply import write_ply

POINTS = np.array([[0.0, 1.5, -2.0], [3.25, -4.0, 5.0], [1e6, 0.0, 7.0]])
COLOURS = np.array([[0, 128, 255], [1, 2, 3], [9, 8, 7]], np.uint8)


def read_vertices(path):
    """Return the vertices of a binary little-endian file and the lines of its header."""
    header, body = path.read_bytes().split(b"end_header\n", 1)
    lines = header.decode("ascii").splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    count = int(next(line.split()[2] for line in lines if line.startswith("element vertex")))
    types = {"float": "<f4", "uchar": "u1"}
    fields = [line.split()[1:] for line in lines if line.startswith("property")]
    vertices = np.frombuffer(body, np.dtype([(name, types[kind]) for kind, name in fields]))
    assert len(vertices) == count
    return vertices, lines


def test_points_and_colours_are_read_back(tmp_path):
    write_ply(tmp_path / "points.ply", POINTS, COLOURS, comment="metres")
    vertices, lines = read_vertices(tmp_path / "points.ply")
    found = np.stack([vertices[name] for name in "xyz"], axis=1)
    np.testing.assert_array_equal(found, POINTS.astype(np.float32))
    found = np.stack([vertices[name] for name in ("red", "green", "blue")], axis=1)
    np.testing.assert_array_equal(found, COLOURS)
    assert "comment metres" in lines


def test_points_without_colour_have_none_in_the_file(tmp_path):
    write_ply(tmp_path / "points.ply", POINTS, None)
    vertices, _ = read_vertices(tmp_path / "points.ply")
    assert vertices.dtype.names == ("x", "y", "z")
    np.testing.assert_array_equal(vertices["y"], POINTS[:, 1].astype(np.float32))


def test_no_points_make_a_valid_empty_file(tmp_path):
    write_ply(tmp_path / "empty.ply", np.zeros((0, 3)), np.zeros((0, 3), np.uint8))
    assert len(read_vertices(tmp_path / "empty.ply")[0]) == 0


@pytest.mark.parametrize(
    ("points", "colours", "reason"),
    [
        (POINTS[:2], COLOURS, "both be"),
        (POINTS[:, :2], COLOURS[:, :2], "points must be"),
        (POINTS[0], None, "points must be"),
        (POINTS, COLOURS.astype(float), "uint8"),
    ],
)
def test_arrays_that_do_not_fit_are_refused_and_nothing_is_written(
    tmp_path, points, colours, reason
):
    with pytest.raises(InputError, match=reason):
        write_ply(tmp_path / "points.ply", points, colours)
    assert list(tmp_path.iterdir()) == []
