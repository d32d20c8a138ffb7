"""Random variation: what it may do, how often it does it, and that the ground truth follows."""

import dataclasses
from collections import Counter

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.data import augmentation
from occjax.data.augmentation import (
    AugmentationConfig,
    augment,
    augment_batch,
    random_frame,
    random_noise,
    random_symmetry,
    random_tone,
)
from occjax.data.samples import Sample
from occjax.errors import InputError
from tests.data.scenes import assert_consistent, disc_before_a_wall, grid, star

PLAIN = AugmentationConfig(gamma=1.0, contrast=1.0, brightness=0.0, noise=0.0)
"""Geometry alone."""


def indexed(offsets, size):
    """A sample whose every view shows where its pixels are: 1000 row + column."""
    image = 1000.0 * np.arange(size[0])[:, None] + np.arange(size[1])
    views = np.tile(image, (*offsets.shape[:2], 1, 1)).astype(np.float32)
    seen = np.ones(views.shape, bool)
    parts = (views, offsets, np.full(size, 0.6, np.float32), seen, seen[0, 0])
    return Sample(*map(jnp.asarray, parts))


@pytest.fixture(scope="module")
def scenes():
    """Three scenes of 25 views, and their masks."""
    return [disc_before_a_wall(grid(5, 5), size=(62, 68), seed=seed) for seed in range(3)]


@pytest.mark.parametrize(
    ("config", "tolerance"),
    [
        (dataclasses.replace(PLAIN, crop=(36, 36), shear=2.0), 0.02),
        (dataclasses.replace(PLAIN, crop=(36, 36), shear=1.3, whole_shear=False), 0.02),
        (dataclasses.replace(PLAIN, crop=(18, 18), strides=(1.0, 1.0, 1.0), shear=1.0), 0.04),
    ],
    ids=["whole shear", "shear between pixels", "strides"],
)
def test_the_varied_light_field_is_consistent_with_its_ground_truth(scenes, config, tolerance):
    hidden = 0
    for number in range(6):
        sample, masks = scenes[number % 3]
        keys = jnp.stack([jax.random.key(number)])
        varied = [
            jax.tree.map(lambda field: field[0], augment_batch(keys, batch, config))
            for batch in (jax.tree.map(lambda field: field[None], one) for one in (sample, masks))
        ]
        hidden += assert_consistent(*varied, tolerance, ringing=not config.whole_shear)
    assert hidden > 50


def test_frames_of_all_views_lie_within_the_views():
    """No pixel is invented: each is the one that the formula names."""
    sample = indexed(star(5), (30, 33))
    size, shears = (12, 10), set()
    cut = jax.jit(lambda key: random_frame(key, sample, size=size, strides=(1.0, 1.0), shear=3.0))
    for number in range(40):
        framed = cut(jax.random.key(number))
        views = np.asarray(framed.views)
        stride = round(float(views[0, 0, 1, 0] - views[0, 0, 0, 0]) / 1000)
        shear = float(framed.disparity[0, 0]) - 0.6 / stride
        shears.add((stride, round(shear)))
        corner = np.array(divmod(views[0, 8, 0, 0], 1000))
        for index, offset in enumerate(np.asarray(sample.offsets)[0]):
            rows = corner[0] + stride * (np.arange(12) + round(shear) * offset[0])
            columns = corner[1] + stride * (np.arange(10) + round(shear) * offset[1])
            assert min(rows.min(), columns.min()) >= 0
            assert rows.max() < 30
            assert columns.max() < 33
            np.testing.assert_allclose(views[0, index], 1000 * rows[:, None] + columns)
    # Stride 1 leaves (30 - 12) // 2 = 9 pixels: 3 steps of shear at an offset of 2 are 6;
    # stride 2 leaves (30 - 23) // 2 = 3: no step of 4 pixels.
    assert shears == {(1, step) for step in range(-3, 4)} | {(2, 0)}


def test_every_place_of_the_patch_comes_up():
    sample = indexed(grid(1, 1), (6, 7))
    cut = jax.jit(jax.vmap(lambda key: random_frame(key, sample, size=(4, 4)).views[0, 0, 0, 0]))
    corners = np.asarray(cut(jax.random.split(jax.random.key(0), 300)))
    assert set(corners.tolist()) == {
        1000.0 * row + column for row in range(3) for column in range(4)
    }


