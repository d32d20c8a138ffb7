"""White level and mask of the vignette."""

import jax.numpy as jnp
import numpy as np

from occjax.models.proposal.exposure import vignette_mask, white_level


def test_one_pixel_in_a_hundred_exceeds_white():
    grey = np.random.default_rng(0).uniform(0.0, 0.5, (100, 100)).astype(np.float32)
    assert np.mean(grey > float(white_level(jnp.asarray(grey)[None, None]))) == 0.01


def test_white_of_a_nearly_black_view_is_positive():
    grey = jnp.zeros((50, 50)).at[0, 0].set(0.8)
    assert abs(float(white_level(grey[None, None])) - 0.008) < 1e-6
    assert float(white_level(jnp.zeros((1, 1, 5, 5)))) > 0


def test_white_of_a_black_centre_view_is_that_of_the_others():
    views = jnp.full((1, 3, 8, 8), 0.6).at[0, 1].set(0.0)
    assert abs(float(white_level(views)) - 0.006) < 1e-8


def test_vignette_reaches_the_border_and_dark_objects_do_not():
    expected = np.zeros((8, 9), bool)
    expected[:2, :3] = True
    grey = np.where(expected, 0.0, 0.5).astype(np.float32)
    grey[4:6, 4:6] = 0.0  # a dark object
    np.testing.assert_array_equal(vignette_mask(jnp.asarray(grey), 0.01), expected)
