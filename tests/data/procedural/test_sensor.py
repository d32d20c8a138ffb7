"""Camera defects."""

import jax
import jax.numpy as jnp
import numpy as np

from occjax.data.procedural import Defects
from occjax.data.procedural.sensor import add_camera_defects

NONE = Defects(noise=0.0, vignetting=0.0, blur=0.0, gamma=0.0, quantisation=0.0)
OFFSETS = jnp.array([[-1.0, 0.0], [0.0, 0.0], [1.0, 1.0]])
VIEWS = jnp.asarray(np.random.default_rng(0).uniform(0.2, 0.8, (3, 24, 32)).astype(np.float32))
KEYS = jax.random.split(jax.random.key(0), 6)


def exposed(**probabilities):
    defects = Defects(**{**NONE.__dict__, **probabilities})
    return np.asarray(jax.vmap(lambda key: add_camera_defects(key, VIEWS, OFFSETS, defects))(KEYS))


def test_a_camera_without_faults_only_sets_the_exposure(tolerance):
    for views in exposed():
        unclipped = views < 1.0
        ratio = views[unclipped] / np.asarray(VIEWS)[unclipped]
        np.testing.assert_allclose(ratio, ratio[0], **tolerance("relative"))


def test_quantised_values_are_those_of_8_bits():
    values = exposed(quantisation=1.0) * 255.0
    np.testing.assert_allclose(values, np.round(values), atol=1e-4)  # rounding of 255


def test_noise_and_blur_change_what_they_should():
    clean, noisy, blurred = exposed(), exposed(noise=1.0), exposed(blur=1.0)
    assert (np.abs(noisy - clean).mean(axis=(1, 2, 3)) > 1e-5).all()
    contrast = [np.abs(np.diff(views, axis=-1)).mean(axis=(1, 2, 3)) for views in (clean, blurred)]
    assert (contrast[1] < contrast[0]).all()
    # Blur keeps the mean, but for what is clipped and the border.
    np.testing.assert_allclose(blurred.mean(), clean.mean(), rtol=0.02)


def test_vignetting_darkens_one_place_more_than_another():
    ratio = exposed(vignetting=1.0) / np.maximum(exposed(), 1e-6)
    spread = ratio.max(axis=(1, 2, 3)) - ratio.min(axis=(1, 2, 3))
    assert (spread > 0.01).all()
