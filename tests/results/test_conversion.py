"""Conversion between depth, disparity, points and normals."""

import numpy as np
import pytest

from occjax.errors import InputError
from occjax.io.maps import Map
from occjax.lightfield import Calibration
from occjax.results.conversion import (
    METRES,
    PIXELS,
    convert_map,
    normals,
    point_cloud,
    write_points,
)
from tests.io.test_ply import read_vertices

HEIGHT, WIDTH = 40, 50
CAMERA = Calibration(
    focal_length_mm=100.0, sensor_size_mm=35.0, baseline_mm=70.0, focus_distance_m=8.0
)
FOCAL_LENGTH = 100.0 / 35.0 * WIDTH
DISPARITY = np.linspace(-1.0, 1.5, HEIGHT * WIDTH, dtype=np.float32).reshape(HEIGHT, WIDTH)


def test_depth_follows_the_published_formula_in_double_precision(tolerance):
    depth = convert_map(Map(DISPARITY, "disparity"), "depth", CAMERA)
    # beta f_d / (d f_d sensor + beta), all in millimetres.
    beta = 70.0 * 100.0 * WIDTH
    expected = beta * 8000.0 / (DISPARITY.astype(np.float64) * 8000.0 * 35.0 + beta) / 1000.0
    assert depth.quantity == "depth"
    np.testing.assert_allclose(depth.values, expected, **tolerance("float64"))
    again = convert_map(depth, "disparity", CAMERA)
    assert again.quantity == "disparity"
    np.testing.assert_allclose(again.values, DISPARITY, **tolerance("float64"))


def test_the_same_quantity_is_not_converted():
    content = Map(DISPARITY, "disparity")
    assert convert_map(content, "disparity", CAMERA) is content


def test_missing_values_stay_missing(tolerance):
    values = np.array([[np.nan, np.inf, -np.inf, -1e3, 0.0]])
    depth = convert_map(Map(values, "disparity"), "depth", CAMERA).values
    # Infinite disparities mark missing values; -1000 is beyond infinitely distant points.
    np.testing.assert_allclose(
        depth, [[np.nan, np.nan, np.nan, np.inf, 8.0]], **tolerance("float64")
    )
    values = np.array([[np.nan, 0.0, -1.0, np.inf, 8.0]])
    disparity = convert_map(Map(values, "depth"), "disparity", CAMERA).values
    at_infinity = -100.0 / 35.0 * 5 * 0.07 / 8.0
    np.testing.assert_allclose(
        disparity, [[np.nan] * 3 + [at_infinity, 0.0]], **tolerance("float64")
    )


def test_calibrated_points_project_back_to_their_pixels_and_disparity(tolerance):
    cloud = point_cloud(Map(DISPARITY, "disparity"), CAMERA)
    assert cloud.unit == METRES
    right, up, depth = cloud.points[..., 0], cloud.points[..., 1], -cloud.points[..., 2]
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    np.testing.assert_allclose(
        FOCAL_LENGTH * right / depth + (WIDTH - 1) / 2, x, **tolerance("float64")
    )
    np.testing.assert_allclose(
        (HEIGHT - 1) / 2 - FOCAL_LENGTH * up / depth, y, **tolerance("float64")
    )
    # Parallax of a baseline of 0.07 m, less that of the plane in focus at 8 m.
    parallax = FOCAL_LENGTH * 0.07 * (1 / depth - 1 / 8.0)
    np.testing.assert_allclose(parallax, DISPARITY, **tolerance("float64"))


def test_depth_and_its_disparity_have_the_same_points():
    disparity = Map(DISPARITY, "disparity")
    of_disparity = point_cloud(disparity, CAMERA).points
    of_depth = point_cloud(convert_map(disparity, "depth", CAMERA), CAMERA).points
    np.testing.assert_array_equal(of_depth, of_disparity)


def test_points_without_calibration_are_nearer_where_disparity_is_larger():
    cloud = point_cloud(Map(np.array([[0.0, 1.0]]), "disparity"), None)
    assert cloud.points[0].tolist() == [[-0.5, 0.0, 0.0], [0.5, 0.0, 0.25]]
    assert cloud.unit == PIXELS


def test_depth_without_calibration_has_no_points():
    with pytest.raises(InputError, match="focal length"):
        point_cloud(Map(np.ones((2, 2)), "depth"), None)


def test_disparity_and_depth_of_a_plane_have_its_normal(tolerance):
    """``normal . P = -3`` gives ``1 / depth = -(ray . normal) / 3``, and disparity linear in it."""
    normal = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    right, up = (x - (WIDTH - 1) / 2) / FOCAL_LENGTH, ((HEIGHT - 1) / 2 - y) / FOCAL_LENGTH
    inverse = -(normal[0] * right + normal[1] * up - normal[2]) / 3.0
    disparity = FOCAL_LENGTH * 0.07 * (inverse - 1 / 8.0)
    expected = np.broadcast_to(normal, (HEIGHT, WIDTH, 3))
    for content in (Map(disparity, "disparity"), Map(1 / inverse, "depth")):
        np.testing.assert_allclose(normals(content, CAMERA), expected, **tolerance("float64"))
    rounded = Map(disparity.astype(np.float32), "disparity")
    np.testing.assert_allclose(normals(rounded, CAMERA), expected, **tolerance("float32"))


def test_finite_points_are_written_with_the_colours_of_their_pixels(tmp_path, tolerance):
    values = np.array([[0.5, np.nan], [-1e3, 0.25]])
    centre = np.array([[[1, 2, 3], [4, 5, 6]], [[7, 8, 9], [10, 11, 12]]], np.uint8)
    cloud = point_cloud(Map(values, "disparity"), CAMERA)
    assert write_points(tmp_path / "points.ply", cloud, centre=centre) == 2
    vertices, lines = read_vertices(tmp_path / "points.ply")
    assert [tuple(vertex)[3:] for vertex in vertices] == [(1, 2, 3), (10, 11, 12)]
    np.testing.assert_allclose(
        vertices["x"], cloud.points[[0, 1], [0, 1], 0], **tolerance("relative")
    )
    assert f"comment {METRES}" in lines


def test_a_view_of_another_size_is_refused(tmp_path):
    cloud = point_cloud(Map(np.zeros((2, 2)), "disparity"), None)
    with pytest.raises(InputError, match=r"\[3, 2\] but the map is \[2, 2\]"):
        write_points(tmp_path / "points.ply", cloud, centre=np.zeros((3, 2, 3), np.uint8))
    assert not list(tmp_path.iterdir())
