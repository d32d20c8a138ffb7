"""First hits of rays against root finding in NumPy, ray by ray, in float64."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.data.procedural.surfaces import Geometry, Quadrics, first_hits
from tests.reference.surfaces import first_hit

LIMITS = (-3.0, 4.0)


PLANE = {
    "matrix": np.eye(3),
    "translation": np.zeros(3),
    "quadratic": np.zeros(3),
    "linear": -1.0,
    "constant": 0.0,
    "half_extent": np.full(3, 1e6),
}
NOWHERE = {"translation": np.array([0.0, 0.0, -1e4])}
NO_SOLID = {"half_extent": np.full(3, -1.0), "linear": 0.0, "constant": -1.0}
CHECKERED = (np.add.outer(np.arange(8) // 2, np.arange(8) // 2) % 2 == 0)[None]

jitted_hits = jax.jit(first_hits)


def hits_of(scene, y, x, offset):
    """First hits of rays, by one compiled program for each shape."""
    return jitted_hits(scene, *(jnp.asarray(part, jnp.float32) for part in (y, x, offset)))


def quadrics(*items):
    """Quadrics from what differs from the plane d = 0."""
    return Quadrics(
        **{
            name: jnp.asarray(np.stack([{**PLANE, **item}[name] for item in items]), jnp.float32)
            for name in Quadrics._fields
        }
    )


def geometry(walls=(), sheet=NOWHERE, solid=NO_SOLID):
    """A backdrop, two walls, a sheet and a solid, absent unless given: compiled once for all."""
    backdrop = {"translation": np.array([0.0, 0.0, -LIMITS[0]])}
    return Geometry(
        walls=quadrics(backdrop, *(*walls, NOWHERE, NOWHERE)[:2]),
        sheets=quadrics(sheet),
        outlines=jnp.asarray(CHECKERED),
        solids=quadrics(solid),
        disparity_range=jnp.asarray(LIMITS, jnp.float32),
    )


def placed(x, y, d, size, turn=0.6, tilt=0.5, relief=12.0):
    """Local coordinates of something turned and tilted, ``relief`` pixels deep per disparity."""
    c, s, ct, st = np.cos(turn), np.sin(turn), np.cos(tilt), np.sin(tilt)
    rotation = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ np.array(
        [[1, 0, 0], [0, ct, st], [0, -st, ct]]
    )
    linear = rotation @ np.diag([1.0, 1.0, relief]) / np.asarray(size)[:, None]
    return {"matrix": linear, "translation": -linear @ np.array([x, y, d])}


ROUND = {"linear": 0.0, "constant": -1.0, "quadratic": np.ones(3), "half_extent": np.full(3, 1.01)}
CYLINDER = {
    **ROUND,
    "quadratic": np.array([1.0, 1.0, 0.0]),
    "half_extent": np.array([1.01, 1.01, 1.0]),
}
BOX = {**ROUND, "quadratic": np.zeros(3), "half_extent": np.ones(3)}
SCENES = {
    "tilted plane": geometry(
        walls=[
            {
                "matrix": np.array([[1, 0, 0], [0, 1, 0], [-0.03, 0.02, 1]]),
                "translation": -np.array([0, 0, 0.7]),
            }
        ]
    ),
    "bowl and dome": geometry(
        walls=[
            {"quadratic": np.array([0.004, -0.002, 0.0]), "translation": np.array([3.0, 0.0, 1.0])},
            {"quadratic": np.array([-0.01, 0.0, 0.0]), "translation": np.array([0.0, -2.0, -0.5])},
        ]
    ),
    "flat sheet": geometry(sheet=placed(2.0, -1.0, 1.0, (9, 6, 9))),
    "bent sheet": geometry(
        sheet={
            **placed(-2.0, 1.0, 1.0, (9, 7, 9), tilt=0.9),
            "quadratic": np.array([0.8, -0.5, 0.0]),
        }
    ),
    "ellipsoid": geometry(solid={**placed(1.0, 2.0, 0.5, (8, 5, 6)), **ROUND}),
    "cylinder": geometry(solid={**placed(-3.0, 0.0, 0.5, (5, 5, 8), tilt=1.2), **CYLINDER}),
    "box": geometry(solid={**placed(0.0, 0.0, 1.0, (7, 5, 9), tilt=0.8), **BOX}),
    "box cut by the limit": geometry(solid={**placed(0.0, 0.0, 3.9, (7, 5, 9)), **BOX}),
}


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("offset", [(0.0, 0.0), (2.0, -3.0)])
def test_the_nearest_surface_is_found(name, offset, tolerance):
    scene = SCENES[name]
    rows, columns = np.mgrid[-10:10:1.3, -12:12:1.3]
    hits = hits_of(scene, rows, columns, offset)
    scene = jax.tree.map(np.asarray, scene)
    expected = np.array(
        [first_hit(scene, y, x, offset) for y, x in zip(rows.ravel(), columns.ravel(), strict=True)]
    )
    disparity, surface, clear = expected.T
    assert (surface > 0).sum() > 20
    clear = clear > 0.5
    assert clear.mean() > 0.9
    np.testing.assert_array_equal(np.ravel(hits.surface)[clear], surface[clear])
    np.testing.assert_allclose(
        np.ravel(hits.disparity)[clear], disparity[clear], **tolerance("float32")
    )


@pytest.mark.parametrize("offset", [(0.0, 0.0), (4.0, -4.0), (0.5, 3.0)])
def test_disparity_of_a_slanted_plane_off_centre(offset, tolerance):
    a, b, c = 0.7, 0.03, -0.02
    scene = SCENES["tilted plane"]
    y, x = np.mgrid[-16:17:4.0, -16:17:4.0]
    t, s = offset
    expected = (a + b * x + c * y) / (1.0 - b * s - c * t)
    found = hits_of(scene, y, x, offset)
    np.testing.assert_allclose(found.disparity, expected, **tolerance("absolute"))


def test_without_surfaces_all_rays_meet_the_backdrop():
    hits = hits_of(geometry(), np.zeros((2, 3)), np.ones((2, 3)), (1.0, 2.0))
    assert (np.asarray(hits.surface) == 0).all()
    np.testing.assert_array_equal(hits.disparity, np.full((2, 3), LIMITS[0], np.float32))
