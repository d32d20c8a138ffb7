"""The published training of OccCasNet: its recipe and its training patches.

Both are those of the published code (Chao et al., 2023), for scenes of the HCI 4D benchmark. The
augmentation runs in NumPy: patches are small, and redrawing a patch until it is accepted does not
suit a compiler. All randomness comes from the generator that is passed.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from occjax.data.folders import grain_batches
from occjax.data.procedural import SceneConfig
from occjax.data.samples import LightFieldSample, numpy_sample, to_device
from occjax.data.scenes import Scene
from occjax.data.sources import ALL_ROWS, Source
from occjax.data.transforms import transform_sample
from occjax.errors import InputError
from occjax.lightfield import centre_index
from occjax.models import preset
from occjax.training import DataConfig, LossConfig, OptimiserConfig, Recipe, RunConfig, TrainConfig

EPOCH_STEPS = 4000
"""Number of steps per epoch."""

PATCH_SIZE_PX = 32
"""Rows and columns of a patch."""

STRIDE_PROBABILITIES = (8 / 17, 6 / 17, 3 / 17)
"""Probabilities of strides 1, 2 and 3."""

MIN_MEAN_CONTRAST = 0.01
"""Smallest accepted mean absolute grey difference between a patch and its middle pixel."""

MASKED_SCENE_FREQUENCY = 0.25
"""How often a scene with a mask is drawn, relative to a scene without one."""

NOISE_PROBABILITY = 1 / 12
"""Probability that a patch gets noise."""

MAX_ATTEMPTS = 10_000
"""Number of rejected patches after which an error is raised."""


def published_recipe() -> Recipe:
    """Return the published training: 120 epochs of 4000 steps of 32 patches."""
    network = preset("occcasnet", feature_statistics="per_view")
    optimiser = OptimiserConfig(
        peak_rate=1e-3, schedule="halving", epoch_steps=EPOCH_STEPS, halving_epochs=30
    )
    size = (PATCH_SIZE_PX, PATCH_SIZE_PX)
    scenes = SceneConfig(image_size=size, grid=network.views, views="all")
    return Recipe(
        TrainConfig(network, LossConfig(), optimiser, steps=120 * EPOCH_STEPS, ema_decay=0.0),
        DataConfig(batch_size=32, procedural_share=0.0, scenes=scenes),
        RunConfig(validate_every=EPOCH_STEPS),
    )


def published_source(
    scenes: Sequence[Scene], batch_size: int, seed: int, *, threads: int = 2
) -> Source:
    """Return a source of patches with the augmentation of the published network.

    Args:
        scenes: The additional scenes of the HCI benchmark, or others.
        batch_size: Patches per step.
        seed: Seed of everything that is drawn; 0 to 2^32 - 1.
        threads: Number of threads that prepare patches ahead; 0 prepares them when needed.

    Returns:
        The source.

    Raises:
        InputError: If the seed is out of range or grain is missing; when called, if there are no
            scenes or none has an acceptable patch.
    """
    batches = grain_batches(partial(published_sample, scenes=scenes), batch_size, seed, threads)
    return lambda step, rows=ALL_ROWS, /: to_device(batches(step, rows))


def published_sample(generator: np.random.Generator, scenes: Sequence[Scene]) -> LightFieldSample:
    """Draw a patch of one of the scenes and change its gamma, symmetry and noise at random.

    Args:
        generator: Source of randomness.
        scenes: Colour light fields with ground truth.

    Returns:
        One sample of NumPy arrays, ``32 x 32`` pixels.

    Raises:
        InputError: If no patch has texture and complete ground truth.
    """
    sample = published_patch(generator, scenes)
    sample = published_gamma(generator, sample)
    sample = published_symmetry(generator, sample)
    return published_noise(generator, sample)


def published_patch(generator: np.random.Generator, scenes: Sequence[Scene]) -> LightFieldSample:
    """Draw a patch; scene, grey weights, stride and place are redrawn until it is accepted.

    A patch is rejected if it touches a mask, or if it is flat: if the grey values of the centre
    view differ from that of the middle pixel by less than 0.01 on average.

    Args:
        generator: Source of randomness.
        scenes: Light fields with ground truth; those with a mask are drawn a quarter as often.

    Returns:
        One sample of every pixel, every second or every third pixel, its disparity divided by the
        stride.

    Raises:
        InputError: If there are no scenes, or if no patch is accepted.
    """
    if not scenes:
        raise InputError("there are no scenes to draw patches from")
    frequency = np.array([MASKED_SCENE_FREQUENCY if scene.masked else 1.0 for scene in scenes])
    size = PATCH_SIZE_PX
    for _ in range(MAX_ATTEMPTS):
        scene = scenes[generator.choice(len(scenes), p=frequency / frequency.sum())]
        weights = 0.05 + generator.uniform(size=3)
        stride = 1 + int(generator.choice(3, p=STRIDE_PROBABILITIES))
        room = np.array(scene.disparity.shape) - stride * size
        if room.min() < 0:
            continue
        top, left = generator.integers(0, room + 1)
        patch = np.s_[top : top + stride * size : stride, left : left + stride * size : stride]
        if not scene.valid[patch].all():
            continue
        views = scene.grey(patch, weights)
        centre = views[centre_index(views.shape[:2])]
        difference = np.abs(centre - centre[size // 2, size // 2])
        if difference.sum() < MIN_MEAN_CONTRAST * size**2:
            continue
        return numpy_sample(views, scene.offsets, scene.disparity[patch] / np.float32(stride))
    raise InputError(
        f"{', '.join(scene.name for scene in scenes[:3])}: {MAX_ATTEMPTS} patches of {size}x{size} "
        "pixels were flat or masked; use larger scenes, scenes with more texture or fewer masks"
    )


def published_gamma(generator: np.random.Generator, sample: LightFieldSample) -> LightFieldSample:
    """Raise the views to a power drawn from U(0.8, 1.2)."""
    return sample._replace(views=sample.views ** np.float32(generator.uniform(0.8, 1.2)))


def published_symmetry(
    generator: np.random.Generator, sample: LightFieldSample
) -> LightFieldSample:
    """Flip rows with probability 1/2, then rotate by 0 to 3 right angles; pixels and views."""
    if generator.integers(2):
        sample = transform_sample(sample, "flip_rows")
    for _ in range(generator.integers(4)):
        sample = transform_sample(transform_sample(sample, "transpose"), "flip_rows")
    return sample


def published_noise(generator: np.random.Generator, sample: LightFieldSample) -> LightFieldSample:
    """Add Gaussian noise to one in twelve samples, of standard deviation U(0, 1) sqrt(0.2).

    The views are clipped to [0, 1].
    """
    if generator.uniform() >= NOISE_PROBABILITY:
        return sample
    strength = generator.uniform() * np.sqrt(0.2)
    noise = generator.normal(scale=strength, size=sample.views.shape).astype(np.float32)
    return sample._replace(views=(sample.views + noise).clip(0.0, 1.0))
