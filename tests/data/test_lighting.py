"""Light against closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.data.lighting import Lighting, Seen, light_from, sampling_patterns
from occjax.data.poses import translation
from occjax.data.surfaces import disc, join, plane
from occjax.data.textures import linear_from_srgb, material

LIGHTING = Lighting(
    direction=jnp.array([0.0, 0.0, 1.0]),
    softness=jnp.float32(0.0),
    lamp=jnp.array([0.5, 0.4, 0.3]),
    sky=jnp.array([0.2, 0.3, 0.4]),
    bounce=jnp.array([0.1, 0.1, 0.1]),
    reach=jnp.float32(10.0),
)
PAPER = material(ground=(0.8, 0.6, 0.4), figure=(0.8, 0.6, 0.4), grain=0.0)
COLOUR = np.asarray(linear_from_srgb(jnp.array([0.8, 0.6, 0.4])))
SCENE = join(
    plane(translation(0.0, 0.0, 0.0), PAPER), disc(translation(50.0, 0.0, 5.0), PAPER, 8.0)
)
STRAIGHT_UP = jnp.zeros((1, 2))


@jax.jit
def light(x, direction, sky):
    seen = Seen(jnp.zeros(1, jnp.int32), jnp.stack([x, 0.0 * x, 0.0 * x])[None], direction)
    return light_from(SCENE, LIGHTING, seen, jnp.array([0.0, 0.0, 400.0]), STRAIGHT_UP, sky)[0]


DOWN = jnp.array([[0.0, 0.0, -1.0]])


def test_open_matt_paper_shines_with_its_colour_times_lamp_and_half_of_sky_and_ground():
    expected = COLOUR * (np.array([0.5, 0.4, 0.3]) + 0.5 * np.array([0.3, 0.4, 0.5]))
    np.testing.assert_allclose(light(jnp.float32(0.0), DOWN, STRAIGHT_UP), expected, rtol=1e-5)


def test_in_the_shadow_of_a_disc_only_what_sky_it_leaves_is_seen():
    # The disc is 5 pixels above, half the reach: it takes half of the sky.
    expected = COLOUR * 0.5 * 0.5 * np.array([0.3, 0.4, 0.5])
    np.testing.assert_allclose(light(jnp.float32(50.0), DOWN, STRAIGHT_UP), expected, rtol=5e-3)


@pytest.mark.parametrize("x", [0.0, 44.0, 50.0])
def test_light_is_the_same_for_every_view(x):
    slanted = jnp.array([[0.4, -0.3, -1.0]])
    sky = jnp.array([[0.3, 0.5]])
    np.testing.assert_array_equal(
        light(jnp.float32(x), DOWN, sky), light(jnp.float32(x), slanted, sky)
    )


def test_sampling_patterns_cover_the_disc_evenly():
    for points in sampling_patterns(64):
        assert np.linalg.norm(points, axis=1).max() < 1.0
        np.testing.assert_allclose(np.mean(points, axis=0), 0.0, atol=0.02)
        # The mean squared radius of a uniform disc is a half.
        np.testing.assert_allclose((np.asarray(points) ** 2).sum(1).mean(), 0.5, atol=0.01)
