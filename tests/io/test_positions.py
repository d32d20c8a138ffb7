"""Camera positions in files next to the views, and the declared spacing."""

import imageio.v3 as iio
import numpy as np
import pytest

from occjax.errors import InputError
from occjax.io import GridWarning, load
from occjax.lightfield import view_offsets


@pytest.fixture
def folder(tmp_path):
    """3x4 views of one grey value each: 10 times the row plus the column."""
    for v, u in np.ndindex(3, 4):
        iio.imwrite(tmp_path / f"view_{v}_{u}.png", np.full((8, 8, 3), 10 * v + u, np.uint8))
    return tmp_path


def read(folder, **options):
    return load(folder, check_orientation=False, pattern="view_{v}_{u}.png", **options)


@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize("unit", [1.0, 12.5])
def test_positions_of_any_unit_become_row_steps(folder, flat, unit, tolerance):
    positions = (view_offsets(3, 4) * [1.0, 2.0] + 5.0) * unit
    np.save(folder / "positions.npy", positions.reshape(-1, 2) if flat else positions)
    np.testing.assert_allclose(
        read(folder).positions, view_offsets(3, 4) * [1.0, 2.0], **tolerance("absolute")
    )


def test_a_table_may_have_a_heading(folder):
    lines = [f"{v},{2 * u}" for v, u in np.ndindex(3, 4)]
    (folder / "positions.csv").write_text("\n".join(["row,column", *lines]))
    np.testing.assert_allclose(read(folder).positions, view_offsets(3, 4) * [1.0, 2.0])


@pytest.mark.parametrize(
    ("first", "last", "message"),
    [
        ("0,0", None, r"has 11 positions, float64 \[11, 2\], but the 3x4 grid has 12 views"),
        ("nan,nan", "2,6", "line 1 is 'nan,nan', not two numbers; write one line 'row,column'"),
        ("0,0", "2;6;1", "line 12 is '2;6;1', not two numbers"),
        ("0,0", "2,six", "line 12 is '2,six'"),
    ],
)
def test_a_wrong_line_of_a_table_is_named(folder, first, last, message):
    lines = [f"{v},{2 * u}" for v, u in np.ndindex(3, 4)][1:-1]
    lines = [first, *lines, *([last] if last else [])]
    (folder / "positions.csv").write_text("\n".join(lines) + "\n\n")
    with pytest.raises(InputError, match=message):
        read(folder)


def test_views_are_ordered_by_their_positions(folder):
    """The first index of the names is the column, counted from right to left."""
    v, u = np.mgrid[:3, :4]
    np.save(folder / "positions.npy", np.stack([u, -v], -1).astype(float))
    light_field = read(folder)
    assert light_field.grid == (4, 3)
    np.testing.assert_array_equal(light_field.positions, view_offsets(4, 3))
    np.testing.assert_array_equal(light_field.views[..., 0, 0, 0], (10 * v + u).T[:, ::-1])


@pytest.mark.parametrize(
    ("positions", "message"),
    [
        (np.zeros((3, 4, 2)), "all the same"),
        (np.full((12, 2), np.nan), "12 of 12 positions are NaN.* in row 0, column 0"),
        (
            np.zeros((11, 2)),
            r"has 11 positions, float64 \[11, 2\], but the 3x4 grid has 12 views; write one",
        ),
        (np.zeros((3, 4)), r"has positions, float64 \[3, 4\], but"),
        (np.stack([np.arange(12.0), np.zeros(12)], -1), "have the same position"),
    ],
)
def test_wrong_positions_are_refused(folder, positions, message):
    np.save(folder / "positions.npy", positions)
    with pytest.raises(InputError, match=message):
        read(folder)


def test_a_declared_spacing_becomes_positions(folder):
    expected = view_offsets(3, 4) * [1.0, 0.5]
    np.testing.assert_allclose(read(folder, spacing=(20.0, 10.0)).positions, expected)
    with pytest.raises(InputError, match="must be two positive numbers"):
        read(folder, spacing=(1.0, 0.0))
    np.save(folder / "positions.npy", expected)
    with pytest.raises(InputError, match="leave out spacing"):
        read(folder, spacing=(20.0, 10.0))


@pytest.mark.parametrize("unit", [0.01, 12.5])
def test_positions_of_an_array_in_another_unit_are_told(tmp_path, unit, tolerance):
    views = np.zeros((3, 4, 8, 8), np.uint8)
    np.savez(tmp_path / "scene.npz", views=views, positions=unit * view_offsets(3, 4))
    with pytest.warns(GridWarning, match=f"cameras are {unit:.4g} apart in positions, which are"):
        read_array = load(tmp_path / "scene.npz", check_orientation=False)
    np.testing.assert_allclose(
        read_array.positions, unit * view_offsets(3, 4), **tolerance("relative")
    )
