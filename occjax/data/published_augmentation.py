"""Training patches drawn and varied as the published network's were.

For light fields of the HCI benchmark's folders, in NumPy: patches are small, and what is redrawn
until it is good enough suits no compiler. All randomness is the generator's that is passed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from occjax.data.host import numpy_sample
from occjax.data.samples import Sample
from occjax.data.scenes import Scene
from occjax.data.transforms import flip_rows, rotate
from occjax.errors import InputError

PATCH = 32
"""Rows and columns of a patch, in pixels."""

STRIDES = (8 / 17, 6 / 17, 3 / 17)
"""Probabilities of strides 1, 2 and 3."""

TEXTURE = 0.01
"""Mean grey difference to the patch's middle pixel that a patch has at least."""

MASKED_SHARE = 0.25
"""How often a scene with a mask is drawn, relative to one without."""

NOISY = 1 / 12
"""Probability of noise."""

ATTEMPTS = 10_000
"""Patches drawn in vain until the scenes are taken to be at fault."""


def published_sample(generator: np.random.Generator, scenes: Sequence[Scene]) -> Sample:
    """A random patch of one of the scenes, varied.

    Args:
        generator: Source of randomness.
        scenes: Colour light fields with ground truth.

    Returns:
        One sample of NumPy arrays, ``32 x 32`` pixels.

    Raises:
        InputError: If no patch has texture and full ground truth.
    """
    sample = published_patch(generator, scenes)
    return published_noise(
        generator, published_symmetry(generator, published_gamma(generator, sample))
    )


def published_patch(generator: np.random.Generator, scenes: Sequence[Scene]) -> Sample:
    """A patch at random: scene, grey, stride and place are redrawn until it is fit to learn from.

    It is not if it touches a mask, or if it is flat: if the grey values of the centre view differ
    from that of the middle pixel by less than 0.01 on average.

    Args:
        generator: Source of randomness.
        scenes: Light fields with ground truth; those with a mask are drawn a quarter as often.

    Returns:
        One sample; every pixel of the centre view, or every second or third, with its disparity
        divided by the stride.

    Raises:
        InputError: If there are no scenes, or none has a patch that is fit.
    """
    if not scenes:
        raise InputError("there are no scenes to draw patches from")
    frequency = np.array([MASKED_SHARE if scene.masked else 1.0 for scene in scenes])
    for _ in range(ATTEMPTS):
        scene = scenes[generator.choice(len(scenes), p=frequency / frequency.sum())]
        weights = 0.05 + generator.uniform(size=3)
        stride = 1 + int(generator.choice(3, p=STRIDES))
        room = np.array(scene.disparity.shape) - stride * PATCH
        if room.min() < 0:
            continue
        top, left = generator.integers(0, room + 1)
        patch = np.s_[top : top + stride * PATCH : stride, left : left + stride * PATCH : stride]
        if not scene.valid[patch].all():
            continue
        views = scene.grey(patch, weights)
        v, u = views.shape[:2]
        centre = views[v // 2, u // 2]
        if np.abs(centre - centre[PATCH // 2, PATCH // 2]).sum() < TEXTURE * PATCH**2:
            continue
        return numpy_sample(views, scene.offsets, scene.disparity[patch] / np.float32(stride))
    raise InputError(
        f"{', '.join(scene.name for scene in scenes[:3])}: {ATTEMPTS} patches of {PATCH}x{PATCH} "
        "were flat or masked; use scenes with texture, larger ones or fewer masks"
    )


def published_gamma(generator: np.random.Generator, sample: Sample) -> Sample:
    """Views to the power of U(0.8, 1.2).

    Args:
        generator: Source of randomness.
        sample: One sample.

    Returns:
        The sample, darker or brighter.
    """
    return sample._replace(views=sample.views ** np.float32(generator.uniform(0.8, 1.2)))


def published_symmetry(generator: np.random.Generator, sample: Sample) -> Sample:
    """Flipped upside down every second time, then turned by 0 to 3 right angles; views too.

    Args:
        generator: Source of randomness.
        sample: One square sample.

    Returns:
        The sample or one of its seven mirror images and turns.
    """
    if generator.integers(2):
        sample = flip_rows(sample)
    return rotate(sample, int(generator.integers(4)))


def published_noise(generator: np.random.Generator, sample: Sample) -> Sample:
    """Gaussian noise in one of twelve samples, of standard deviation U(0, 1) sqrt(0.2).

    Args:
        generator: Source of randomness.
        sample: One sample.

    Returns:
        The sample, its views clipped to [0, 1].
    """
    if generator.uniform() >= NOISY:
        return sample
    strength = generator.uniform() * np.sqrt(0.2)
    noise = generator.normal(scale=strength, size=sample.views.shape).astype(np.float32)
    return sample._replace(views=(sample.views + noise).clip(0.0, 1.0))
