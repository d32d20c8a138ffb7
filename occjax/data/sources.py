"""Sources of training data: functions from the number of a step to its batch.

A source gives the same batch for the same step, whatever it was asked before, so that training
that resumes at a step sees what it would have seen: no state to save. Sources of procedural light
fields, of pools and of folders are alike in this, and :func:`mixture` combines them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache, partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key
from tqdm import tqdm

from occjax.data.augmentation import AugmentationConfig, augment_batch
from occjax.data.generator import generate
from occjax.data.samples import Sample
from occjax.data.scene_config import SceneConfig
from occjax.data.views import Selection, select_views
from occjax.errors import InputError

Source = Callable[[int], Sample]
"""Gives the batch of a step: a sample with a leading axis on every field."""


def procedural_source(
    config: SceneConfig,
    batch_size: int,
    seed: int,
    *,
    photographs: Float[Array | np.ndarray, "p 256 256"] | None = None,
    augmentation: AugmentationConfig | None = None,
) -> Source:
    """New light fields in every step, rendered on the device: for GPUs.

    Sample ``b`` of step ``t`` is ``generate(fold_in(key(seed), t * batch_size + b))``, numbered as
    in :func:`occjax.data.pool.render_pool`.

    Args:
        config: The distribution of scenes.
        batch_size: Light fields per step.
        seed: Another seed, other light fields.
        photographs: Textures, see :func:`occjax.data.generator.generate`.
        augmentation: How they are varied further; None for not at all.

    Returns:
        The source.
    """
    check_batch_size(batch_size)
    textures = None if photographs is None else jnp.asarray(photographs)

    def source(step: int) -> Sample:
        batch = _rendered(
            jax.random.key(seed), jnp.uint32(step), textures, config=config, batch_size=batch_size
        )
        return vary(batch, augmentation, seed, step)

    return source


def kept_source(
    config: SceneConfig,
    count: int,
    batch_size: int,
    seed: int,
    *,
    photographs: Float[Array | np.ndarray, "p 256 256"] | None = None,
    augmentation: AugmentationConfig | None = None,
) -> Source:
    """Light fields rendered on the device before the first step, kept there and drawn from.

    For GPUs, where one is rendered in about the time of a step with it, and each serves for many
    patches. Their views are kept in 8 bits, so that 16,000 of 9x9 views and 64x64 pixels take 11 GB
    with their visibility. Light field ``i`` is that of :func:`procedural_source`; which of them a
    step sees is drawn anew for each step.

    Args:
        config: The distribution of scenes.
        count: Number of light fields that are kept.
        batch_size: Light fields per step.
        seed: Another seed, other light fields.
        photographs: Textures, see :func:`occjax.data.generator.generate`.
        augmentation: How they are varied further; None for not at all.

    Returns:
        The source.

    Raises:
        InputError: If there are no light fields to keep or to draw; when called, if there is no
            memory for them.
    """
    if count < 1:
        raise InputError(f"light fields to keep: {count}; there must be at least 1")
    rendered = procedural_source(config, batch_size, seed, photographs=photographs)

    @lru_cache(maxsize=1)
    def kept() -> Sample:
        batches = -(-count // batch_size)
        like = jax.eval_shape(lambda: _in_bytes(rendered(0)))
        try:
            held = jax.tree.map(lambda field: jnp.zeros((batches, *field.shape), field.dtype), like)
        except jax.errors.JaxRuntimeError as error:
            size = batches * sum(field.size * field.dtype.itemsize for field in like)
            raise InputError(
                f"{count} light fields to keep take {size / 1e9:.0f} GB, which the device has not; "
                "keep fewer"
            ) from error
        for step in tqdm(range(batches), desc="light fields", unit="batch", disable=None):
            held = _with_batch(held, rendered(step), step)
        return held

    def source(step: int) -> Sample:
        drawn = np.random.default_rng((seed, step)).integers(count, size=batch_size)
        batch = _drawn(kept(), drawn.astype(np.int32))
        return vary(batch, augmentation, seed, step)

    return source


def mixture(parts: Mapping[Source, float]) -> Source:
    """Batches in which each source has its share of the samples.

    Sources are mixed within every batch, not from batch to batch: gradients vary less from step to
    step, and the statistics of BatchNorm are those of the mixture that the network is used with.
    Where a share is not a whole number of samples, it is on average over the steps. Nothing is
    made in vain: a sample that one step does not take is taken by the next.

    Args:
        parts: Relative weight of each source. They have batches of one size and samples of one
            shape; visibility may be known to some.

    Returns:
        The source of their batch size.

    Raises:
        InputError: If there are no sources or weights are negative; when called, if the batches of
            the sources do not fit together.

    Example:
        >>> def constant(value):
        ...     images = jnp.full((4, 1, 1, 2, 2), value)
        ...     seen = images >= 0
        ...     offsets = jnp.zeros((4, 1, 1, 2))
        ...     return lambda step: Sample(images, offsets, images[:, 0, 0], seen, seen[:, 0, 0])
        >>> source = mixture({constant(0.0): 3.0, constant(1.0): 1.0})
        >>> source(7).disparity[:, 0, 0].tolist()
        [0.0, 0.0, 0.0, 1.0]
    """
    weights = list(parts.values())
    if not _are_weights(weights):
        raise InputError("a mixture needs sources with weights of zero or more, not all zero")
    # One batch serves several steps; more than two are in use when threads work ahead.
    streams = [lru_cache(maxsize=4)(source) for source in parts]

    @lru_cache(maxsize=1)
    def batch_size() -> int:
        largest = weights.index(max(weights))
        return int(streams[largest](0).disparity.shape[0])

    def mixed(step: int) -> Sample:
        first, last = (shares(weights, number * batch_size()) for number in (step, step + 1))
        pieces = [
            piece
            for stream, start, stop in zip(streams, first, last, strict=True)
            for piece in _samples(stream, start, stop, batch_size())
        ]
        return _joined(pieces)

    return mixed


def random_views(source: Source, selections: Mapping[Selection, float], seed: int) -> Source:
    """Batches with some of their views, of another arrangement from step to step.

    For networks that shall take grids of any kind. The samples of a batch have one arrangement,
    since arrays have one shape; each arrangement costs the training step one compilation.

    Args:
        source: Of samples with all views that the selections need.
        selections: Relative frequency of each selection, see
            :func:`occjax.data.views.select_views`.
        seed: Of the choice.

    Returns:
        The source.

    Raises:
        InputError: If there are no selections or frequencies are negative; when called, if the
            samples lack the views.
    """
    weights = list(selections.values())
    if not _are_weights(weights):
        raise InputError("selections need frequencies of zero or more, not all zero")
    frequencies = np.array(weights) / sum(weights)

    def selected(step: int) -> Sample:
        drawn = np.random.default_rng((seed, step)).choice(len(frequencies), p=frequencies)
        return select_views(source(step), list(selections)[drawn])

    return selected


def shares(weights: Sequence[float], total: int) -> list[int]:
    """How many of the first ``total`` samples of a mixture come from each source.

    Each source gets its part, rounded, of what those before it left. So the numbers add up, none
    becomes smaller when the total grows, and any total can be asked without those before it.

    Args:
        weights: Relative weights.
        total: Number of samples.

    Returns:
        Whole numbers that add up to the total.

    Example:
        >>> [shares([1.0, 1.0, 2.0], total) for total in (4, 5, 8)]
        [[1, 1, 2], [1, 1, 3], [2, 2, 4]]
    """
    numbers, left, weight_left = [], total, sum(weights)
    for weight in weights[:-1]:
        # The last source's weight, and any rounding of the sum, takes what is left.
        part = min(weight / weight_left, 1.0) if weight_left > 0.0 else 0.0
        numbers.append(math.floor(left * part + 0.5))
        left, weight_left = left - numbers[-1], weight_left - weight
    return [*numbers, left]


def step_keys(seed: int, step: int, batch_size: int) -> Key[Array, " b"]:
    """Random keys of the samples of a step.

    Args:
        seed: Of the source.
        step: Number of the step.
        batch_size: Number of keys b.

    Returns:
        ``[b]`` keys.
    """
    # Apart from the keys that light fields of the same seed are rendered with.
    key = jax.random.fold_in(jax.random.key(seed), 2**32 - 1)
    return jax.random.split(jax.random.fold_in(key, step), batch_size)


def vary(batch: Sample, augmentation: AugmentationConfig | None, seed: int, step: int) -> Sample:
    """A batch as a source gives it in a step: varied, or as it is.

    Args:
        batch: The samples.
        augmentation: How they are varied; None for not at all.
        seed: Of the source.
        step: Number of the step.

    Returns:
        The batch.
    """
    if augmentation is None:
        return batch
    keys = step_keys(seed, step, batch.disparity.shape[0])
    return augment_batch(keys, batch, augmentation)


def check_batch_size(batch_size: int) -> None:
    """Refuse a batch without samples.

    Args:
        batch_size: Number of samples.

    Raises:
        InputError: If it is not positive.
    """
    if batch_size < 1:
        raise InputError(f"batch_size is {batch_size}; it must be at least 1")


@partial(jax.jit, static_argnames=("config", "batch_size"))
def _rendered(
    root: Array, step: Array, photographs: Array | None, *, config: SceneConfig, batch_size: int
) -> Sample:
    """A batch of new light fields; sources that differ in their seed share what is compiled."""
    numbers = step * batch_size + jnp.arange(batch_size, dtype=jnp.uint32)
    keys = jax.vmap(partial(jax.random.fold_in, root))(numbers)
    return jax.vmap(lambda key: generate(key, config, photographs))(keys)


def _in_bytes(batch: Sample) -> Sample:
    """A batch with its views in 8 bits."""
    return batch._replace(views=jnp.round(batch.views * 255.0).astype(jnp.uint8))


@partial(jax.jit, donate_argnames="held")
def _with_batch(held: Sample, batch: Sample, number: int | Int[Array, ""]) -> Sample:
    """Batches ``[n, b, ...]`` with one of them put in its place, its views in 8 bits."""
    return jax.tree.map(lambda into, one: into.at[number].set(one), held, _in_bytes(batch))


@jax.jit
def _drawn(kept: Sample, numbers: Int[Array, " b"]) -> Sample:
    """Samples of batches ``[n, b, ...]`` by their numbers."""
    size = kept.disparity.shape[1]
    batch = jax.tree.map(lambda field: field[numbers // size, numbers % size], kept)
    return batch._replace(views=batch.views.astype(jnp.float32) / 255.0)


def _are_weights(weights: Sequence[float]) -> bool:
    """Whether something can be drawn in proportion to them."""
    return bool(weights) and min(weights) >= 0.0 and 0.0 < sum(weights) < math.inf


def _samples(stream: Source, start: int, stop: int, batch_size: int) -> Iterator[Sample]:
    """Samples number ``start`` to ``stop - 1`` of a source, in as many pieces as batches."""
    while start < stop:
        number, inside = divmod(start, batch_size)
        batch = stream(number)
        found = batch.disparity.shape[0]
        if found != batch_size:
            raise InputError(f"sources have batches of {found} and {batch_size}; make them equal")
        taken = min(stop - start, batch_size - inside)
        yield Sample(*(field[inside : inside + taken] for field in batch))
        start += taken


def _joined(pieces: list[Sample]) -> Sample:
    """One batch of the pieces."""
    shapes = {tuple(field.shape[1:] for field in piece) for piece in pieces}
    if len(shapes) != 1:
        sizes = " and ".join(str(list(shape[0])) for shape in sorted(shapes))
        raise InputError(f"sources have views of {sizes}; select and crop them alike")
    return Sample(*(jnp.concatenate(fields) for fields in zip(*pieces, strict=True)))
