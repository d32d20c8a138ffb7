"""White and the frame of a vignette."""

import jax.numpy as jnp
import numpy as np

from occjax.ops.brightness import vignetted, white_level


def test_white_is_what_one_pixel_in_a_hundred_exceeds():
    grey = np.random.default_rng(0).uniform(0.0, 0.5, (100, 100)).astype(np.float32)
    assert np.mean(grey > float(white_level(jnp.asarray(grey)))) == 0.01


def test_white_of_a_nearly_black_view_is_not_black():
    grey = jnp.zeros((50, 50)).at[0, 0].set(0.8)
    assert abs(float(white_level(grey)) - 0.008) < 1e-6
    assert float(white_level(jnp.zeros((5, 5)))) > 0


def test_a_vignette_reaches_a_side_and_dark_things_do_not():
    grey = np.full((8, 9), 0.5, np.float32)
    grey[:2, :3] = 0.0  # a corner
    grey[4:6, 4:6] = 0.0  # a thing
    expected = np.zeros((8, 9), bool)
    expected[:2, :3] = True
    np.testing.assert_array_equal(vignetted(jnp.asarray(grey), 0.01), expected)
