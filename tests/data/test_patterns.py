"""Textures, outlines, noise and photographs."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.data.draws import Draws
from occjax.data.patterns import noise, textures
from occjax.data.photographs import load_photographs
from occjax.data.scene_config import Textures
from occjax.errors import InputError

KEY = jax.random.key(3)


def drawn(kinds, photographs=None, share=0.0, count=3):
    draw = jax.jit(
        lambda key: textures(Draws(key), key, count, kinds, photographs, share),
    )
    return np.asarray(draw(KEY))


@pytest.mark.parametrize("exponent", [0.5, 1.5])
def test_noise_has_the_spectrum_asked_for(exponent):
    def one(value):
        return jnp.full((4, 1, 1), value, jnp.float32)

    pair = jax.jit(partial(noise, count=4, size=128))(
        KEY, exponent=one(exponent), angle=one(0.3), stretch=one(1.0), coarsest=one(1.0)
    )
    frequency = np.hypot(*np.meshgrid(*(np.fft.fftfreq(128, 1 / 128),) * 2))
    for fields in np.asarray(pair):
        np.testing.assert_allclose(fields.mean(axis=(1, 2)), 0.0, atol=1e-4)
        np.testing.assert_allclose(fields.std(axis=(1, 2)), 1.0, rtol=1e-3)
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


def test_photographs_become_textures():
    photograph = np.random.default_rng(0).uniform(size=(1, 256, 256)).astype(np.float32)
    found = drawn(Textures(), jnp.asarray(photograph), 1.0)
    expected = np.clip(
        (photograph[0] - photograph.mean()) / (2.5 * (photograph.std() + 1e-3)), -1, 1
    )
    mirrored = [
        image[::i, ::j] for image in (expected, expected.T) for i in (1, -1) for j in (1, -1)
    ]
    for texture in found:
        assert min(np.abs(texture - image).max() for image in mirrored) < 1e-5


def test_photographs_come_from_scikit_image():
    pytest.importorskip("skimage")
    photographs = load_photographs()
    assert photographs.shape[1:] == (256, 256)
    assert photographs.dtype == np.float32
    assert len(photographs) > 20
    assert photographs.min() >= 0.0
    assert photographs.max() <= 1.0
    assert (photographs.std(axis=(1, 2)) > 0.0).all()


def test_without_scikit_image_the_cure_is_named(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match="pip install scikit-image"):
        load_photographs()
