"""Closed-form intersections against NumPy in float64."""

import jax.numpy as jnp
import numpy as np
import pytest

from occjax.data import poses
from occjax.data import surfaces as s
from occjax.data.textures import material

GREY = material()
POSE = poses.compose(
    poses.translation(30.0, -12.0, 55.0), poses.rotation("z", 25.0), poses.rotation("x", 40.0)
)


def rays(count=400, spread=60.0, seed=0):
    """Rays from a distance towards the neighbourhood of the pose."""
    random = np.random.default_rng(seed)
    origins = random.normal(size=(count, 3)) * 10.0 + np.array([0.0, 0.0, 400.0])
    targets = random.uniform(-spread, spread, (count, 3)) + np.array([30.0, -12.0, 55.0])
    return origins.astype(np.float32), (targets - origins).astype(np.float32)


def nearest(surface, origins, directions):
    hits = s.first_hits(surface, jnp.asarray(origins), jnp.asarray(directions), 0.0)
    return np.asarray(hits.distance, np.float64)


def own_rays(origins, directions):
    """The rays in the coordinates of the pose, in float64."""
    pose = np.asarray(POSE, np.float64)
    inverse = np.linalg.inv(pose[:, :3])
    return (origins - pose[:, 3]) @ inverse.T, directions.astype(np.float64) @ inverse.T


def assert_same_hits(found, expected, near_edge):
    """Equal distances; rays that graze an edge may go either way."""
    clear = ~near_edge
    np.testing.assert_array_equal(np.isfinite(found)[clear], np.isfinite(expected)[clear])
    both = clear & np.isfinite(expected)
    assert both.sum() > 20
    np.testing.assert_allclose(found[both], expected[both], rtol=0, atol=2e-6)


def test_a_sphere_is_hit_where_the_quadratic_formula_says():
    origins, directions = rays()
    radius = 35.0
    found = nearest(s.ellipsoid(POSE, GREY, (radius,) * 3), origins, directions)
    o, d = own_rays(origins, directions)
    a, b, c = (d * d).sum(1), (o * d).sum(1), (o * o).sum(1) - radius**2
    root = b * b - a * c
    expected = np.where(root >= 0, (-b - np.sqrt(np.maximum(root, 0))) / a, np.inf)
    assert_same_hits(found, expected, np.abs(root) < 1e-3 * b * b)


def test_a_box_is_hit_where_the_slab_method_says():
    origins, directions = rays()
    half = np.array([20.0, 45.0, 9.0])
    found = nearest(s.box(POSE, (GREY,) * 3, tuple(half)), origins, directions)
    o, d = own_rays(origins, directions)
    one, other = (-half - o) / d, (half - o) / d
    enter, leave = np.minimum(one, other).max(1), np.maximum(one, other).min(1)
    expected = np.where(enter <= leave, enter, np.inf)
    assert_same_hits(found, expected, np.abs(enter - leave) < 1e-3)


def test_a_cylinder_is_open_at_both_ends():
    origins, directions = rays()
    surface = s.tube(POSE, GREY, bottom=-30.0, top=20.0, radius=25.0)
    found = nearest(surface, origins, directions)
    o, d = own_rays(origins, directions)
    a, b = (d[:, :2] ** 2).sum(1), (o[:, :2] * d[:, :2]).sum(1)
    root = b * b - a * ((o[:, :2] ** 2).sum(1) - 625.0)
    expected = np.full(len(o), np.inf)
    edge = np.abs(root) < 1e-3 * b * b
    for sign in (1.0, -1.0):  # the nearer wall last, so that it wins
        distance = (-b + sign * np.sqrt(np.maximum(root, 0))) / a
        height = o[:, 2] + distance * d[:, 2]
        edge |= (np.abs(height + 30.0) < 0.01) | (np.abs(height - 20.0) < 0.01)
        expected = np.where((root >= 0) & (height >= -30) & (height <= 20), distance, expected)
    assert_same_hits(found, expected, edge)


def test_a_leaf_is_pointed_at_both_ends_and_as_wide_as_asked():
    flat = s.leaf(poses.translation(0.0, 0.0, 0.0), GREY, length=20.0, width=8.0)
    x = np.array([-0.1, 0.1, 10.0, 10.0, 19.9, 20.1], np.float32)
    y = np.array([0.0, 0.0, 3.99, 4.01, 0.0, 0.0], np.float32)
    origins = np.stack([x, y, np.full_like(x, 50.0)], axis=1)
    directions = np.tile(np.array([[0.0, 0.0, -1.0]], np.float32), (6, 1))
    hit = np.isfinite(nearest(flat, origins, directions))
    assert hit.tolist() == [False, True, True, False, True, False]


def test_a_bent_leaf_rises_in_the_middle_and_starts_at_its_stalk():
    bent = s.leaf(poses.translation(0.0, 0.0, 0.0), GREY, length=20.0, width=8.0, bend=3.0)
    x = np.array([0.01, 10.0, 19.99], np.float32)
    origins = np.stack([x, 0 * x, np.full_like(x, 50.0)], axis=1)
    directions = np.tile(np.array([[0.0, 0.0, -1.0]], np.float32), (3, 1))
    height = 50.0 - nearest(bent, origins, directions)
    np.testing.assert_allclose(height, [0.0, 3.0, 0.0], atol=0.02)


def test_the_nearest_of_several_surfaces_wins():
    behind = s.plane(poses.translation(0.0, 0.0, -10.0), GREY)
    front = s.disc(poses.translation(0.0, 0.0, 5.0), GREY, radius=4.0)
    scene = s.join(behind, front)
    origins = jnp.array([[0.0, 0.0, 20.0], [9.0, 0.0, 20.0], [0.0, 0.0, -15.0]])
    directions = jnp.tile(jnp.array([[0.0, 0.0, -1.0]]), (3, 1))
    hits = s.first_hits(scene, origins, directions, 0.0)
    assert hits.distance.tolist() == [15.0, 30.0, np.inf]
    assert hits.surface[:2].tolist() == [1, 0]


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_rotations_turn_right_handed(axis):
    turned = np.asarray(poses.rotation(axis, 90.0))[:, :3]
    first, second = {"x": "yz", "y": "zx", "z": "xy"}[axis]
    np.testing.assert_allclose(
        turned @ np.eye(3)["xyz".index(first)], np.eye(3)["xyz".index(second)], atol=1e-7
    )


def test_normals_point_away_from_an_ellipsoid():
    surface = s.ellipsoid(POSE, GREY, (10.0, 20.0, 30.0))
    direction = np.random.default_rng(1).normal(size=(50, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    own = direction * np.array([10.0, 20.0, 30.0])
    pose = np.asarray(POSE, np.float64)
    expected = (own / np.array([100.0, 400.0, 900.0])) @ np.linalg.inv(pose[:, :3])
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    index = jnp.zeros(50, jnp.int32)
    found = s.normals(surface, index, jnp.asarray(own, jnp.float32))
    np.testing.assert_allclose(found, expected, atol=1e-5)
