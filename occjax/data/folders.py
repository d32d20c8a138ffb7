"""Training data from folders of light fields, prepared in background threads by grain.

A patch is a function of the seed and its number (``grain.MapDataset`` has random access). Threads
prepare some batches ahead of the step that needs them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from threading import Lock

import numpy as np

from occjax.data.config import AugmentationConfig
from occjax.data.samples import LightFieldSample, stack_samples, to_device
from occjax.data.scenes import Scene
from occjax.data.sources import ALL_ROWS, Source, augmented, check_batch_size, sample_numbers
from occjax.errors import InputError


def folder_source(
    scenes: Sequence[Scene],
    batch_size: int,
    seed: int,
    *,
    augmentation: AugmentationConfig | None = None,
    threads: int = 2,
) -> Source:
    """Return a source of random patches of scenes in memory, each with random grey weights.

    Args:
        scenes: Scenes from :func:`occjax.data.scenes.load_scenes`, all with the same views.
        batch_size: Patches per step.
        seed: Seed of places, grey weights and augmentation; 0 to 2^32 - 1.
        augmentation: Size and random augmentation of the patches; None returns whole views.
        threads: Number of threads that cut patches ahead; 0 cuts them when they are needed.

    Raises:
        InputError: If there are no scenes, if the seed is out of range or grain is missing; when
            called, if the scenes differ in their views or are smaller than the patches.
    """
    if not scenes:
        raise InputError("there are no scenes to draw patches from")
    draw = partial(_random_window, scenes, augmentation)
    windows = grain_batches(draw, batch_size, seed, threads)
    return augmented(
        lambda step, rows: to_device(windows(step, rows)), batch_size, seed, augmentation
    )


def grain_batches(
    draw: Callable[[np.random.Generator], LightFieldSample],
    batch_size: int,
    seed: int,
    threads: int,
) -> Callable[[int, slice], LightFieldSample]:
    """Return a function from the step and rows to the random samples in these rows of its batch.

    Threads prepare the same rows of consecutive steps ahead, two batches each. Any other step or
    rows can be requested; preparation then continues from there.

    Args:
        draw: Function that draws one sample of NumPy arrays.
        batch_size: Samples per step.
        seed: Seed of everything that is drawn; 0 to 2^32 - 1.
        threads: Number of threads that prepare samples ahead; 0 prepares them when needed.

    Raises:
        InputError: If the batch size is not positive, the seed is out of range or grain is missing.
    """
    check_batch_size(batch_size)
    try:
        import grain
    except ImportError as error:
        raise InputError("data from folders needs grain; pip install 'occjax[train]'") from error
    if not 0 <= seed < 2**32:
        raise InputError(f"seed is {seed}; it must be between 0 and 2^32 - 1")
    max_patches = 2**40  # grain needs a length: more patches than any training draws
    samples = grain.MapDataset.range(max_patches)
    drawn = samples.random_map(lambda _, generator: draw(generator), seed=seed)

    def batch(step: int, rows: slice) -> LightFieldSample:
        numbers = sample_numbers(step, rows, batch_size)
        return stack_samples([drawn[number] for number in numbers])

    if threads == 0:
        return batch
    steps = grain.MapDataset.range(max_patches // batch_size)
    options = grain.ReadOptions(num_threads=threads, prefetch_buffer_size=2 * threads)
    iterator: Iterator[LightFieldSample] = iter(())
    following, lock = (-1, ALL_ROWS), Lock()

    def read(step: int, rows: slice) -> LightFieldSample:
        nonlocal iterator, following
        with lock:
            if (step, rows) != following:
                batches = steps[step:].map(lambda number: batch(int(number), rows))
                iterator = iter(batches.to_iter_dataset(options))
            following = (step + 1, rows)
            return next(iterator)

    return read


def _random_window(
    scenes: Sequence[Scene], augmentation: AugmentationConfig | None, generator: np.random.Generator
) -> LightFieldSample:
    """Draw a scene, a window of the size of the crop (at most the whole views) and grey weights."""
    scene = scenes[int(generator.integers(len(scenes)))]
    size = scene.disparity.shape
    crop = (augmentation and augmentation.crop) or size
    height, width = map(min, size, crop)
    top, left = (generator.integers(room + 1) for room in (size[0] - height, size[1] - width))
    window = np.s_[top : top + height, left : left + width]
    return scene.sample(window, weights=0.05 + generator.uniform(size=3))
