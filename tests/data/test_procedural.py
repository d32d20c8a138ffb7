"""Rendered light fields against closed forms and against independent NumPy geometry."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.ndimage import maximum_filter

from occjax.data import poses, surfaces
from occjax.data.lighting import Lighting
from occjax.data.procedural import (
    Camera,
    Scene,
    centre_disparity,
    render,
    trace,
    view_visibility,
)
from occjax.data.textures import material

SIZE = (40, 56)
COMPILED_ONCE = {"grid": (3, 3), "image_size": SIZE, "samples": 3}
RELIEF = 30.0
LIGHTING = Lighting(
    direction=jnp.array([0.0, -0.6, 0.8]),
    softness=jnp.float32(0.1),
    lamp=jnp.array([0.8, 0.8, 0.8]),
    sky=jnp.array([0.3, 0.3, 0.3]),
    bounce=jnp.array([0.2, 0.2, 0.2]),
    reach=jnp.float32(20.0),
)
SMOOTH = material("plain", frequency=0.03, grain=0.5)
BALL = {"centre": (4.0, -3.0, 25.0), "radius": 9.0}


def scene_of(parts, perspective):
    return Scene(parts, Camera(jnp.float32(RELIEF), jnp.float32(perspective)), LIGHTING)


def tilted_plane(pose):
    return surfaces.plane(pose, SMOOTH)


def ball_before_a_wall(perspective):
    wall = tilted_plane(
        poses.compose(poses.translation(0.0, 0.0, -20.0), poses.rotation("y", 15.0))
    )
    ball = surfaces.ellipsoid(poses.translation(*BALL["centre"]), SMOOTH, (BALL["radius"],) * 3)
    return scene_of(surfaces.join(wall, ball), perspective)


def pixel_grid():
    y, x = np.mgrid[: SIZE[0], : SIZE[1]].astype(np.float64)
    return y, x


def plane_in_disparity(normal, distance, perspective):
    """Coefficients of d = a + b X + c Y for the plane normal . P = distance.

    From P = (X, Y, relief d) / (1 + perspective d), X and Y from the centre, multiplied out.
    """
    scale = normal[2] * RELIEF - distance * perspective
    return distance / scale, -normal[0] / scale, -normal[1] / scale


@pytest.mark.parametrize("perspective", [0.0, 0.12])
@pytest.mark.parametrize("offset", [(0.0, 0.0), (3.0, -4.0), (-2.0, 1.0)])
def test_disparity_of_a_slanted_plane_is_the_closed_form_in_every_view(perspective, offset):
    pose = poses.compose(
        poses.translation(0.0, 0.0, 12.0),
        poses.rotation("y", 22.0),
        poses.rotation("x", -31.0),
    )
    normal = np.asarray(pose, np.float64)[:, 2]
    a, b, c = plane_in_disparity(normal, normal[2] * 12.0, perspective)
    scene = scene_of(tilted_plane(pose), perspective)
    y, x = pixel_grid()
    _, found = jax.jit(trace, static_argnums=4)(
        scene, jnp.float32(y.ravel()), jnp.float32(x.ravel()), jnp.array(offset), SIZE
    )
    t, s = offset
    x, y = x - 0.5 * (SIZE[1] - 1), y - 0.5 * (SIZE[0] - 1)
    expected = (a + b * x + c * y) / (1.0 - b * s - c * t)
    assert np.ptp(expected) > 1.0
    np.testing.assert_allclose(found.reshape(SIZE), expected, atol=2e-5)


@pytest.mark.parametrize("offset", [(4.0, 4.0), (-3.0, 2.0)])
def test_visibility_is_whether_the_ball_stands_between_a_point_and_a_pinhole(offset):
    """The same question asked of Euclidean geometry in float64: a segment and a sphere."""
    perspective = 0.1
    scene = ball_before_a_wall(perspective)
    disparity = centre_disparity(scene, SIZE)
    found = np.asarray(view_visibility(scene, disparity, jnp.array(offset)))

    d = np.asarray(disparity, np.float64)
    y, x = pixel_grid()
    centred = np.stack([x - 0.5 * (SIZE[1] - 1), y - 0.5 * (SIZE[0] - 1), RELIEF * d], axis=-1)
    points = centred / (1.0 + perspective * d[..., None])
    pinhole = np.array([offset[1], offset[0], RELIEF]) / perspective
    to_pinhole = pinhole - points
    length = np.linalg.norm(to_pinhole, axis=-1)
    to_pinhole /= length[..., None]
    to_ball = np.array(BALL["centre"]) - points
    along = (to_ball * to_pinhole).sum(-1)
    miss = np.sqrt(np.maximum((to_ball**2).sum(-1) - along**2, 0.0)) - BALL["radius"]
    on_ball = np.abs(np.linalg.norm(to_ball, axis=-1) - BALL["radius"]) < 1e-2
    # From the ball itself a pinhole is hidden when it lies below the horizon.
    blocked = np.where(on_ball, along > 0.0, (miss < 0.0) & (along > 0.0))
    seen_y, seen_x = y - d * offset[0], x - d * offset[1]
    inside = (seen_y >= 0) & (seen_y <= SIZE[0] - 1) & (seen_x >= 0) & (seen_x <= SIZE[1] - 1)
    expected = inside & ~blocked
    undecided = np.where(on_ball, np.abs(along) < 1.0, np.abs(miss) < 0.02)
    assert on_ball.sum() > 100
    assert (blocked & ~on_ball & inside).sum() > 50
    assert undecided.mean() < 0.02
    np.testing.assert_array_equal(found[~undecided], expected[~undecided])


def bilinear(image, y, x):
    top, left = np.floor(y).astype(int), np.floor(x).astype(int)
    top, left = np.clip(top, 0, image.shape[0] - 2), np.clip(left, 0, image.shape[1] - 2)
    fy, fx = (y - top)[..., None], (x - left)[..., None]
    upper = image[top, left] * (1 - fx) + image[top, left + 1] * fx
    lower = image[top + 1, left] * (1 - fx) + image[top + 1, left + 1] * fx
    return upper * (1 - fy) + lower * fy


@pytest.mark.parametrize("perspective", [0.0, 0.1])
def test_visible_points_have_the_colour_that_the_centre_view_sees(perspective):
    scene = ball_before_a_wall(perspective)
    rendered = jax.tree.map(np.asarray, render(scene, **COMPILED_ONCE))
    y, x = pixel_grid()
    centre = rendered.views[1, 1]
    for v, u in [(0, 0), (0, 2), (2, 1)]:
        seen_y = y - rendered.disparity * (v - 1)
        seen_x = x - rendered.disparity * (u - 1)
        error = np.abs(bilinear(rendered.views[v, u], seen_y, seen_x) - centre).max(-1)
        # Pixels that mix ball and wall have no single disparity: leave out the ball's edge.
        jump = np.hypot(*np.gradient(rendered.disparity)) > 0.15
        near_edge = maximum_filter(jump, size=5)
        assert (~near_edge & rendered.visibility[v, u]).mean() > 0.5
        assert error[~near_edge & rendered.visibility[v, u]].max() < 0.03


def random_scene(key):
    """A wall and a ball of random place, size and look."""
    place, size, tilt, colour, pattern = jax.random.split(key, 5)
    x, y, z = jax.random.uniform(place, (3,), minval=-10.0, maxval=10.0)
    turn = jax.random.uniform(tilt, (), minval=-20.0, maxval=20.0)
    paint = material(
        jax.random.randint(pattern, (), 0, 9), ground=tuple(jax.random.uniform(colour, (3,)))
    )
    radius = jax.random.uniform(size, (), minval=5.0, maxval=9.0)
    wall = poses.compose(poses.translation(0.0, 0.0, -20.0), poses.rotation("y", turn))
    return scene_of(
        surfaces.join(
            surfaces.plane(wall, paint),
            surfaces.ellipsoid(poses.translation(x, y, z), paint, (radius, radius, radius)),
        ),
        0.1,
    )


def test_random_scenes_are_rendered_as_a_batch():
    keys = jax.random.split(jax.random.key(0), 2)
    draw = partial(render, **COMPILED_ONCE)
    batch = jax.vmap(lambda key: draw(random_scene(key)))(keys)
    for number, key in enumerate(keys):
        alone = draw(jax.jit(random_scene)(key))
        np.testing.assert_allclose(batch.disparity[number], alone.disparity, atol=1e-5)
        np.testing.assert_allclose(batch.views[number], alone.views, atol=1e-3)
        np.testing.assert_array_equal(batch.visibility[number], alone.visibility)
