"""Textures and noise."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.data.procedural import Textures
from occjax.data.procedural.draws import Draws
from occjax.data.procedural.patterns import noise, textures

KEY = jax.random.key(3)


def drawn(kinds, count):
    return np.asarray(jax.jit(lambda key: textures(Draws(key), key, count, kinds))(KEY))


@pytest.mark.parametrize("exponent", [0.5, 1.5])
def test_noise_has_the_spectrum_asked_for(exponent, tolerance):
    def one(value):
        return jnp.full((4, 1, 1), value, jnp.float32)

    pair = jax.jit(noise)(
        KEY, exponent=one(exponent), angle=one(0.3), stretch=one(1.0), coarsest=one(1.0)
    )
    frequency = np.hypot(*np.meshgrid(*(np.fft.fftfreq(256, 1 / 256),) * 2))
    for fields in np.asarray(pair):
        np.testing.assert_allclose(fields.mean(axis=(1, 2)), 0.0, **tolerance("float32"))
        np.testing.assert_allclose(fields.std(axis=(1, 2)), 1.0, **tolerance("float32"))
        power = (np.abs(np.fft.fft2(fields)) ** 2).mean(axis=0)
        low, high = (power[np.abs(frequency - middle) < 2].mean() for middle in (10.0, 40.0))
        slope = np.log(low / high) / np.log(1601.0 / 101.0)  # of f^2 + 1, the spectrum's argument
        np.testing.assert_allclose(slope, exponent, atol=0.1)
    assert abs(np.corrcoef(np.ravel(pair[0]), np.ravel(pair[1]))[0, 1]) < 0.3


def test_kinds_of_no_weight_are_not_drawn():
    none = dict.fromkeys((field.name for field in dataclasses.fields(Textures)), 0.0)
    gradients = drawn(Textures(**{**none, "gradients": 1.0}), count=6)
    stripes = drawn(Textures(**{**none, "stripes": 1.0}), count=6)
    # Gradients change far less from pixel to pixel, but for those that are mottled.
    change = [
        np.abs(np.diff(images, axis=2)).mean(axis=(1, 2)).min() for images in (gradients, stripes)
    ]
    assert change[0] < 0.2 * change[1]
    assert max(np.abs(gradients).max(), np.abs(stripes).max()) <= 1.0
