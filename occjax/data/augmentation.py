"""Random variation of training light fields that stays true to their ground truth.

Functions take a key and one sample (no batch axis); :func:`augment` composes them as an
:class:`AugmentationConfig` says. What is drawn is drawn once for the light field, since all its
views are of one scene, except for noise, which differs in every pixel of every view.

For a batch, :func:`augment_batch` on a CPU takes one sample after the other, so that what is not
drawn is not computed either. ``jax.vmap``, what others do, gives the same, but evaluates both sides
of every choice.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Key

from occjax.data.samples import Sample
from occjax.data.transforms import flip_columns, flip_rows, frame, transpose
from occjax.errors import InputError


@dataclass(frozen=True)
class AugmentationConfig:
    """How training light fields are varied.

    Attributes:
        crop: ``(height, width)`` of the patch that is cut out at random; None for the whole views.
        strides: Relative frequencies of taking every pixel, every second, every third and so on;
            disparity is divided by the stride. Larger strides than 1 need larger views.
        shear: Largest disparity added or subtracted by refocusing, in pixels of the result. Frames
            of the outer views move by it times their offset and stay within the views, so there
            must be room: where the views are hardly larger than ``crop``, less is added.
        whole_shear: Whether only whole numbers are added, so that pixels stay as the camera took
            them; otherwise views are interpolated, some more and some less.
        flips: Whether light fields are flipped, each way with probability 1/2.
        turns: Whether rows and columns are exchanged with probability 1/2 (square patches only);
            with flips, all eight symmetries of a square come up equally often.
        gamma: Largest exponent of brightness; drawn from ``[1 / gamma, gamma]`` on a log scale.
        contrast: Largest factor about mid-grey; drawn from ``[1 / contrast, contrast]`` likewise.
        brightness: Largest grey added or subtracted.
        noise: Largest standard deviation of Gaussian noise; drawn uniformly from 0.
        noise_probability: Share of the light fields that get noise.
    """

    crop: tuple[int, int] | None = None
    strides: tuple[float, ...] = (1.0,)
    shear: float = 0.0
    whole_shear: bool = True
    flips: bool = True
    turns: bool = True
    gamma: float = 1.2
    contrast: float = 1.2
    brightness: float = 0.1
    noise: float = 0.03
    noise_probability: float = 0.5

    def __post_init__(self) -> None:
        """Refuse what no sample can satisfy."""
        if self.crop is not None and min(self.crop) < 1:
            raise InputError(f"crop is {self.crop}; it must be a positive height and width")
        if self.turns and self.crop is not None and self.crop[0] != self.crop[1]:
            raise InputError(f"crop is {self.crop}; make it square or set turns to False")
        if min(self.strides, default=0.0) < 0.0 or sum(self.strides) <= 0.0:
            raise InputError(f"strides are {self.strides}; they must be frequencies, not all zero")
        if min(self.gamma, self.contrast) < 1.0:
            raise InputError("gamma and contrast are largest factors; they must be at least 1")
        if min(self.shear, self.brightness, self.noise) < 0.0:
            raise InputError("shear, brightness and noise are largest amounts; none is negative")
        if not 0.0 <= self.noise_probability <= 1.0:
            raise InputError(
                f"noise_probability is {self.noise_probability}; it must be between 0 and 1"
            )

    @property
    def largest_stride(self) -> int:
        """Largest stride that is ever drawn."""
        return max(number for number, often in enumerate(self.strides, start=1) if often > 0.0)

    def window(self, reach: float) -> tuple[int, int] | None:
        """Size of views that leave room for the largest stride and shear of a patch.

        Args:
            reach: Largest offset of a view from the centre view, in view steps.
        """
        if self.crop is None:
            return None
        stride = self.largest_stride
        margin = -int(-self.shear * stride * reach // 1)
        height, width = ((size - 1) * stride + 1 + 2 * margin for size in self.crop)
        return height, width


def augment(key: Key[Array, ""], sample: Sample, config: AugmentationConfig) -> Sample:
    """Vary one sample: frame, then symmetry, tone and noise.

    Args:
        key: Random key.
        sample: One sample; vmap for a batch.
        config: What is varied how much.

    Returns:
        A sample as consistent with its ground truth as the given one, in patches of ``config.crop``
        pixels.

    Raises:
        InputError: If the views are too small for ``config``, or turned without being square.

    Example:
        >>> from occjax.ops import view_offsets
        >>> images = jnp.full((3, 3, 20, 24), 0.5)
        >>> seen = jnp.ones((3, 3, 20, 24), bool)
        >>> sample = Sample(images, view_offsets(3, 3), images[1, 1], seen, seen[1, 1])
        >>> augment(jax.random.key(0), sample, AugmentationConfig(crop=(16, 16))).views.shape
        (3, 3, 16, 16)
    """
    for_frame, for_symmetry, for_tone, for_noise = jax.random.split(key, 4)
    height, width = sample.disparity.shape
    sample = random_frame(
        for_frame,
        sample,
        size=config.crop or (height, width),
        strides=config.strides,
        shear=config.shear,
        whole_shear=config.whole_shear,
    )
    sample = random_symmetry(for_symmetry, sample, flips=config.flips, turns=config.turns)
    sample = random_tone(
        for_tone,
        sample,
        gamma=config.gamma,
        contrast=config.contrast,
        brightness=config.brightness,
    )
    return random_noise(
        for_noise, sample, largest=config.noise, probability=config.noise_probability
    )


@partial(jax.jit, static_argnames="config")
def augment_batch(keys: Key[Array, " b"], batch: Sample, config: AugmentationConfig) -> Sample:
    """Vary each sample of a batch, see :func:`augment`.

    Args:
        keys: ``[b]`` random keys, one for each sample.
        batch: Samples with a leading axis.
        config: What is varied how much.

    Returns:
        The varied batch.
    """
    one = partial(augment, config=config)
    return jax.lax.platform_dependent(
        keys,
        batch,
        cpu=lambda keys, batch: jax.lax.map(lambda each: one(*each), (keys, batch)),
        default=jax.vmap(one),
    )


def random_frame(
    key: Key[Array, ""],
    sample: Sample,
    *,
    size: tuple[int, int],
    strides: tuple[float, ...] = (1.0,),
    shear: float = 0.0,
    whole_shear: bool = True,
) -> Sample:
    """Cut out a patch at random, of every pixel or fewer, and refocus by a random disparity.

    The frames of all views lie within the views: no pixel is invented. What is drawn first limits
    what is drawn next, in the order of stride, shear, place.

    Args:
        key: Random key.
        sample: One sample.
        size: ``(h, w)`` of the patch.
        strides: Relative frequencies of strides 1, 2, 3 and so on.
        shear: Largest disparity that is added or subtracted, as far as there is room.
        whole_shear: Whether it is a whole number.

    Returns:
        The patch.

    Raises:
        InputError: If the views are smaller than a patch of the largest stride.
    """
    views_size = jnp.array(sample.disparity.shape, jnp.int32)
    largest = max(number for number, often in enumerate(strides, start=1) if often > 0.0)
    needed = tuple((length - 1) * largest + 1 for length in size)
    if any(a > b for a, b in zip(needed, sample.disparity.shape, strict=True)):
        raise InputError(
            f"patches of {size[0]}x{size[1]} with stride {largest} need views of at least "
            f"{needed[0]}x{needed[1]} pixels, not {'x'.join(map(str, sample.disparity.shape))}"
        )
    if largest == 1 and shear == 0.0 and size == sample.disparity.shape:
        return sample  # nothing to draw, nothing to copy
    for_stride, for_shear, for_corner = jax.random.split(key, 3)

    share = jnp.cumsum(jnp.array(strides, jnp.float32)) / sum(strides)
    drawn = jax.random.uniform(for_stride)
    stride = jnp.minimum(1 + jnp.sum((drawn >= share).astype(jnp.int32)), largest)
    room = views_size - ((jnp.array(size, jnp.int32) - 1) * stride + 1)

    motion = stride.astype(jnp.float32) * jnp.max(jnp.abs(sample.offsets), axis=(0, 1))
    affordable = (room // 2).astype(jnp.float32) / jnp.maximum(motion, 1e-6)
    limit = jnp.minimum(shear, jnp.min(affordable))
    if whole_shear:
        whole = jnp.floor(limit + 1e-4).astype(jnp.int32)
        amount = jax.random.randint(for_shear, (), -whole, whole + 1).astype(jnp.float32)
    else:
        amount = jax.random.uniform(for_shear, (), minval=-limit, maxval=limit)

    margin = jnp.ceil(jnp.abs(amount) * motion - 1e-3).astype(jnp.int32)
    corner = jax.random.randint(for_corner, (2,), margin, room - margin + 1)
    interpolate = shear > 0.0 and not whole_shear
    return frame(sample, corner, size, stride=stride, shear=amount, interpolate=interpolate)


def random_symmetry(
    key: Key[Array, ""], sample: Sample, *, flips: bool = True, turns: bool = True
) -> Sample:
    """Flip and transpose at random, pixels and views together.

    Args:
        key: Random key.
        sample: One sample.
        flips: Whether rows and columns are each reversed with probability 1/2.
        turns: Whether rows and columns are exchanged with probability 1/2; then the patch must be
            square.

    Returns:
        The sample or one of its mirror images and turns.

    Raises:
        InputError: If a patch that is not square shall be turned.
    """
    height, width = sample.disparity.shape
    if turns and height != width:
        raise InputError(f"patches of {height}x{width} cannot be turned; crop them square")
    drawn = jax.random.bernoulli(key, shape=(3,))
    changes = [(transpose, turns), (flip_rows, flips), (flip_columns, flips)]
    for (change, wanted), happens in zip(changes, drawn, strict=True):
        if wanted:
            sample = jax.lax.cond(happens, change, lambda same: same, sample)
    return sample


def random_tone(
    key: Key[Array, ""],
    sample: Sample,
    *,
    gamma: float = 1.2,
    contrast: float = 1.2,
    brightness: float = 0.1,
) -> Sample:
    """Another exposure of the same scene: ``contrast * (views ** gamma - 1/2) + 1/2 + brightness``.

    Args:
        key: Random key.
        sample: One sample.
        gamma: Largest exponent, at least 1; its inverse is the smallest.
        contrast: Largest factor, at least 1; its inverse is the smallest.
        brightness: Largest grey added or subtracted.

    Returns:
        The sample, its views clipped to [0, 1].
    """
    if gamma == contrast == 1.0 and brightness == 0.0:
        return sample
    drawn = jax.random.uniform(key, (3,), minval=-1.0, maxval=1.0)
    views = sample.views
    if gamma != 1.0:
        views = views ** (gamma ** drawn[0])
    views = contrast ** drawn[1] * (views - 0.5) + 0.5 + brightness * drawn[2]
    return sample._replace(views=jnp.clip(views, 0.0, 1.0))


def random_noise(
    key: Key[Array, ""], sample: Sample, *, largest: float = 0.03, probability: float = 1.0
) -> Sample:
    """Gaussian noise, independent in every pixel of every view, of random strength.

    Args:
        key: Random key.
        sample: One sample.
        largest: Largest standard deviation; drawn uniformly between 0 and this.
        probability: Share of the samples that get noise.

    Returns:
        The sample, its views clipped to [0, 1].
    """
    if largest == 0.0 or probability == 0.0:
        return sample
    for_strength, for_choice, for_noise = jax.random.split(key, 3)
    strength = jax.random.uniform(for_strength, maxval=largest)

    def noisy(views):
        noise = jax.random.normal(for_noise, views.shape, views.dtype)
        return jnp.clip(views + strength * noise, 0.0, 1.0)

    happens = jax.random.bernoulli(for_choice, probability)
    return sample._replace(views=jax.lax.cond(happens, noisy, lambda same: same, sample.views))