def test_strides_come_up_as_often_as_asked():
    sample = indexed(grid(1, 1), (13, 13))
    cut = jax.jit(
        jax.vmap(
            lambda key: random_frame(key, sample, size=(5, 5), strides=(8.0, 6.0, 3.0)).disparity[
                0, 0
            ]
        )
    )
    disparity = np.asarray(cut(jax.random.split(jax.random.key(1), 1700)))
    for stride, expected in [(1, 800), (2, 600), (3, 300)]:
        found = int(np.sum(np.isclose(disparity, 0.6 / stride)))
        assert abs(found - expected) < 4 * np.sqrt(expected)


def test_all_eight_symmetries_of_a_square_come_up_equally_often():
    sample = indexed(grid(3, 3), (2, 2))
    turned = jax.jit(jax.vmap(lambda key: random_symmetry(key, sample).views[1, 1]))(
        jax.random.split(jax.random.key(2), 800)
    )
    counts = Counter(tuple(image.ravel().tolist()) for image in np.asarray(turned))
    assert len(counts) == 8
    assert min(counts.values()) > 100 - 4 * 10
    for image in counts:  # neighbours stay neighbours
        assert image[0] + image[3] == image[1] + image[2] == 1001


def test_without_flips_and_turns_the_sample_stays_as_it_is():
    sample = indexed(grid(3, 3), (2, 3))
    for number in range(3):
        same = random_symmetry(jax.random.key(number), sample, flips=False, turns=False)
        jax.tree.map(np.testing.assert_array_equal, same, sample)


def test_tone_is_one_monotone_curve_for_all_views():
    levels = np.linspace(0.0, 1.0, 21, dtype=np.float32)
    views = np.tile(levels, (3, 3, 2, 1))
    views[0] = views[0, :, :, ::-1]
    seen = np.ones(views.shape, bool)
    sample = Sample(*map(jnp.asarray, (views, grid(3, 3), views[1, 1], seen, seen[1, 1])))
    curves = []
    for number in range(5):
        changed = random_tone(jax.random.key(number), sample, gamma=1.5, contrast=1.3)
        after = np.asarray(changed.views)
        np.testing.assert_array_equal(after[0], after[1, :, :, ::-1])
        curve = after[1, 1, 0]
        np.testing.assert_array_equal(after[1:], np.broadcast_to(curve, (2, 3, 2, 21)))
        assert (np.diff(curve) >= 0).all()
        assert 0.0 <= curve[0] < 0.3
        assert 0.7 < curve[-1] <= 1.0
        curves.append(curve)
        for field in ("offsets", "disparity", "visibility", "valid"):
            np.testing.assert_array_equal(getattr(changed, field), getattr(sample, field))
    assert np.std(curves, axis=0)[10] > 0.03


def test_contrast_and_brightness_are_linear_in_the_grey_and_bounded_as_asked():
    views = jnp.tile(jnp.array([0.4, 0.5, 0.6]), (1, 1, 1, 1))
    seen = views > 0
    sample = Sample(views, jnp.zeros((1, 1, 2)), views[0, 0], seen, seen[0, 0])
    keys = jax.random.split(jax.random.key(3), 400)
    change = jax.vmap(
        lambda key: random_tone(key, sample, gamma=1.0, contrast=1.5, brightness=0.1).views[0, 0, 0]
    )
    low, middle, high = np.asarray(change(keys)).T
    contrast, brightness = (high - low) / 0.2, middle - 0.5
    np.testing.assert_allclose(high - middle, middle - low, atol=1e-6)
    assert (np.abs(np.log(contrast)) <= np.log(1.5) + 1e-5).all()
    assert (np.abs(brightness) <= 0.1 + 1e-6).all()
    assert abs(np.log(contrast).mean()) < 4 * np.log(1.5) / np.sqrt(3 * 400)
    assert np.abs(brightness).max() > 0.095
    assert contrast.max() > 1.45


