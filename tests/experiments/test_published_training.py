"""The published augmentation, against its published probabilities and limits."""

import jax
import numpy as np
import pytest

from experiments.published_training import (
    published_gamma,
    published_noise,
    published_patch,
    published_recipe,
    published_sample,
    published_source,
    published_symmetry,
)
from occjax.data.samples import numpy_sample
from occjax.data.scenes import Scene
from occjax.errors import InputError
from occjax.lightfield import view_offsets
from tests.data.scenes import assert_consistent, disc_before_a_wall


def scene_of(image, *, name="scene", masked=False, valid=None, disparity=None):
    """A scene of 3x3 equal views ``[h, w, 3]`` in 0 to 255."""
    size = image.shape[:2]
    return Scene(
        name=name,
        views=np.tile(image.astype(np.uint8), (3, 3, 1, 1, 1)),
        offsets=view_offsets(3, 3),
        disparity=np.full(size, 6.0, np.float32) if disparity is None else disparity,
        valid=np.ones(size, bool) if valid is None else valid,
        masked=masked,
    )


def checks(size=(110, 120), period=2):
    """A texture without flat parts at any stride."""
    y, x = np.mgrid[: size[0], : size[1]]
    return np.tile(100 + 60 * ((7 * y + 5 * x) % 11 > period)[..., None], 3)


def patches(scenes, count, seed=0):
    generator = np.random.default_rng(seed)
    return [published_patch(generator, scenes) for _ in range(count)]


def test_strides_have_the_published_frequencies_and_divide_the_disparity():
    found = [float(patch.disparity[0, 0]) for patch in patches([scene_of(checks())], 850)]
    for stride, expected in [(1, 400), (2, 300), (3, 150)]:
        count = sum(disparity == pytest.approx(6.0 / stride) for disparity in found)
        assert abs(count - expected) < 4 * np.sqrt(expected)


def test_patches_are_every_stride_th_pixel_of_the_views(tolerance):
    y, x = np.mgrid[:110, :120]
    # Row and column, and a quarter by which to tell by what they were divided.
    scene = scene_of(checks(), disparity=(1000.0 * y + x + 0.25).astype(np.float32))
    grey = scene.views[0, 0, :, :, 0] / 255.0  # all colours alike: weights have no effect
    strides = set()
    for patch in patches([scene], 20):
        first = float(patch.disparity[0, 0])
        stride = next(k for k in (1, 2, 3) if abs(first * k % 1 - 0.25) < 0.03)
        top, left = divmod(int(first * stride), 1000)
        cut = np.s_[top : top + 32 * stride : stride, left : left + 32 * stride : stride]
        for v, u in np.ndindex(3, 3):
            np.testing.assert_allclose(patch.views[v, u], grey[cut], **tolerance("absolute"))
        np.testing.assert_allclose(
            patch.disparity * stride, scene.disparity[cut], **tolerance("relative")
        )
        strides.add(stride)
    assert strides == {1, 2, 3}


def test_grey_weights_are_as_published():
    red = checks()[..., 0] > 120
    scene = scene_of(250 * np.stack([red, ~red, 0 * red], axis=-1))
    found = patches([scene], 300)
    weights = np.array([np.unique(patch.views[1, 1].round(5)) * 255 / 250 for patch in found])
    assert weights.shape == (300, 2)
    # (0.05 + a) / (0.15 + a + b + c), a, b, c in [0, 1]; a third on average, by symmetry.
    assert weights.min() > 0.05 / 2.15
    assert weights.max() < 1.05 / 1.15
    assert abs(weights.mean() - 1 / 3) < 0.02
    assert weights.min() < 0.08
    assert weights.max() > 0.6


def test_flat_patches_are_redrawn():
    image = np.full((110, 120, 3), 128)
    image[:, 80:] = checks()[:, 80:]
    for patch in patches([scene_of(image)], 40):
        centre = patch.views[1, 1]
        assert np.abs(centre - centre[16, 16]).sum() >= 0.01 * 32**2


def test_masks_are_avoided_and_masked_scenes_are_a_quarter_as_frequent():
    valid = np.ones((110, 120), bool)
    valid[40:44] = False
    plain = scene_of(checks(), disparity=np.full((110, 120), 6.0, np.float32))
    marked = np.where(valid, -6.0, 1e6).astype(np.float32)
    masked = scene_of(checks(), disparity=marked, valid=valid, masked=True)
    unmasked_part = scene_of(checks(), disparity=marked * 0 - 6.0, masked=True)
    drawn = patches([plain, masked], 60)
    assert all(patch.disparity.max() < 100 for patch in drawn)
    assert any(patch.disparity.max() < 0 for patch in drawn)
    share = np.mean([patch.disparity.max() < 0 for patch in patches([plain, unmasked_part], 500)])
    assert abs(share - 0.2) < 4 * np.sqrt(0.2 * 0.8 / 500)


