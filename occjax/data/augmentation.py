"""Random augmentation of training light fields together with their ground truth.

Each function takes a random key and one sample (no batch axis). :func:`augment` applies all of them
with the settings of an :class:`AugmentationConfig`. Every parameter is drawn once per light field,
because all views show the same scene; only noise differs in every pixel of every view.
"""

from __future__ import annotations

from functools import partial
from typing import get_args

import jax
import jax.numpy as jnp
from jaxtyping import Array, Key

from occjax.data.config import AugmentationConfig
from occjax.data.samples import LightFieldSample
from occjax.data.transforms import Symmetry, crop, transform_sample
from occjax.errors import InputError


def augment(
    key: Key[Array, ""], sample: LightFieldSample, config: AugmentationConfig
) -> LightFieldSample:
    """Augment one sample: crop, then symmetry, tone and noise.

    Args:
        key: Random key.
        sample: One sample (no batch axis).
        config: Settings of the augmentation.

    Returns:
        The augmented sample of ``config.crop`` pixels, with its transformed ground truth.

    Raises:
        InputError: If the views are smaller than the crop, or if patches that are not square would
            be transposed.

    Example:
        >>> from occjax.data.samples import numpy_sample, to_device
        >>> from occjax.lightfield import view_offsets
        >>> images = jnp.full((3, 3, 20, 24), 0.5).__array__()
        >>> sample = to_device(numpy_sample(images, view_offsets(3, 3), images[1, 1]))
        >>> augment(jax.random.key(0), sample, AugmentationConfig(crop=(16, 16))).views.shape
        (3, 3, 16, 16)
    """
    crop_key, symmetry_key, tone_key, noise_key = jax.random.split(key, 4)
    if config.crop is not None:
        sample = random_crop(crop_key, sample, config.crop)
    sample = random_symmetry(symmetry_key, sample, flips=config.flips, turns=config.turns)
    return random_noise(noise_key, random_tone(tone_key, sample, config), config)


@partial(jax.jit, static_argnames="config")
def augment_batch(
    keys: Key[Array, " b"], batch: LightFieldSample, config: AugmentationConfig
) -> LightFieldSample:
    """Augment each sample of a batch, see :func:`augment`.

    On a CPU the samples are processed one after the other, so that a change that is not drawn is
    not computed. Elsewhere the function is vmapped, which gives the same result.

    Args:
        keys: ``[b]`` random keys, one for each sample.
        batch: Samples with a leading axis.
        config: Settings of the augmentation.
    """
    augment_one = partial(augment, config=config)
    return jax.lax.platform_dependent(
        keys,
        batch,
        cpu=lambda keys, batch: jax.lax.map(lambda item: augment_one(*item), (keys, batch)),
        default=jax.vmap(augment_one),
    )


def random_crop(
    key: Key[Array, ""], sample: LightFieldSample, size: tuple[int, int]
) -> LightFieldSample:
    """Cut a patch of ``(h, w)`` pixels out of a sample at a random position.

    Raises:
        InputError: If the views are smaller than the patch.
    """
    room = jnp.array(sample.disparity.shape, jnp.int32) - jnp.array(size, jnp.int32)
    return crop(sample, jax.random.randint(key, (2,), 0, room + 1), size)


def random_symmetry(
    key: Key[Array, ""], sample: LightFieldSample, *, flips: bool = True, turns: bool = True
) -> LightFieldSample:
    """Flip and transpose a sample, pixels and views together, each with probability 1/2.

    Raises:
        InputError: If a patch that is not square would be transposed.
    """
    height, width = sample.disparity.shape
    if turns and height != width:
        raise InputError(
            f"patches of {height}x{width} pixels cannot be transposed; pass a square crop or set "
            "turns to False"
        )
    drawn = jax.random.bernoulli(key, shape=(3,))
    for symmetry, happens in zip(get_args(Symmetry), drawn, strict=True):
        allowed = turns if symmetry == "transpose" else flips
        if allowed:
            transform = partial(transform_sample, symmetry=symmetry)
            sample = jax.lax.cond(happens, transform, lambda same: same, sample)
    return sample


def random_tone(
    key: Key[Array, ""], sample: LightFieldSample, config: AugmentationConfig
) -> LightFieldSample:
    """Change the exposure of a sample: ``contrast * (views ** gamma - 1/2) + 1/2 + brightness``.

    The views are clipped to [0, 1].
    """
    if config.gamma == config.contrast == 1.0 and config.brightness == 0.0:
        return sample
    drawn = jax.random.uniform(key, (3,), minval=-1.0, maxval=1.0)
    views = sample.views
    if config.gamma != 1.0:
        views = views ** (config.gamma ** drawn[0])
    views = config.contrast ** drawn[1] * (views - 0.5) + 0.5 + config.brightness * drawn[2]
    return sample._replace(views=jnp.clip(views, 0.0, 1.0))


def random_noise(
    key: Key[Array, ""], sample: LightFieldSample, config: AugmentationConfig
) -> LightFieldSample:
    """Add Gaussian noise of random strength, independent in every pixel of every view.

    The views are clipped to [0, 1].
    """
    if config.noise == 0.0 or config.noise_probability == 0.0:
        return sample
    strength_key, choice_key, noise_key = jax.random.split(key, 3)
    strength = jax.random.uniform(strength_key, maxval=config.noise)

    def add_noise(views):
        noise = jax.random.normal(noise_key, views.shape, views.dtype)
        return jnp.clip(views + strength * noise, 0.0, 1.0)

    happens = jax.random.bernoulli(choice_key, config.noise_probability)
    views = jax.lax.cond(happens, add_noise, lambda same: same, sample.views)
    return sample._replace(views=views)
