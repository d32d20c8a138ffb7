"""Normals of surfaces whose normal is known in closed form."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax import ops
from occjax.lightfield import Calibration
from tests.ops.derivatives import assert_derivatives

SIZE = (60, 80)
CAMERA = Calibration(
    focal_length_mm=50.0, sensor_size_mm=35.0, baseline_mm=40.0, focus_distance_m=3.0
)


def rays():
    """``[h, w, 3]`` directions of the pixels, one metre along the optical axis."""
    height, width = SIZE
    focal_length = 50.0 / 35.0 * max(SIZE)
    y, x = np.mgrid[:height, :width]
    right, up = (x - (width - 1) / 2) / focal_length, ((height - 1) / 2 - y) / focal_length
    return np.stack([right, up, -np.ones(SIZE)], axis=-1)


def plane_depth(normal, distance):
    """Depth of the plane ``normal . P = -distance``, where depth times the ray is on it."""
    return -distance / (rays() @ normal)


def sphere_depth(centre, radius):
    """Depth of the nearer crossing of each ray with a sphere; infinite where there is none."""
    directions = rays()
    a = (directions**2).sum(-1)
    b = directions @ centre
    root = b**2 - a * (centre @ centre - radius**2)
    return np.where(root > 0, (b - np.sqrt(np.maximum(root, 0))) / a, np.inf)


def unit(*vector):
    return np.array(vector) / np.linalg.norm(vector)


def disparity_of(depth):
    """``f b (1 / Z - 1 / focus)``, rounded as it is in a file."""
    return (50.0 / 35.0 * max(SIZE) * 0.04 * (1 / depth - 1 / 3.0)).astype(np.float32)


@jax.jit
def normals_of_depth(depth):
    return ops.surface_normals(ops.back_project(depth, CAMERA))


@jax.jit
def normals_of_disparity(disparity):
    return normals_of_depth(ops.depth_from_disparity(disparity, CAMERA))


def degrees(found, expected):
    """Angle between unit vectors."""
    return np.degrees(2 * np.arcsin(np.linalg.norm(found - expected, axis=-1) / 2))


@pytest.mark.parametrize(
    "normal",
    [
        unit(0.0, 0.0, 1.0),
        unit(0.6, 0.0, 1.0),
        unit(0.0, -0.8, 1.0),
        unit(-0.5, 0.9, 0.7),
        unit(1.0, 1.0, 1.0),
    ],
)
def test_a_slanted_plane_has_its_normal_everywhere_to_the_border(normal):
    normals = np.asarray(normals_of_disparity(disparity_of(plane_depth(normal, 2.0))))
    np.testing.assert_allclose(normals, np.broadcast_to(normal, normals.shape), atol=1e-3)


def test_in_double_precision_the_plane_is_exact(x64):
    normal = unit(-0.5, 0.9, 0.7)
    normals = np.asarray(normals_of_depth(plane_depth(normal, 2.0)))
    np.testing.assert_allclose(normals, np.broadcast_to(normal, normals.shape), atol=1e-10)


def test_a_sphere_before_a_wall_and_the_wall_up_to_its_outline():
    centre, radius = np.array([0.1, 0.05, -2.0]), 0.4
    wall_normal = unit(0.2, 0.1, 1.0)
    sphere, wall = sphere_depth(centre, radius), plane_depth(wall_normal, 3.5)
    on_sphere = np.isfinite(sphere)
    assert 500 < on_sphere.sum() < 2500
    normals = np.asarray(normals_of_disparity(disparity_of(np.where(on_sphere, sphere, wall))))
    # Where the sphere ends does not show in the wall.
    np.testing.assert_allclose(
        normals[~on_sphere], np.broadcast_to(wall_normal, normals[~on_sphere].shape), atol=1e-3
    )
    directions = rays()[on_sphere]
    exact = (directions * sphere[on_sphere, None] - centre) / radius
    towards_viewer = -(exact * directions).sum(-1) / np.linalg.norm(directions, axis=-1)
    error = degrees(normals[on_sphere], exact)
    assert error[towards_viewer > 0.5].max() < 0.5  # seen at less than 60 degrees
    assert np.median(error) < 0.1
    # The outermost of its 23 pixels, seen one-sidedly, spans the angle acos(1 - 1 / 23).
    assert error.max() < np.degrees(np.arccos(1 - 1 / 23))


def test_every_normal_is_a_unit_vector_that_faces_the_viewer():
    depth = np.random.default_rng(0).uniform(1.0, 5.0, SIZE).astype(np.float32)
    normals = np.asarray(normals_of_depth(depth))
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0, atol=1e-5)
    assert ((normals * rays()).sum(-1) < 0).all()


def test_a_step_between_two_walls_shows_on_neither():
    depth = np.full(SIZE, 4.0, np.float32)
    depth[20:40, 30:60] = 2.0
    normals = np.asarray(normals_of_depth(depth))
    np.testing.assert_allclose(normals, np.broadcast_to([0.0, 0.0, 1.0], normals.shape), atol=1e-4)
    points = ops.back_project(jnp.asarray(depth), CAMERA)
    blind = np.asarray(ops.surface_normals(points, edge=np.inf))
    assert degrees(blind, [0.0, 0.0, 1.0]).max() > 80.0  # without the rule it does


def test_missing_points_are_stepped_around():
    depth = plane_depth(unit(0.3, 0.2, 1.0), 2.0).astype(np.float32)
    depth[10, 10:13] = np.nan
    depth[30, 40], depth[30, 42] = np.inf, 0.0
    normals = np.asarray(normals_of_depth(depth))
    missing = np.isnan(normals).all(-1)
    expected = ~(np.isfinite(depth) & (depth > 0))
    expected[30, 41] = True  # no neighbour on either side
    np.testing.assert_array_equal(missing, expected)
    np.testing.assert_array_equal(np.isnan(normals).any(-1), missing)
    there = normals[~missing]
    np.testing.assert_allclose(there, np.broadcast_to(unit(0.3, 0.2, 1.0), there.shape), atol=1e-3)


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (5, 1)])
def test_a_line_of_pixels_has_no_normals(shape):
    assert np.isnan(ops.surface_normals(jnp.ones((*shape, 3)))).all()


def test_points_in_one_place_have_no_normal():
    assert np.isnan(ops.surface_normals(jnp.ones((3, 3, 3)))).all()


def test_batches_are_as_one_by_one(tolerance):
    depth = np.random.default_rng(1).uniform(1.0, 1.1, (2, 5, 6)).astype(np.float32)
    expected = np.stack([normals_of_depth(each) for each in depth])
    batch = jax.vmap(normals_of_depth)(depth)
    np.testing.assert_allclose(batch, expected, **tolerance("float32"))


def test_derivatives_agree(x64):
    depth = np.random.default_rng(2).uniform(1.0, 1.1, (4, 5))
    depth[:, 3:] += 1.0  # an edge

    def normals(depth):
        return ops.surface_normals(ops.back_project(depth, CAMERA))

    assert_derivatives(normals, depth)


def test_gradients_are_finite_beside_missing_points():
    def slant(depth):
        normals = ops.surface_normals(ops.back_project(depth, CAMERA))
        return jnp.where(jnp.isfinite(normals), normals, 0.0)[..., 0].sum()

    depth = jnp.ones((4, 5)).at[1, 2].set(jnp.nan).at[2, 2].set(jnp.inf).at[3, 3].set(1.01)
    gradient = jax.grad(slant)(depth)
    assert np.isfinite(gradient).all()
    assert float(jnp.abs(gradient).max()) > 0.1
    assert gradient[1, 2] == 0.0
