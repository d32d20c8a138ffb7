"""A pool of procedural light fields: rendered once, drawn from many times.

On a CPU rendering a light field takes about as long as a step of training with it. A pool is a
folder with one file per light field, its views in 8 bits and its visibility in single bits, and
``pool.json``, which says what they are. Light field ``i`` is ``generate(fold_in(key(seed), i))``,
so a pool can be interrupted, resumed and enlarged, and any of its files made again.
"""

from __future__ import annotations

import dataclasses
import hashlib
import zipfile
from functools import lru_cache
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from tqdm import tqdm

import occjax
from occjax.data.augmentation import AugmentationConfig
from occjax.data.generator import generate
from occjax.data.host import numpy_sample, stack_samples, to_device
from occjax.data.samples import Sample
from occjax.data.scene_config import SceneConfig
from occjax.data.sources import Source, check_batch_size, vary
from occjax.data.views import Selection, select_views
from occjax.errors import InputError
from occjax.io.atomic import atomic_path
from occjax.io.claims import claim_folder
from occjax.io.files import reading

DESCRIPTION = "pool.json"


def render_pool(
    folder: str | Path,
    count: int,
    config: SceneConfig,
    seed: int,
    *,
    photographs: Float[Array | np.ndarray, "p 256 256"] | None = None,
    progress: bool = True,
) -> None:
    """Render the light fields that a pool lacks, up to ``count``.

    Args:
        folder: The pool; made if it is not there.
        count: Number of light fields that it shall have at least.
        config: The distribution of scenes.
        seed: Another seed, other light fields.
        photographs: Textures, see :func:`occjax.data.generator.generate`.
        progress: Whether to show how far it is.

    Raises:
        InputError: If the folder holds a pool of something else, or cannot be written.

    Example:
        ::

            render_pool("pool", 2000, SceneConfig(image_size=(144, 144)), seed=0)
            augmentation = AugmentationConfig(crop=(128, 128), shear=1.0)
            source = pool_source("pool", batch_size=8, seed=0, augmentation=augmentation)
            source(0).views.shape  # (8, 1, 33, 128, 128)
    """
    folder = Path(folder)
    if count < 1:
        raise InputError(f"{folder}: a pool of {count} light fields; it must have at least 1")
    claim_folder(folder, DESCRIPTION, _description(config, seed, photographs), contents="a pool")
    missing = [number for number in range(count) if not light_field_file(folder, number).exists()]
    root = jax.random.key(seed)
    textures = None if photographs is None else jnp.asarray(photographs)
    for number in tqdm(missing, desc=folder.name, unit="light field", disable=not progress):
        sample = generate(jax.random.fold_in(root, number), config, textures)
        write_sample(light_field_file(folder, number), sample)


def pool_source(
    folder: str | Path,
    batch_size: int,
    seed: int,
    *,
    augmentation: AugmentationConfig | None = None,
    views: Selection = "all",
    count: int | None = None,
) -> Source:
    """Light fields of a pool, each once in a random order, then all in another order.

    Args:
        folder: The pool.
        batch_size: Light fields per step.
        seed: Of the order and of the augmentation.
        augmentation: How they are varied; None for not at all.
        views: Which of their views are taken.
        count: How many of the pool are used, from the first; all by default. Give it where a pool
            is enlarged while training from it shall be repeatable.

    Returns:
        The source.

    Raises:
        InputError: If the folder is not a pool or has not so many light fields; when called, if a
            file is damaged.
    """
    check_batch_size(batch_size)
    folder = Path(folder)
    available = pool_size(folder)
    count = available if count is None else count
    if not 1 <= count <= available:
        raise InputError(
            f"{folder}: has {available} light fields, {count} are needed; render more of them"
        )

    @lru_cache(maxsize=2)
    def order(epoch: int) -> np.ndarray:
        return np.random.default_rng((seed, epoch)).permutation(count)

    def source(step: int) -> Sample:
        turns = (divmod(step * batch_size + place, count) for place in range(batch_size))
        samples = [
            select_views(read_sample(light_field_file(folder, int(order(epoch)[place]))), views)
            for epoch, place in turns
        ]
        batch = to_device(stack_samples(samples))
        return vary(batch, augmentation, seed, step)

    return source


def pool_size(folder: str | Path) -> int:
    """Number of light fields in a pool, up to the first that is missing.

    Args:
        folder: The pool.

    Returns:
        Their number.

    Raises:
        InputError: If the folder is not a pool.
    """
    folder = Path(folder)
    if not (folder / DESCRIPTION).is_file():
        raise InputError(f"{folder}: is not a pool of light fields; make one with occjax pool")
    present = {path.name for path in folder.glob("*.npz")}
    return next(
        n for n in range(len(present) + 1) if light_field_file(folder, n).name not in present
    )


def write_sample(path: str | Path, sample: Sample) -> None:
    """Write one sample compactly; grey is rounded to 8 bits.

    Args:
        path: The ``.npz`` file.
        sample: One sample.

    Raises:
        InputError: If it cannot be written.
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


def read_sample(path: str | Path) -> Sample:
    """Read a sample as :func:`write_sample` writes it.

    Args:
        path: The ``.npz`` file.

    Returns:
        One sample, of NumPy arrays.

    Raises:
        InputError: If it cannot be read.
    """
    path = Path(path)
    try:
        # Opened here, since NumPy leaves a damaged file open.
        with reading(path), path.open("rb") as file, np.load(file) as stored:
            width = stored["views"].shape[-1]
            return numpy_sample(
                views=stored["views"].astype(np.float32) / np.float32(255.0),
                offsets=stored["offsets"],
                disparity=stored["disparity"],
                visibility=np.unpackbits(stored["visibility"], axis=-1, count=width).astype(bool),
                valid=np.unpackbits(stored["valid"], axis=-1, count=width).astype(bool),
            )
    except (zipfile.BadZipFile, KeyError, ValueError, EOFError) as error:
        raise InputError(f"{path}: is damaged; remove it and render the pool again") from error


def light_field_file(folder: Path, number: int) -> Path:
    """File of a light field in a pool."""
    return folder / f"{number:06d}.npz"


def _description(config: SceneConfig, seed: int, photographs: np.ndarray | Array | None) -> dict:
    """What decides what the light fields of a pool look like."""
    textures = None
    if photographs is not None:
        textures = hashlib.sha256(np.asarray(photographs, np.float32).tobytes()).hexdigest()
    return {
        "version": occjax.__version__,
        "seed": seed,
        "photographs": textures,
        "scenes": dataclasses.asdict(config),
    }