def test_noise_is_independent_in_every_pixel_and_as_strong_as_drawn():
    views = jnp.full((3, 3, 40, 40), 0.5)
    seen = views > 0
    sample = Sample(views, jnp.asarray(grid(3, 3)), views[1, 1], seen, seen[1, 1])
    strengths = []
    noisy = jax.jit(lambda key: random_noise(key, sample, largest=0.05).views)
    for number in range(12):
        noise = np.asarray(noisy(jax.random.key(number))) - 0.5
        strength = noise.std()
        strengths.append(strength)
        assert abs(noise.mean()) < 5 * strength / np.sqrt(noise.size)
        flat = noise.reshape(9, -1)
        between = np.corrcoef(flat)[~np.eye(9, dtype=bool)]
        assert np.abs(between).max() < 5 / np.sqrt(flat.shape[1])
        tails = np.mean(np.abs(noise) > 2 * strength)  # 4.55 % of a Gaussian's
        assert abs(tails - 0.0455) < 5 * np.sqrt(0.0455 / noise.size)
    assert max(strengths) <= 0.051
    assert max(strengths) > 0.035
    assert min(strengths) < 0.015


def test_noise_comes_as_often_as_asked_and_never_when_not():
    views = jnp.full((1, 1, 4, 4), 0.5)
    seen = views > 0
    sample = Sample(views, jnp.zeros((1, 1, 2)), views[0, 0], seen, seen[0, 0])
    keys = jax.random.split(jax.random.key(4), 400)
    changed = jax.vmap(lambda key: random_noise(key, sample, probability=0.25).views)(keys)
    share = np.mean(np.any(np.asarray(changed) != 0.5, axis=(1, 2, 3, 4)))
    assert abs(share - 0.25) < 4 * np.sqrt(0.25 * 0.75 / 400)
    for options in ({"probability": 0.0}, {"largest": 0.0}):
        assert random_noise(keys[0], sample, **options) is sample


@pytest.mark.usefixtures("platform")
def test_a_batch_is_varied_as_its_samples_are_and_each_otherwise():
    config = AugmentationConfig(crop=(10, 10), shear=1.0)
    sample, _ = disc_before_a_wall(grid(3, 3), size=(14, 15))
    batch = jax.tree.map(lambda field: jnp.stack([field, field]), sample)
    keys = jax.random.split(jax.random.key(5), 2)
    varied = augment_batch(keys, batch, config)
    vmapped = jax.jit(jax.vmap(lambda key, one: augment(key, one, config)))(keys, batch)
    for one, other in zip(varied, vmapped, strict=True):
        assert one.shape == other.shape
        np.testing.assert_allclose(
            np.asarray(one, np.float32), np.asarray(other, np.float32), atol=1e-5
        )
    assert not np.allclose(varied.views[0], varied.views[1])
    assert float(varied.views.min()) >= 0.0
    assert float(varied.views.max()) <= 1.0


@pytest.mark.parametrize(
    "options",
    [
        {"crop": (0, 8), "turns": False},
        {"crop": (8, 9)},
        {"strides": ()},
        {"strides": (0.0, 0.0)},
        {"strides": (1.0, -1.0)},
        {"gamma": 0.9},
        {"contrast": 0.0},
        {"noise": -0.1},
        {"noise_probability": 1.1},
    ],
)
def test_impossible_configurations_are_refused(options):
    with pytest.raises(InputError):
        AugmentationConfig(**options)


def test_views_too_small_for_patches_are_refused_with_the_size_they_need():
    sample = indexed(grid(1, 1), (20, 40))
    config = AugmentationConfig(crop=(8, 8), strides=(1.0, 0.0, 1.0))
    with pytest.raises(InputError, match="22x22"):
        augmentation.augment(jax.random.key(0), sample, config)


def test_turning_views_that_are_not_square_is_refused():
    with pytest.raises(InputError, match="square"):
        random_symmetry(jax.random.key(0), indexed(grid(1, 1), (4, 5)))


def test_the_window_leaves_room_for_every_stride_and_shear():
    config = AugmentationConfig(crop=(8, 8), strides=(1.0, 1.0), shear=1.0)
    height, width = config.window(reach=4.0)
    assert (height, width) == (15 + 2 * 8, 15 + 2 * 8)
    sample = indexed(grid(1, 9), (height, width))
    cut = jax.jit(
        lambda key: random_frame(key, sample, size=(8, 8), strides=(0.0, 1.0), shear=1.0).disparity[
            0, 0
        ]
    )
    found = {round(float(cut(jax.random.key(number))), 3) for number in range(30)}
    assert found == {-0.7, 0.3, 1.3}
