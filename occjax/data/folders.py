"""Training data from folders of light fields, prepared ahead by grain.

Patches are a function of the seed and their number (``grain.MapDataset``, random access), read in
threads some batches ahead of the step that needs them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from threading import Lock

import numpy as np

from occjax.data.augmentation import AugmentationConfig
from occjax.data.host import numpy_sample, stack_samples, to_device
from occjax.data.published_augmentation import published_sample
from occjax.data.samples import Sample
from occjax.data.scenes import Scene
from occjax.data.sources import Source, check_batch_size, vary
from occjax.errors import InputError
from occjax.lightfield import GREY_WEIGHTS

MANY = 2**40
"""More patches than any training takes: grain's data sets have a length."""


def folder_source(
    scenes: Sequence[Scene],
    batch_size: int,
    seed: int,
    *,
    augmentation: AugmentationConfig | None = None,
    random_grey: bool = True,
    threads: int = 2,
    ahead: int = 4,
) -> Source:
    """Random patches of light fields in memory, varied.

    Args:
        scenes: From :func:`occjax.data.scenes.load_scenes`; of one arrangement of views.
        batch_size: Patches per step.
        seed: Of places and of augmentation; 0 to 2^32 - 1.
        augmentation: Size of the patches and how they are varied; None for whole views as they are.
        random_grey: Whether each patch weighs red, green and blue otherwise.
        threads: That cut patches; 0 for none, then nothing is done ahead.
        ahead: Batches that they cut ahead.

    Returns:
        The source.

    Raises:
        InputError: If there are no scenes, or they are too small for the patches.
    """
    check_batch_size(batch_size)
    if not scenes:
        raise InputError("there are no scenes to draw patches from")
    cut = partial(_random_window, scenes, augmentation, random_grey)
    windows = grain_source(cut, batch_size, seed, threads=threads, ahead=ahead)

    def source(step: int) -> Sample:
        batch = to_device(windows(step))
        return vary(batch, augmentation, seed, step)

    return source


def published_source(
    scenes: Sequence[Scene], batch_size: int, seed: int, *, threads: int = 2, ahead: int = 4
) -> Source:
    """Patches drawn and varied as the published network's, see :func:`published_sample`.

    Args:
        scenes: The HCI benchmark's additional scenes, or others.
        batch_size: Patches per step.
        seed: Of everything that is drawn; 0 to 2^32 - 1.
        threads: That prepare patches; 0 for none.
        ahead: Batches that they prepare ahead.

    Returns:
        The source.

    Raises:
        InputError: When called, if there are no scenes or none has a patch that is fit.
    """
    check_batch_size(batch_size)
    batches = grain_source(
        lambda generator: published_sample(generator, scenes),
        batch_size,
        seed,
        threads=threads,
        ahead=ahead,
    )
    return lambda step: to_device(batches(step))


def grain_source(
    draw: Callable[[np.random.Generator], Sample],
    batch_size: int,
    seed: int,
    *,
    threads: int = 2,
    ahead: int = 4,
) -> Callable[[int], Sample]:
    """Batches of samples that a function draws, each a function of seed and number, by grain.

    Steps that follow each other are prepared ahead; any other step may be asked for, too, and is
    where preparing goes on from.

    Args:
        draw: Makes one sample of NumPy arrays with the generator that it is given.
        batch_size: Samples per batch.
        seed: 0 to 2^32 - 1.
        threads: That prepare batches; 0 for none.
        ahead: Batches that they prepare ahead.

    Returns:
        A function from the step to its batch of NumPy arrays.

    Raises:
        InputError: If grain is not installed or the seed out of range.
    """
    try:
        import grain
    except ImportError as error:
        raise InputError("data from folders needs grain; pip install 'occjax[train]'") from error
    if not 0 <= seed < 2**32:
        raise InputError(f"seed is {seed}; it must be between 0 and 2^32 - 1")
    samples = grain.MapDataset.range(MANY).random_map(lambda _, drawn: draw(drawn), seed=seed)
    batches = samples.batch(batch_size, batch_fn=stack_samples)
    if threads == 0:
        return lambda step: batches[step]
    options = grain.ReadOptions(num_threads=threads, prefetch_buffer_size=max(ahead, threads))
    iterator: Iterator[Sample] = iter(())
    position, lock = -1, Lock()

    def in_order(step: int) -> Sample:
        nonlocal iterator, position
        with lock:
            if step != position:
                iterator = iter(batches[step:].to_iter_dataset(options))
            position = step + 1
            return next(iterator)

    return in_order


def _random_window(
    scenes: Sequence[Scene],
    augmentation: AugmentationConfig | None,
    random_grey: bool,
    generator: np.random.Generator,
) -> Sample:
    """A part of a scene with room for the patch of every stride and shear, if it is so large."""
    scene = scenes[int(generator.integers(len(scenes)))]
    size = scene.disparity.shape
    wanted = augmentation and augmentation.window(float(np.abs(scene.offsets).max()))
    height, width = map(min, size, wanted) if wanted else size
    top, left = (generator.integers(room + 1) for room in (size[0] - height, size[1] - width))
    window = np.s_[top : top + height, left : left + width]
    weights = 0.05 + generator.uniform(size=3) if random_grey else np.array(GREY_WEIGHTS)
    return numpy_sample(
        views=scene.grey(window, weights),
        offsets=scene.offsets,
        disparity=scene.disparity[window],
        valid=scene.valid[window],
    )
