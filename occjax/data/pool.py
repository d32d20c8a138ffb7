"""A pool of procedural light fields: rendered once, used for many training steps.

On a CPU, rendering a light field takes about as long as a training step with it. A pool is a folder
with one file per light field (views in 8 bits, visibility in single bits) and ``pool.json``, which
describes the scenes and the seed. Light field ``i`` is ``generate(fold_in(key(seed), i))``, so that
rendering can be interrupted and resumed, a pool can be enlarged, and a file can be replaced.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import jax
import numpy as np
from jaxtyping import Float32, UInt8
from tqdm import tqdm

import occjax
from occjax.data.config import AugmentationConfig
from occjax.data.procedural import SceneConfig, generate
from occjax.data.samples import (
    LightFieldSample,
    numpy_sample,
    select_views,
    stack_samples,
    to_device,
)
from occjax.data.sources import Source, augmented, check_batch_size, sample_numbers
from occjax.errors import InputError
from occjax.io.arrays import load_fields
from occjax.io.atomic import atomic_path
from occjax.io.run_folder import open_run_folder
from occjax.view_selection import ViewSelection

_STORED = {
    "views": UInt8[np.ndarray, "v u h w"],
    "offsets": Float32[np.ndarray, "v u 2"],
    "disparity": Float32[np.ndarray, "h w"],
    "visibility": UInt8[np.ndarray, "v u h bytes"],
    "valid": UInt8[np.ndarray, "h bytes"],
}

DESCRIPTION = "pool.json"
"""File that describes the light fields of a pool."""


def render_pool(folder: str | Path, count: int, config: SceneConfig, seed: int) -> None:
    """Render the light fields that a pool lacks, up to ``count``.

    Args:
        folder: The pool; created if it does not exist.
        count: Number of light fields that the pool has afterwards, at least.
        config: The distribution of scenes.
        seed: Seed of the light fields.

    Raises:
        InputError: If the folder contains other files or a pool of other settings, or if it cannot
            be written.

    Example:
        ::

            render_pool("pool", 2000, SceneConfig(image_size=(144, 144)), seed=0)
            augmentation = AugmentationConfig(crop=(128, 128))
            source = pool_source("pool", batch_size=8, seed=0, augmentation=augmentation)
            source(0).views.shape  # (8, 1, 33, 128, 128)
    """
    folder = Path(folder)
    if count < 1:
        raise InputError(f"{folder}: a pool of {count} light fields; it must have at least 1")
    scenes = dataclasses.asdict(config)
    description = {"version": occjax.__version__, "seed": seed, "scenes": scenes}
    open_run_folder(folder, DESCRIPTION, description, contents="a pool")
    missing = [number for number in range(count) if not light_field_file(folder, number).exists()]
    root = jax.random.key(seed)
    for number in tqdm(missing, desc=folder.name, unit="light field"):
        sample = generate(jax.random.fold_in(root, number), config)
        write_sample(light_field_file(folder, number), sample)


def pool_source(
    folder: str | Path,
    batch_size: int,
    seed: int,
    *,
    augmentation: AugmentationConfig | None = None,
    views: ViewSelection = "all",
) -> Source:
    """Return a source that goes through a pool in random order, in a new order each time.

    The order depends on the size of the pool: if light fields were added to the pool since a run
    started, the run continues in another order.

    Args:
        folder: The pool.
        batch_size: Light fields per step.
        seed: Seed of the order and of the augmentation.
        augmentation: Random augmentation; None leaves the light fields unchanged.
        views: The views to take.

    Raises:
        InputError: If the folder is not a pool or is an empty one; when called, if a file is
            damaged.
    """
    check_batch_size(batch_size)
    files = light_field_files(folder)
    item = shuffled(len(files), seed)

    def read(step: int, rows: slice) -> LightFieldSample:
        samples = [
            select_views(read_sample(files[item(number)]), views)
            for number in sample_numbers(step, rows, batch_size)
        ]
        return to_device(stack_samples(samples))

    return augmented(read, batch_size, seed, augmentation)


def shuffled(count: int, seed: int) -> Callable[[int], int]:
    """Return a function from a draw to its item: all items in random order, then in a new order.

    Example:
        >>> item = shuffled(3, seed=0)
        >>> sorted(item(draw) for draw in range(3, 6))
        [0, 1, 2]
    """

    @lru_cache(maxsize=2)
    def order(epoch: int) -> np.ndarray:
        return np.random.default_rng((seed, epoch)).permutation(count)

    return lambda draw: int(order(draw // count)[draw % count])


def light_field_files(folder: str | Path) -> list[Path]:
    """Return the files of a pool's light fields, up to the first that is missing.

    Returns:
        At least one file.

    Raises:
        InputError: If the folder is not a pool or is an empty one.
    """
    folder = Path(folder)
    if not (folder / DESCRIPTION).is_file():
        raise InputError(f"{folder}: is not a pool of light fields; make one with occjax pool")
    present = {path.name for path in folder.glob("*.npz")}
    files: list[Path] = []
    while (file := light_field_file(folder, len(files))).name in present:
        files.append(file)
    if not files:
        raise InputError(f"{folder}: is an empty pool; render it with occjax pool")
    return files


def write_sample(path: str | Path, sample: LightFieldSample) -> None:
    """Write one sample (no batch axis) to an ``.npz`` file; grey values are rounded to 8 bits.

    Raises:
        InputError: If the file cannot be written.
    """
    with atomic_path(path) as temporary:
        np.savez(
            temporary,
            views=np.rint(np.asarray(sample.views) * 255.0).astype(np.uint8),
            offsets=np.asarray(sample.offsets, np.float32),
            disparity=np.asarray(sample.disparity, np.float32),
            visibility=np.packbits(np.asarray(sample.visibility), axis=-1),
            valid=np.packbits(np.asarray(sample.valid), axis=-1),
        )


def read_sample(path: str | Path) -> LightFieldSample:
    """Read a sample that :func:`write_sample` wrote, as NumPy arrays.

    Raises:
        InputError: If the file cannot be read or is damaged.
    """
    path = Path(path)
    remedy = "remove it and render the pool again"
    arrays = load_fields(path, _STORED, what="a light field", remedy=remedy)
    width = arrays["views"].shape[-1]
    if arrays["valid"].shape[-1] != -(-width // 8):
        raise InputError(f"{path}: valid is not as wide as the views; {remedy}")
    for name in ("visibility", "valid"):
        arrays[name] = np.unpackbits(arrays[name], axis=-1, count=width).astype(bool)
    arrays["views"] = arrays["views"].astype(np.float32) / np.float32(255.0)
    return numpy_sample(**arrays)


def light_field_file(folder: Path, number: int) -> Path:
    """Return the file of a light field in a pool."""
    return folder / f"{number:06d}.npz"
