"""The cloud that is fused from the maps of all views."""

import numpy as np

from occjax.estimators import ViewMaps
from occjax.lightfield import Calibration, LightField, project, view_offsets
from occjax.results.conversion import Map, point_cloud, points_at
from occjax.results.view_maps import fused_points, write_view_maps
from tests.scenes import two_plane_maps


def test_the_cloud_has_each_confirmed_point_once_and_no_outlier():
    disparity, offsets = two_plane_maps(), view_offsets(3, 3)
    agreeing = np.full(disparity.shape, 8)
    consistency = np.ones(disparity.shape, np.float32)
    disparity[0, 0, 20, 20] = 1.0  # an outlier, which no view confirms
    agreeing[0, 0, 20, 20] = 0
    consistency[2, 2, 0, :] = 0.5  # contradicted by half of the views
    maps = ViewMaps(disparity, consistency, consistency, agreeing, agreeing < 0, offsets, 0.1)
    views = np.broadcast_to(np.arange(9, dtype=np.uint8).reshape(3, 3, 1, 1, 1), (3, 3, 24, 24, 3))
    points, colours = fused_points(maps, LightField(views))
    expected = {}
    for v, u in sorted(np.ndindex(3, 3), key=lambda view: np.square(offsets[view]).sum()):
        for y, x in np.ndindex(24, 24):
            d = float(disparity[v, u, y, x])
            if agreeing[v, u, y, x] and consistency[v, u, y, x] == 1:
                place = (*map(float, project(y, x, d, -offsets[v, u])), d)
                expected.setdefault(place, 3 * v + u)
    assert len(expected) == 24 * 24 + 8 * 8 - 4 * 4  # a part of the plane is hidden from all views
    found = {tuple(point): colour[0] for point, colour in zip(points, colours, strict=True)}
    assert len(points) == len(found)
    assert found == expected


def test_maps_without_any_disparity_give_an_empty_cloud(tmp_path):
    shape = (1, 3, 4, 5)
    nothing, none = np.full(shape, np.nan, np.float32), np.zeros(shape, np.float32)
    maps = ViewMaps(nothing, none, none, none.astype(int), none > 0, view_offsets(1, 3), 0.1)
    light_field = LightField(np.zeros(shape, np.uint8))
    points, colours = fused_points(maps, light_field)
    assert points.shape == colours.shape == (0, 3)
    write_view_maps(maps, light_field, tmp_path)
    assert b"element vertex 0\n" in (tmp_path / "views.ply").read_bytes()


def test_points_of_whole_pixels_are_those_of_the_map(tolerance):
    camera = Calibration(100.0, 35.0, baseline_mm=50.0, focus_distance_m=7.0)
    disparity = np.random.default_rng(0).uniform(-0.1, 0.5, (4, 5))
    y, x = np.indices((4, 5)).astype(float)
    for calibration in (camera, None):
        expected = point_cloud(Map(disparity, "disparity"), calibration).points
        points = points_at(y, x, disparity, calibration, (4, 5))
        np.testing.assert_allclose(points, expected, **tolerance("float64"))
