"""Depth, 3D points and normals against closed forms: the published formula, planes and a sphere."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax import ops
from occjax.lightfield import Calibration
from tests.ops.derivatives import assert_derivatives

CAMERA = Calibration(
    focal_length_mm=100.0, sensor_size_mm=35.0, baseline_mm=50.0, focus_distance_m=7.2
)
DISPARITY = np.random.default_rng(0).uniform(-0.08, 0.075, (4, 6)).astype(np.float32)
"""Of a scene from 3.6 m to 32 m; infinitely distant points have -0.119."""

depth_from_disparity = jax.jit(ops.depth_from_disparity, static_argnums=1)
disparity_from_depth = jax.jit(ops.disparity_from_depth, static_argnums=1)
back_project = jax.jit(ops.back_project, static_argnums=1)


def published_depth(disparity):
    """``beta * f_d / (d * f_d * sensor + beta)``, in the units of ``parameters.cfg``."""
    beta = 50.0 * 100.0 * 6
    focus_mm = 7200.0
    depth = [beta * focus_mm / (float(d) * focus_mm * 35.0 + beta) for d in disparity.ravel()]
    return np.reshape(depth, disparity.shape) / 1000.0


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_depth_is_that_of_the_published_formula(dtype, tolerance, x64):
    disparity = DISPARITY.astype(dtype)
    depth = depth_from_disparity(disparity, CAMERA)
    assert depth.dtype == dtype
    np.testing.assert_allclose(depth, published_depth(disparity), **tolerance(dtype))
    np.testing.assert_allclose(depth, CAMERA.depth(disparity, (4, 6)), **tolerance(dtype))


def test_focal_length_in_pixels_follows_the_longer_side(tolerance):
    portrait = depth_from_disparity(DISPARITY.T, CAMERA)
    landscape = depth_from_disparity(DISPARITY, CAMERA)
    np.testing.assert_allclose(portrait, np.asarray(landscape).T, **tolerance("float32"))


def test_disparity_from_depth_is_the_inverse(tolerance):
    again = disparity_from_depth(depth_from_disparity(DISPARITY, CAMERA), CAMERA)
    np.testing.assert_allclose(again, DISPARITY, **tolerance("float32"))


def test_depth_is_infinite_beyond_the_disparity_of_infinity(tolerance):
    at_infinity = -(100.0 / 35.0 * 3) * 0.05 / 7.2  # -f b / focus
    disparity = np.float32([[at_infinity - 1e-6, -100.0, np.nan]])
    depth = np.asarray(depth_from_disparity(disparity, CAMERA))
    np.testing.assert_array_equal(depth, [[np.inf, np.inf, np.nan]])
    back = disparity_from_depth(np.float32([[np.inf, np.inf, np.inf]]), CAMERA)
    np.testing.assert_allclose(back, at_infinity, **tolerance("relative"))


def test_impossible_depth_has_no_disparity_and_no_point():
    depth = np.float32([[0.0, -1.0, np.nan]])
    assert np.isnan(disparity_from_depth(depth, CAMERA)).all()
    assert np.isnan(back_project(depth, CAMERA)).all()
    assert np.isnan(back_project(np.float32([[np.inf]]), CAMERA)).all()


def test_points_project_onto_their_pixels(tolerance):
    depth = np.random.default_rng(1).uniform(0.5, 20.0, (4, 6)).astype(np.float32)
    points = np.asarray(back_project(depth, CAMERA), np.float64)
    focal_length = 100.0 / 35.0 * 6
    for y, x in np.ndindex(4, 6):
        right, up, towards_viewer = points[y, x]
        assert -towards_viewer == pytest.approx(depth[y, x])
        np.testing.assert_allclose(
            2.5 + focal_length * right / -towards_viewer, x, **tolerance("absolute")
        )
        np.testing.assert_allclose(
            1.5 - focal_length * up / -towards_viewer, y, **tolerance("absolute")
        )


def test_derivatives(x64):
    assert_derivatives(lambda d: ops.depth_from_disparity(d, CAMERA), DISPARITY)
    depth = 1.0 + np.abs(DISPARITY)
    assert_derivatives(lambda z: ops.disparity_from_depth(z, CAMERA), depth)
    assert_derivatives(lambda z: ops.back_project(z, CAMERA), depth)
    depth[:, 3:] += 1.0  # an edge
    assert_derivatives(lambda z: ops.surface_normals(ops.back_project(z, CAMERA)), depth)


def test_gradients_are_zero_where_there_is_no_value(tolerance):
    def total(values, function):
        result = function(values, CAMERA)
        return jnp.where(jnp.isfinite(result), result, 0.0).sum()

    distant = jax.grad(total)(jnp.array([[0.0, -100.0]]), ops.depth_from_disparity)
    assert distant[0, 1] == 0.0
    # dZ/dd = -Z^2 / (f b) at the focus: f = 100 / 35 * 2.
    np.testing.assert_allclose(
        distant[0, 0], -(7.2**2) / (100 / 35 * 2 * 0.05), **tolerance("relative")
    )
    for function in (ops.disparity_from_depth, ops.back_project):
        gradient = jax.grad(total)(jnp.array([[1.0, 0.0, -1.0]]), function)
        assert np.isfinite(gradient).all()
        assert gradient[0, 0] != 0.0
        assert gradient[0, 1:].tolist() == [0.0, 0.0]


class TestNormals:
    size = (60, 80)
    camera = Calibration(
        focal_length_mm=50.0, sensor_size_mm=35.0, baseline_mm=40.0, focus_distance_m=3.0
    )
    facing = np.array([0.0, 0.0, 1.0])

    def rays(self):
        """``[h, w, 3]`` directions of the pixels, one metre along the optical axis."""
        height, width = self.size
        focal_length = 50.0 / 35.0 * width
        y, x = np.mgrid[:height, :width]
        right, up = (x - (width - 1) / 2) / focal_length, ((height - 1) / 2 - y) / focal_length
        return np.stack([right, up, -np.ones(self.size)], axis=-1)

    def plane_depth(self, normal, distance):
        """Depth of the plane ``normal . P = -distance``, where depth times the ray is on it."""
        return -distance / (self.rays() @ normal)

    def sphere_depth(self, centre, radius):
        """Depth of the nearer crossing of each ray with a sphere; infinite without one."""
        directions = self.rays()
        a, b = (directions**2).sum(-1), directions @ centre
        root = b**2 - a * (centre @ centre - radius**2)
        return np.where(root > 0, (b - np.sqrt(np.maximum(root, 0))) / a, np.inf)

    def of_depth(self, depth, edge=3.0):
        function = jax.jit(lambda z: ops.surface_normals(back_project(z, self.camera), edge=edge))
        return np.asarray(function(depth))

    def of_rounded_disparity(self, depth):
        """Normals from ``f b (1 / Z - 1 / focus)``, rounded as in a file."""
        disparity = (50.0 / 35.0 * 80 * 0.04 * (1 / depth - 1 / 3.0)).astype(np.float32)
        return self.of_depth(depth_from_disparity(disparity, self.camera))

    @staticmethod
    def unit(*vector):
        return np.array(vector) / np.linalg.norm(vector)

    @staticmethod
    def degrees(found, expected):
        return np.degrees(2 * np.arcsin(np.linalg.norm(found - expected, axis=-1) / 2))

    @pytest.mark.parametrize(
        "normal", [(0.0, 0.0, 1.0), (0.6, 0.0, 1.0), (0.0, -0.8, 1.0), (-0.5, 0.9, 0.7)]
    )
    def test_plane_has_its_normal_everywhere(self, normal, tolerance):
        normal = self.unit(*normal)
        normals = self.of_rounded_disparity(self.plane_depth(normal, 2.0))
        np.testing.assert_allclose(
            normals, np.broadcast_to(normal, normals.shape), **tolerance("amplified")
        )

    def test_plane_is_exact_in_double_precision(self, x64, tolerance):
        normal = self.unit(-0.5, 0.9, 0.7)
        normals = self.of_depth(self.plane_depth(normal, 2.0))
        np.testing.assert_allclose(
            normals, np.broadcast_to(normal, normals.shape), **tolerance("float64")
        )

    def test_sphere_in_front_of_a_wall(self, tolerance):
        centre, radius = np.array([0.1, 0.05, -2.0]), 0.4
        wall_normal = self.unit(0.2, 0.1, 1.0)
        sphere, wall = self.sphere_depth(centre, radius), self.plane_depth(wall_normal, 3.5)
        on_sphere = np.isfinite(sphere)
        assert 500 < on_sphere.sum() < 2500
        normals = self.of_rounded_disparity(np.where(on_sphere, sphere, wall))
        # The outline of the sphere does not show in the wall.
        np.testing.assert_allclose(
            normals[~on_sphere],
            np.broadcast_to(wall_normal, normals[~on_sphere].shape),
            **tolerance("amplified"),
        )
        directions = self.rays()[on_sphere]
        exact = (directions * sphere[on_sphere, None] - centre) / radius
        towards_viewer = -(exact * directions).sum(-1) / np.linalg.norm(directions, axis=-1)
        error = self.degrees(normals[on_sphere], exact)
        assert error[towards_viewer > 0.5].max() < 0.5  # seen at less than 60 degrees
        assert np.median(error) < 0.1
        # The outermost of its 23 pixels, seen one-sidedly, spans the angle acos(1 - 1 / 23).
        assert error.max() < np.degrees(np.arccos(1 - 1 / 23))

    def test_normals_are_unit_vectors_that_face_the_viewer(self, tolerance):
        depth = np.random.default_rng(0).uniform(1.0, 5.0, self.size).astype(np.float32)
        normals = self.of_depth(depth)
        np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0, **tolerance("absolute"))
        assert ((normals * self.rays()).sum(-1) < 0).all()

    def test_step_between_two_walls_shows_on_neither(self, tolerance):
        depth = np.full(self.size, 4.0, np.float32)
        depth[20:40, 30:60] = 2.0
        normals = self.of_depth(depth)
        np.testing.assert_allclose(
            normals, np.broadcast_to(self.facing, normals.shape), **tolerance("absolute")
        )
        # Without the rule for edges it shows.
        assert self.degrees(self.of_depth(depth, edge=np.inf), self.facing).max() > 80.0

    def test_missing_points_are_stepped_around(self, tolerance):
        normal = self.unit(0.3, 0.2, 1.0)
        depth = self.plane_depth(normal, 2.0).astype(np.float32)
        depth[10, 10:13] = np.nan
        depth[30, 40], depth[30, 42] = np.inf, 0.0
        normals = self.of_depth(depth)
        missing = np.isnan(normals).all(-1)
        expected = ~(np.isfinite(depth) & (depth > 0))
        expected[30, 41] = True  # no neighbour on either side
        np.testing.assert_array_equal(missing, expected)
        present = normals[~missing]
        np.testing.assert_allclose(
            present, np.broadcast_to(normal, present.shape), **tolerance("amplified")
        )

    @pytest.mark.parametrize("shape", [(1, 1), (1, 5), (5, 1), (3, 3)])
    def test_lines_and_coinciding_points_have_no_normals(self, shape):
        assert np.isnan(ops.surface_normals(jnp.ones((*shape, 3)))).all()

    def test_gradients_are_finite_next_to_missing_points(self):
        def slant(depth):
            normals = ops.surface_normals(ops.back_project(depth, self.camera))
            return jnp.where(jnp.isfinite(normals), normals, 0.0)[..., 0].sum()

        depth = jnp.ones((4, 5)).at[1, 2].set(jnp.nan).at[2, 2].set(jnp.inf).at[3, 3].set(1.01)
        gradient = jax.grad(slant)(depth)
        assert np.isfinite(gradient).all()
        assert float(jnp.abs(gradient).max()) > 0.1
        assert gradient[1, 2] == 0.0
