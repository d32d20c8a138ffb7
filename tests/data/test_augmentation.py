"""Random variation: its amounts, its frequencies, and that the ground truth follows."""

import dataclasses
from collections import Counter

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.data.augmentation import (
    AugmentationConfig,
    augment,
    augment_batch,
    random_crop,
    random_noise,
    random_symmetry,
    random_tone,
)
from occjax.data.samples import numpy_sample, to_device
from occjax.errors import InputError
from occjax.lightfield import view_offsets
from tests.data.scenes import assert_consistent, disc_before_a_wall

PLAIN = AugmentationConfig(gamma=1.0, contrast=1.0, brightness=0.0, noise=0.0)
"""Geometry alone."""


def sample_of(image, grid=(1, 1)):
    """A sample of equal views."""
    views = np.tile(np.asarray(image, np.float32), (*grid, 1, 1))
    return to_device(numpy_sample(views, view_offsets(*grid), views[0, 0]))


def indexed(size, grid=(1, 1)):
    """A sample whose views show the place of their pixels: 1000 row + column."""
    return sample_of(1000.0 * np.arange(size[0])[:, None] + np.arange(size[1]), grid)


def test_the_varied_light_field_is_consistent_with_its_ground_truth():
    config = dataclasses.replace(PLAIN, crop=(44, 44))
    hidden = 0
    for number in range(4):
        scene = disc_before_a_wall(view_offsets(5, 5), size=(62, 68), seed=number)
        batches = [jax.tree.map(lambda field: field[None], one) for one in scene]
        keys = jnp.stack([jax.random.key(number)])
        varied = [augment_batch(keys, batch, config) for batch in batches]
        hidden += assert_consistent(*(jax.tree.map(lambda field: field[0], one) for one in varied))
    assert hidden > 50


def test_every_place_of_the_patch_is_drawn():
    sample = indexed((6, 7))
    cut = jax.jit(jax.vmap(lambda key: random_crop(key, sample, (4, 4)).views[0, 0, 0, 0]))
    corners = np.asarray(cut(jax.random.split(jax.random.key(0), 300)))
    expected = {1000.0 * row + column for row in range(3) for column in range(4)}
    assert set(corners.tolist()) == expected


def test_all_eight_symmetries_of_a_square_are_equally_likely():
    sample = indexed((2, 2), grid=(3, 3))
    turn = jax.jit(jax.vmap(lambda key: random_symmetry(key, sample).views[1, 1]))
    images = np.asarray(turn(jax.random.split(jax.random.key(2), 800)))
    counts = Counter(tuple(image.ravel().tolist()) for image in images)
    assert len(counts) == 8
    assert min(counts.values()) > 100 - 4 * 10
    for image in counts:  # neighbours stay neighbours
        assert image[0] + image[3] == image[1] + image[2] == 1001


def test_without_flips_and_turns_the_sample_stays_as_it_is():
    sample = indexed((2, 3), grid=(3, 3))
    same = random_symmetry(jax.random.key(0), sample, flips=False, turns=False)
    jax.tree.map(np.testing.assert_array_equal, same, sample)


def test_gamma_is_one_curve_for_all_pixels_of_all_views(tolerance):
    sample = sample_of(np.linspace(0.0, 1.0, 22).reshape(2, 11), grid=(2, 3))
    config = dataclasses.replace(PLAIN, gamma=1.5)
    exponents = []
    for number in range(30):
        changed = random_tone(jax.random.key(number), sample, config)
        views, before = (np.asarray(one.views)[..., 0, 1:] for one in (changed, sample))
        exponent = np.log(views) / np.log(before)
        np.testing.assert_allclose(exponent, exponent[0, 0, 0], **tolerance("float32"))
        exponents.append(exponent[0, 0, 0])
        unchanged = changed._replace(views=sample.views)
        jax.tree.map(np.testing.assert_array_equal, unchanged, sample)
    assert 1 / 1.5 - 1e-4 <= min(exponents) < 0.75
    assert 1.3 < max(exponents) <= 1.5 + 1e-4


