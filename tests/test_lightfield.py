"""Light fields: grey, central grids, refused values and the depth formula."""

import numpy as np
import pytest

from occjax.errors import InputError
from occjax.lightfield import Calibration, LightField


def test_grey_is_a_weighted_sum_of_the_colours(tolerance):
    views = np.zeros((1, 1, 1, 3, 3), np.uint8)
    views[0, 0, 0] = np.diag([255, 255, 255])
    grey = LightField(views).grey()
    assert grey.dtype == np.float32
    np.testing.assert_allclose(grey[0, 0, 0], [0.299, 0.587, 0.114], **tolerance("relative"))


@pytest.mark.parametrize(("dtype", "white"), [(np.uint8, 255), (np.uint16, 65535), (np.float32, 1)])
@pytest.mark.parametrize("channels", [1, 3])
def test_white_is_one_for_every_type(dtype, white, channels, tolerance):
    light_field = LightField(np.full((1, 2, 3, 3, channels), white, dtype))
    np.testing.assert_allclose(light_field.grey(), 1.0, **tolerance("relative"))
    assert light_field.floating().dtype == np.float32
    assert light_field.floating().max() == 1.0


@pytest.mark.parametrize(
    ("grid", "inner"), [((9, 9), (5, 5)), ((9, 7), (3, 7)), ((4, 4), (2, 2)), ((4, 5), (3, 3))]
)
def test_a_central_grid_keeps_the_centre_view(grid, inner):
    v, u = np.mgrid[: grid[0], : grid[1]]
    views = np.broadcast_to((10 * v + u)[..., None, None, None], (*grid, 9, 9, 1)).astype(np.uint8)
    positions = np.stack([v - grid[0] // 2, u - grid[1] // 2], axis=-1).astype(np.float32)
    usable = (v + u) % 2 == sum(np.array(grid) // 2) % 2
    light_field = LightField(views, positions=positions, usable=usable)
    central = light_field.central(*inner)
    assert central.grid == inner
    np.testing.assert_array_equal(central.centre, light_field.centre)
    assert central.positions[inner[0] // 2, inner[1] // 2].tolist() == [0.0, 0.0]
    rows, columns = np.indices(inner)
    np.testing.assert_array_equal(
        central.usable, (rows + columns) % 2 == sum(np.array(inner) // 2) % 2
    )


def test_a_larger_central_grid_is_refused():
    with pytest.raises(InputError, match="tiny: has 3x3 views, 9x9 are needed"):
        LightField(np.zeros((3, 3, 2, 2, 1)), name="tiny").central(9, 9)


@pytest.mark.parametrize("shape", [(3, 4, 4, 3), (3, 3, 4, 4, 2), (3, 3, 4, 4, 4)])
def test_views_of_another_shape_are_refused(shape):
    with pytest.raises(InputError, match="scene: views must be"):
        LightField(np.zeros(shape), name="scene")


def test_grey_views_get_their_channel_axis():
    views = np.random.default_rng(0).random((3, 3, 4, 5))
    np.testing.assert_array_equal(LightField(views).views, views[..., np.newaxis])


@pytest.mark.parametrize(
    "views",
    [
        np.full((3, 3, 4, 4, 1), 255.0),
        np.full((3, 3, 4, 4, 1), np.nan),
        np.full((3, 3, 4, 4, 1), -1.0),
        np.zeros((3, 3, 4, 4, 1), np.int64),
        np.zeros((0, 3, 4, 4, 1), np.uint8),
    ],
)
def test_unsupported_types_and_values_are_refused(views):
    with pytest.raises(
        InputError, match=r"scene: views must be an array of uint8, of uint16 or of fin"
    ):
        LightField(views, name="scene")


@pytest.mark.parametrize("shape", [(32, 32, 5, 5), (32, 30, 5, 7, 3)])
def test_arrays_of_pixels_before_views_are_refused(shape):
    with pytest.raises(InputError, match=r"more rows and columns than the views have pixels; tran"):
        LightField(np.zeros(shape, np.uint8))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"positions": np.zeros((3, 3), np.float32)}, r"not \[V, U, 2\]"),
        ({"usable": np.ones((3, 2), bool)}, r"usable is bool \[3, 2\], not bool \[V, U\]"),
        ({"usable": np.ones((3, 3))}, "usable is float64"),
        ({"usable": ~np.eye(3, dtype=bool)}, r"the centre view \(row 1, column 1.* is missing"),
        ({"disparity_range": (1.0, -1.0)}, "minimum < maximum"),
        ({"disparity_range": (0.0, 0.0)}, "minimum < maximum"),
        ({"disparity_range": (float("nan"), 1.0)}, "minimum < maximum"),
    ],
)
def test_inconsistent_fields_are_refused(fields, message):
    with pytest.raises(InputError, match=message):
        LightField(np.zeros((3, 3, 4, 4, 1)), **fields)


def test_ground_truth_must_have_the_size_of_the_views():
    with pytest.raises(InputError, match=r"\[4, 5\].*\[4, 4\]"):
        LightField(np.zeros((3, 3, 4, 4, 1)), ground_truth=np.zeros((4, 5)))


def test_depth_inverts_the_geometry_of_converging_cameras(tolerance):
    """d = f_px b (1 / Z - 1 / Z0): cameras 80 mm apart, f_px = 100 / 35 * 512, Z0 = 6 m."""
    calibration = Calibration(
        focal_length_mm=100.0, sensor_size_mm=35.0, baseline_mm=80.0, focus_distance_m=6.0
    )
    focal_pixels = 100.0 / 35.0 * 512
    depth = np.array([2.0, 6.0, 40.0])
    disparity = focal_pixels * 0.08 * (1 / depth - 1 / 6.0)
    np.testing.assert_allclose(
        calibration.depth(disparity, (384, 512)), depth, **tolerance("float64")
    )


def test_beyond_infinity_depth_is_infinite():
    calibration = Calibration(100.0, 35.0, 80.0, 6.0)
    at_infinity = -100.0 / 35.0 * 512 * 0.08 / 6.0
    assert np.isinf(calibration.depth(np.array([at_infinity - 1e-6]), (512, 512))).all()


def test_the_views_around_another_one_keep_their_places_relative_to_it():
    generator = np.random.default_rng(0)
    views = generator.random((3, 4, 2, 2, 1)).astype(np.float32)
    positions = generator.normal(size=(3, 4, 2)).astype(np.float32)
    usable = np.ones((3, 4), bool)
    usable[1, 1] = False
    light_field = LightField(
        views, positions=positions, usable=usable, ground_truth=np.zeros((2, 2), np.float32)
    )
    around = light_field.around((0, 3))
    assert (around.grid, around.view, around.ground_truth) == ((5, 7), (0, 3), None)
    np.testing.assert_array_equal(around.centre, views[0, 3])
    for v, u in np.ndindex(5, 7):
        row, column = v - 2, u  # the centre view of the new grid is (2, 3)
        inside = 0 <= row < 3 and column < 4
        assert around.usable[v, u] == (inside and usable[row, column])
        if inside:
            np.testing.assert_array_equal(around.views[v, u], views[row, column])
            expected = positions[row, column] - positions[0, 3]
            np.testing.assert_array_equal(around.offsets[v, u], expected)
    assert light_field.around((1, 2)) is light_field
    with pytest.raises(InputError, match=r"no view \(3, 0\); rows are 0 to 2, columns 0 to 3"):
        light_field.around((3, 0))
    with pytest.raises(InputError, match=r"view \(1, 1\) is missing or too dark"):
        light_field.around((1, 1))


@pytest.mark.usefixtures("unchecked")
def test_the_type_of_unsupported_views_is_named():
    with pytest.raises(InputError, match=r"not int64 \[3, 3, 4, 4, 1\]; .*numpy.asarray\(views, n"):
        LightField(np.zeros((3, 3, 4, 4, 1), np.uint8).tolist())
    with pytest.raises(InputError, match=r"not float64 from 0 to 255; scale"):
        LightField(np.linspace(0.0, 255.0, 144).reshape(3, 3, 4, 4, 1))


@pytest.mark.parametrize("view", [3, (0.5, 0), (0, 1, 2), (-1, 0), "00"])
@pytest.mark.usefixtures("unchecked")
def test_a_view_is_a_row_and_a_column(view):
    with pytest.raises(InputError, match=r"view is .*; it must be two whole numbers"):
        LightField(np.zeros((3, 3, 4, 4, 1), np.uint8)).around(view)
