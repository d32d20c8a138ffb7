"""Sources of training data: functions from the number of a step to its batch.

A source returns the same batch for the same step, independent of earlier requests. Training that
resumes at a step therefore sees the batches of an uninterrupted run, and no state is saved. This
holds for procedural light fields, pools and folders; :func:`mixture` combines sources.

If several processes train together, each asks for its rows of the batch: ``source(step, rows)``
makes these samples only. They are those of ``source(step)``, so that the batch of a step does not
depend on the number of processes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache, partial
from typing import Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int
from tqdm import tqdm

from occjax.data.augmentation import augment_batch
from occjax.data.config import AugmentationConfig
from occjax.data.procedural import SceneConfig, generate
from occjax.data.samples import LightFieldSample
from occjax.errors import InputError

ALL_ROWS = slice(None)
"""Rows of a batch that a source returns by default."""


@runtime_checkable
class Source(Protocol):
    """Function from the step to its batch."""

    def __call__(self, step: int, rows: slice = ALL_ROWS, /) -> LightFieldSample:
        """Return the batch of a step, or some of its rows.

        Args:
            step: Number of the step.
            rows: Samples of the batch to return.

        Returns:
            A sample with a leading axis on every field.
        """
        ...


def procedural_source(
    config: SceneConfig,
    batch_size: int,
    seed: int,
    *,
    augmentation: AugmentationConfig | None = None,
) -> Source:
    """Return a source that renders new light fields on the device in every step, for GPUs.

    Sample ``b`` of step ``t`` is ``generate(fold_in(key(seed), t * batch_size + b))``, numbered as
    in :func:`occjax.data.pool.render_pool`.

    Args:
        config: The distribution of scenes.
        batch_size: Light fields per step.
        seed: Seed of the light fields and of the augmentation.
        augmentation: Random augmentation of the light fields; None leaves them unchanged.

    Raises:
        InputError: If the batch size is not positive.
    """
    check_batch_size(batch_size)

    def render(step: int, rows: slice) -> LightFieldSample:
        key, numbers = jax.random.key(seed), sample_numbers(step, rows, batch_size)
        first = jnp.uint32(numbers.start % 2**32)
        return _render_batch(key, first, config=config, count=len(numbers))

    return augmented(render, batch_size, seed, augmentation)


def cached_source(
    config: SceneConfig,
    count: int,
    batch_size: int,
    seed: int,
    *,
    augmentation: AugmentationConfig | None = None,
) -> Source:
    """Return a source that renders light fields once, keeps them on the device and draws from them.

    This is for GPUs, on which rendering a light field takes about as long as a training step with
    it. Views are kept in 8 bits: 16,000 light fields of 9x9 views and 64x64 pixels take 11 GB with
    their visibility. Light field ``i`` is that of :func:`procedural_source`; each step draws its
    light fields at random. If several processes train together, each renders and keeps all of them.

    Args:
        config: The distribution of scenes.
        count: Number of light fields to keep.
        batch_size: Light fields per step.
        seed: Seed of the light fields, of their order and of the augmentation.
        augmentation: Random augmentation of the light fields; None leaves them unchanged.

    Raises:
        InputError: If the count or the batch size is not positive; when called, if the device has
            too little memory.
    """
    if count < 1:
        raise InputError(f"{count} light fields to keep; there must be at least 1")
    rendered = procedural_source(config, batch_size, seed)

    @lru_cache(maxsize=1)
    def kept() -> LightFieldSample:
        batch_count = -(-count // batch_size)
        batch = jax.eval_shape(lambda: _to_8_bits(rendered(0)))
        try:
            batches = jax.tree.map(
                lambda field: jnp.zeros((batch_count, *field.shape), field.dtype), batch
            )
        except jax.errors.JaxRuntimeError as error:
            size = batch_count * sum(field.size * field.dtype.itemsize for field in batch)
            raise InputError(
                f"{count} light fields to keep take {size / 1e9:.0f} GB, more than the memory of "
                "the device; keep fewer"
            ) from error
        for step in tqdm(range(batch_count), desc="light fields", unit="batch", disable=None):
            batches = _store_batch(batches, rendered(step), step)
        return batches

    def draw(step: int, rows: slice) -> LightFieldSample:
        drawn = np.random.default_rng((seed, step)).integers(count, size=batch_size)[rows]
        return _gather_samples(kept(), drawn.astype(np.int32))

    return augmented(draw, batch_size, seed, augmentation)


def mixture(parts: Mapping[Source, float]) -> Source:
    """Return a source of batches in which each given source has its share of the samples.

    Sources are mixed within every batch, not from batch to batch: gradients vary less from step to
    step, and BatchNorm sees the statistics of the mixture. A share that is not a whole number of
    samples is met on average over the steps. A sample that one step does not use is used by the
    next step.

    Args:
        parts: Relative weight of each source. All have batches of one size and samples of one
            shape.

    Returns:
        The source, with batches of the same size.

    Raises:
        InputError: If there are no sources, or if weights are negative or all zero; when called, if
            the batches of the sources differ in shape.

    Example:
        >>> def constant(value):
        ...     images = jnp.full((4, 1, 1, 2, 2), value)
        ...     seen = images >= 0
        ...     offsets, disparity = jnp.zeros((4, 1, 1, 2)), images[:, 0, 0]
        ...     sample = LightFieldSample(images, offsets, disparity, seen, seen[:, 0, 0])
        ...     return lambda step, rows=slice(None): jax.tree.map(lambda x: x[rows], sample)
        >>> source = mixture({constant(0.0): 3.0, constant(1.0): 1.0})
        >>> source(7).disparity[:, 0, 0].tolist()
        [0.0, 0.0, 0.0, 1.0]
        >>> source(7, slice(2, 4)).disparity[:, 0, 0].tolist()
        [0.0, 1.0]
    """
    weights = list(parts.values())
    if not weights or not min(weights) >= 0.0 or not 0.0 < sum(weights) < math.inf:
        raise InputError("a mixture needs sources with weights of zero or more, not all zero")
    # A batch serves several steps; with prefetching, more than two batches are in use at a time.
    streams = [lru_cache(maxsize=4)(partial(_read_range, source)) for source in parts]

    @lru_cache(maxsize=1)
    def batch_size() -> int:
        largest = weights.index(max(weights))
        return int(streams[largest](0, None).disparity.shape[0])

    def source(step: int, rows: slice = ALL_ROWS, /) -> LightFieldSample:
        requested, before = range(batch_size())[rows], 0
        pieces: list[LightFieldSample] = []
        starts, stops = (
            sample_counts(weights, number * batch_size()) for number in (step, step + 1)
        )
        for stream, start, stop in zip(streams, starts, stops, strict=True):
            # Rows ``before`` to ``before + stop - start`` of the batch come from this source.
            skipped = max(requested.start - before, 0)
            end = min(stop, start + requested.stop - before)
            pieces += _sample_range(stream, start + skipped, end, batch_size(), len(requested))
            before += stop - start
        return _concatenate(pieces)

    return source


def sample_counts(weights: Sequence[float], total: int) -> list[int]:
    """Return how many of the first ``total`` samples of a mixture come from each source.

    Each source in turn gets its rounded share of the samples that remain. The counts add up to the
    total, and none decreases when the total grows.

    Example:
        >>> [sample_counts([1.0, 1.0, 2.0], total) for total in (4, 5, 8)]
        [[1, 1, 2], [1, 1, 3], [2, 2, 4]]
    """
    counts, left, weight_left = [], total, sum(weights)
    for weight in weights[:-1]:
        # Rounding of the sum of weights can give a share slightly above 1.
        share = min(weight / weight_left, 1.0) if weight_left > 0.0 else 0.0
        counts.append(math.floor(left * share + 0.5))
        left, weight_left = left - counts[-1], weight_left - weight
    return [*counts, left]


def sample_numbers(step: int, rows: slice, batch_size: int) -> range:
    """Return the numbers of the samples in rows of a batch: ``step * batch_size + row``.

    Example:
        >>> sample_numbers(2, slice(2, 4), 4)
        range(10, 12)
    """
    return range(step * batch_size, (step + 1) * batch_size)[rows]


def augmented(
    make: Callable[[int, slice], LightFieldSample],
    batch_size: int,
    seed: int,
    augmentation: AugmentationConfig | None,
) -> Source:
    """Return the source of augmented batches.

    Args:
        make: Function from the number of a step and the rows of its batch to the samples in these
            rows.
        batch_size: Samples in the batch of a step.
        seed: Seed of the augmentation.
        augmentation: Random augmentation; None leaves the samples unchanged.
    """

    def source(step: int, rows: slice = ALL_ROWS, /) -> LightFieldSample:
        batch = make(step, rows)
        if augmentation is None:
            return batch
        # The last number keeps these keys apart from those that light fields are rendered with.
        key = jax.random.fold_in(jax.random.key(seed), 2**32 - 1)
        keys = jax.random.split(jax.random.fold_in(key, step), batch_size)
        return augment_batch(keys[rows], batch, augmentation)

    return source


def check_batch_size(batch_size: int) -> None:
    """Raise an :class:`InputError` if the size of a batch is not positive."""
    if batch_size < 1:
        raise InputError(f"batch_size is {batch_size}; it must be at least 1")


@partial(jax.jit, static_argnames=("config", "count"))
def _render_batch(key: Array, first: Array, *, config: SceneConfig, count: int) -> LightFieldSample:
    """Render the light fields number ``first`` to ``first + count - 1`` of a key."""
    numbers = first + jnp.arange(count, dtype=jnp.uint32)
    keys = jax.vmap(partial(jax.random.fold_in, key))(numbers)
    return jax.vmap(lambda key: generate(key, config))(keys)


def _to_8_bits(batch: LightFieldSample) -> LightFieldSample:
    """Round the views of a batch to 8 bits."""
    return batch._replace(views=jnp.round(batch.views * 255.0).astype(jnp.uint8))


@partial(jax.jit, donate_argnames="batches")
def _store_batch(
    batches: LightFieldSample, batch: LightFieldSample, number: int | Int[Array, ""]
) -> LightFieldSample:
    """Return batches ``[n, b, ...]`` in which one is replaced, its views in 8 bits."""
    return jax.tree.map(lambda all_, one: all_.at[number].set(one), batches, _to_8_bits(batch))


@jax.jit
def _gather_samples(batches: LightFieldSample, numbers: Int[Array, " b"]) -> LightFieldSample:
    """Return samples of batches ``[n, b, ...]`` by their numbers."""
    size = batches.disparity.shape[1]
    batch = jax.tree.map(lambda field: field[numbers // size, numbers % size], batches)
    return batch._replace(views=batch.views.astype(jnp.float32) / 255.0)


def _read_range(source: Source, step: int, rows: range | None) -> LightFieldSample:
    """Return rows of the batch of a step; None is all of them."""
    return source(step) if rows is None else source(step, slice(rows.start, rows.stop))


def _sample_range(
    stream: Callable[[int, range | None], LightFieldSample],
    start: int,
    stop: int,
    batch_size: int,
    block: int,
) -> Iterator[LightFieldSample]:
    """Yield samples number ``start`` to ``stop - 1`` of a source.

    Args:
        stream: Returns rows of a batch of the source.
        start: First sample.
        stop: Sample after the last.
        batch_size: Samples per batch of the source.
        block: Number of rows to request at a time. Each number of rows compiles other programs, and
            the rows of one block serve several steps.
    """
    while start < stop:
        number, row = divmod(start, batch_size)
        first = row - row % block
        batch = stream(number, None if block == batch_size else range(first, first + block))
        found = batch.disparity.shape[0]
        if found != block:
            raise InputError(f"sources have batches of {found} and {batch_size}; make them equal")
        count = min(stop - start, first + block - row)
        yield LightFieldSample(*(field[row - first : row - first + count] for field in batch))
        start += count


def _concatenate(pieces: list[LightFieldSample]) -> LightFieldSample:
    """Return the batch of the samples of all pieces."""
    shapes = {tuple(field.shape[1:] for field in piece) for piece in pieces}
    if len(shapes) != 1:
        sizes = " and ".join(str(list(shape[0])) for shape in sorted(shapes))
        raise InputError(
            f"sources have views of {sizes}; use the same crop and the same selection of views"
        )
    return LightFieldSample(*(jnp.concatenate(fields) for fields in zip(*pieces, strict=True)))