def test_contrast_and_brightness_are_linear_in_the_grey_and_within_their_limits(tolerance):
    sample = sample_of([[0.4, 0.5, 0.6]])
    config = dataclasses.replace(PLAIN, contrast=1.5, brightness=0.1)
    keys = jax.random.split(jax.random.key(3), 400)
    change = jax.vmap(lambda key: random_tone(key, sample, config).views[0, 0, 0])
    low, middle, high = np.asarray(change(keys)).T
    contrast, brightness = (high - low) / 0.2, middle - 0.5
    np.testing.assert_allclose(high - middle, middle - low, **tolerance("absolute"))
    assert (np.abs(np.log(contrast)) <= np.log(1.5) + 1e-5).all()
    assert (np.abs(brightness) <= 0.1 + 1e-6).all()
    assert abs(np.log(contrast).mean()) < 4 * np.log(1.5) / np.sqrt(3 * 400)
    assert np.abs(brightness).max() > 0.095
    assert contrast.max() > 1.45


def test_noise_is_independent_in_every_pixel_and_as_strong_as_drawn():
    sample = sample_of(np.full((40, 40), 0.5), grid=(3, 3))
    config = dataclasses.replace(PLAIN, noise=0.05, noise_probability=1.0)
    add_noise = jax.jit(lambda key: random_noise(key, sample, config).views)
    strengths = []
    for number in range(12):
        noise = np.asarray(add_noise(jax.random.key(number))) - 0.5
        strength = noise.std()
        strengths.append(strength)
        assert abs(noise.mean()) < 5 * strength / np.sqrt(noise.size)
        flat = noise.reshape(9, -1)
        between = np.corrcoef(flat)[~np.eye(9, dtype=bool)]
        assert np.abs(between).max() < 5 / np.sqrt(flat.shape[1])
        tails = np.mean(np.abs(noise) > 2 * strength)  # 4.55 % of a Gaussian's
        assert abs(tails - 0.0455) < 5 * np.sqrt(0.0455 / noise.size)
    assert 0.035 < max(strengths) <= 0.051
    assert min(strengths) < 0.015


def test_noise_is_as_frequent_as_its_probability():
    sample = sample_of(np.full((4, 4), 0.5))
    config = dataclasses.replace(PLAIN, noise=0.03, noise_probability=0.25)
    keys = jax.random.split(jax.random.key(4), 400)
    changed = jax.vmap(lambda key: random_noise(key, sample, config).views)(keys)
    share = np.mean(np.any(np.asarray(changed) != 0.5, axis=(1, 2, 3, 4)))
    assert abs(share - 0.25) < 4 * np.sqrt(0.25 * 0.75 / 400)
    assert random_noise(keys[0], sample, PLAIN) is sample


@pytest.mark.usefixtures("platform")
def test_a_batch_is_varied_as_its_samples_are(tolerance):
    config = AugmentationConfig(crop=(10, 10))
    sample, _ = disc_before_a_wall(view_offsets(3, 3), size=(14, 15))
    batch = jax.tree.map(lambda field: jnp.stack([field, field]), sample)
    keys = jax.random.split(jax.random.key(5), 2)
    varied = augment_batch(keys, batch, config)
    vmapped = jax.jit(jax.vmap(lambda key, one: augment(key, one, config)))(keys, batch)
    for one, other in zip(varied, vmapped, strict=True):
        assert one.shape == other.shape
        np.testing.assert_allclose(
            np.asarray(one, np.float32), np.asarray(other, np.float32), **tolerance("absolute")
        )
    assert not np.allclose(varied.views[0], varied.views[1])
    assert 0.0 <= float(varied.views.min()) <= float(varied.views.max()) <= 1.0


@pytest.mark.parametrize(
    "options",
    [
        {"crop": (0, 8), "turns": False},
        {"crop": (8, 9)},
        {"gamma": 0.9},
        {"contrast": 0.0},
        {"noise": -0.1},
        {"noise_probability": 1.1},
    ],
)
def test_impossible_configurations_are_refused(options):
    with pytest.raises(InputError):
        AugmentationConfig(**options)


def test_turning_views_that_are_not_square_is_refused():
    with pytest.raises(InputError, match="square"):
        random_symmetry(jax.random.key(0), indexed((4, 5)))