def test_scenes_without_an_acceptable_patch_are_refused():
    flat = scene_of(np.full((40, 40, 3), 90), name="flat wall")
    for scenes, message in [([flat], "flat wall"), ([], "no scenes")]:
        with pytest.raises(InputError, match=message):
            patches(scenes, 1)


def test_gamma_is_one_power_for_all_views_within_the_published_limits(tolerance):
    views = np.random.default_rng(0).uniform(0.1, 0.9, (3, 3, 4, 4)).astype(np.float32)
    sample = numpy_sample(views, view_offsets(3, 3), views[0, 0])
    powers = []
    for seed in range(60):
        changed = published_gamma(np.random.default_rng(seed), sample)
        power = np.log(changed.views) / np.log(views)
        np.testing.assert_allclose(power, power[0, 0, 0, 0], **tolerance("float32"))
        powers.append(power[0, 0, 0, 0])
    assert 0.8 <= min(powers) < 0.85
    assert 1.15 < max(powers) <= 1.2


def test_one_of_twelve_patches_has_noise_of_the_published_strength():
    views = np.full((3, 3, 32, 32), 0.5, np.float32)
    sample = numpy_sample(views, view_offsets(3, 3), views[0, 0])
    generator = np.random.default_rng(1)
    strengths = []
    for _ in range(1200):
        changed = published_noise(generator, sample).views
        assert changed.min() >= 0
        assert changed.max() <= 1
        if np.any(changed != 0.5):
            # Of the inner two thirds of a Gaussian, which clipping to [0, 1] leaves alone.
            strengths.append(np.quantile(changed, 0.8413) - 0.5)
    assert abs(len(strengths) - 100) < 4 * np.sqrt(100 * 11 / 12)
    assert max(strengths) < 1.05 * np.sqrt(0.2)
    assert abs(np.mean(strengths) - np.sqrt(0.2) / 2) < 4 * np.sqrt(0.2 / 12 / 90)


def test_all_eight_symmetries_are_drawn_and_keep_the_light_field_consistent():
    sample, masks = disc_before_a_wall(view_offsets(5, 5), size=(40, 40))
    sample, masks = jax.tree.map(np.asarray, (sample, masks))
    found = set()
    for seed in range(60):
        turned = published_symmetry(np.random.default_rng(seed), sample)
        corners = tuple(turned.disparity[[0, 0, -1, -1], [0, -1, 0, -1]].round(4).tolist())
        if corners not in found:
            turned_masks = published_symmetry(np.random.default_rng(seed), masks)
            assert assert_consistent(turned, turned_masks) > 100
        found.add(corners)
    assert len(found) == 8


def test_a_sample_has_numpy_arrays_and_depends_only_on_the_generator():
    scenes = [scene_of(checks())]
    first, again, other = (
        published_sample(np.random.default_rng(seed), scenes) for seed in (3, 3, 4)
    )
    assert all(isinstance(field, np.ndarray) for field in first)
    assert first.views.dtype == np.float32
    for one, two in zip(first, again, strict=True):
        np.testing.assert_array_equal(one, two)
    assert not np.array_equal(first.views, other.views)


def test_published_patches_depend_only_on_the_step():
    scenes = [scene_of(checks()), scene_of(checks(period=3))]
    source = published_source(scenes, 5, seed=1)
    batches = [source(step) for step in range(3)]
    assert batches[0].views.shape == (5, 3, 3, 32, 32)
    again = published_source(scenes, 5, seed=1, threads=0)
    for step in (2, 0):
        jax.tree.map(np.testing.assert_array_equal, again(step), batches[step])


def test_published_recipe_equals_the_paper():
    """120 epochs of 4000 steps of 32 patches of 32x32, Adam at 1e-3, L1 of both stages."""
    published = published_recipe()
    assert published.train.steps == 480_000
    assert published.data.batch_size == 32
    assert published.data.procedural_share == 0.0
    optimiser, loss = published.train.optimiser, published.train.loss
    assert (optimiser.peak_rate, optimiser.schedule, optimiser.weight_decay) == (1e-3, "halving", 0)
    assert (loss.penalty, loss.distribution) == ("l1", 0.0)
