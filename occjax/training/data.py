"""Which data a training sees, as a frozen dataclass, and the source that gives it."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import cast

import jax

from occjax.data.augmentation import AugmentationConfig
from occjax.data.folders import folder_source, published_source
from occjax.data.photographs import load_photographs
from occjax.data.pool import pool_source
from occjax.data.scene_config import SceneConfig
from occjax.data.scenes import load_scenes
from occjax.data.sources import Source, kept_source, mixture, procedural_source, random_views
from occjax.data.views import Selection
from occjax.errors import InputError
from occjax.models import NetworkConfig
from occjax.training.prepared import prepared_source
from occjax.training.step import BatchSource
from occjax.training.validation import Scene, scenes_from_batch

VALIDATION_SEED = 2**31
"""Added to the seed of procedural scenes that only validation sees."""


@dataclass(frozen=True)
class DataConfig:
    """Sources of training data and their shares of every batch.

    Attributes:
        batch_size: Light fields in a step.
        procedural_share: Of procedural light fields, which want a GPU to render them.
        kept: Number of procedural light fields that are rendered before the first step, kept on the
            device and drawn from, 0.7 MB for each of 9x9 views and 64x64 pixels; 0 renders new ones
            in every step.
        scenes: The distribution that procedural light fields are drawn from.
        photographs: Whether some of their textures are photographs (needs scikit-image).
        pools: Folders of procedural light fields that were rendered before.
        pool_share: Of light fields of the pools, all pools alike.
        prepared: Folder in which what a light network chooses from is kept; then steps train the
            choice alone, on the light fields of the pools and nothing else. See
            :mod:`occjax.training.prepared`.
        folders: Scenes with ground truth, or folders of such scenes.
        folder_share: Of patches of these scenes.
        published: Whether patches of scenes are drawn and varied as published, 32x32 pixels;
            otherwise as ``augmentation`` says.
        arrangements: For a network of any arrangement of views, how often a step sees which of the
            views there are, as relative weights: ``all``, ``star``, ``cross`` or ``VxU``, such as
            ``3x3`` for the inner ones. None means all of them in every step. What the light recipe
            renders, an ``outer_star``, has no others; pass ``scenes.views star`` or ``all``.
        augmentation: How light fields are varied; None for not at all.
        seed: Of everything that is drawn.
    """

    batch_size: int = 16
    procedural_share: float = 1.0
    kept: int = 0
    scenes: SceneConfig = field(default_factory=SceneConfig)
    photographs: bool = False
    pools: tuple[Path, ...] = ()
    pool_share: float = 1.0
    prepared: Path | None = None
    folders: tuple[Path, ...] = ()
    folder_share: float = 1.0
    published: bool = False
    arrangements: dict[str, float] = field(default_factory=dict)
    augmentation: AugmentationConfig | None = field(default_factory=AugmentationConfig)
    seed: int = 0


def make_source(config: DataConfig, network: NetworkConfig) -> BatchSource:
    """The source that a configuration describes.

    Args:
        config: Sources and shares.
        network: Which takes all views of its grid, or any arrangement.

    Returns:
        Function from the step to its batch.

    Raises:
        InputError: If the scenes have other views than the network takes, there is no data at all,
            or a folder cannot be used.
    """
    _check_views(config.scenes, network)
    if config.kept < 0:
        raise InputError(f"data.kept is {config.kept}; pass 0 or more")
    views: Selection = config.scenes.views if network.views is None else network.views
    size, seed, augmentation = config.batch_size, config.seed, config.augmentation
    if config.prepared is not None:
        return _prepared(config, config.prepared, network)
    parts: dict[Source, float] = {}
    if config.procedural_share > 0.0:
        parts[_procedural(config, size, seed)] = config.procedural_share
    for pool in config.pools if config.pool_share > 0.0 else ():
        pooled = pool_source(pool, size, seed, augmentation=augmentation, views=views)
        parts[pooled] = config.pool_share / len(config.pools)
    if config.folders and config.folder_share > 0.0:
        scenes = load_scenes(config.folders, views=views)
        source = (
            published_source(scenes, size, seed)
            if config.published
            else folder_source(scenes, size, seed, augmentation=augmentation)
        )
        parts[source] = config.folder_share
    if not parts:
        raise InputError(
            "there is no training data; give data.procedural_share, data.pools or data.folders"
        )
    source = mixture(parts) if len(parts) > 1 else next(iter(parts))
    if not config.arrangements:
        return source
    if network.views is not None:
        raise InputError("the network takes all views of its grid; leave out data.arrangements")
    selections = {_selection(name): weight for name, weight in config.arrangements.items()}
    return random_views(source, selections, config.seed)


def validation_scenes(config: DataConfig, count: int) -> list[Scene]:
    """Procedural light fields that training never sees, always the same ones.

    Args:
        config: Of the training's data.
        count: How many.

    Returns:
        The scenes.
    """
    if not count:
        return []
    unvaried = dataclasses.replace(config, augmentation=None, kept=0)
    source = _procedural(unvaried, count, config.seed + VALIDATION_SEED)
    return scenes_from_batch(source(0), "procedural")


def fixed(source: BatchSource) -> BatchSource:
    """The first batch of a source in every step: what a network must be able to learn by heart."""
    batch = jax.block_until_ready(source(0))
    return lambda step: batch


def _procedural(config: DataConfig, batch_size: int, seed: int) -> Source:
    make = partial(kept_source, count=config.kept) if config.kept else procedural_source
    return make(
        config.scenes,
        batch_size=batch_size,
        seed=seed,
        photographs=load_photographs() if config.photographs else None,
        augmentation=config.augmentation,
    )


def _prepared(config: DataConfig, folder: Path, network: NetworkConfig) -> BatchSource:
    alone = config.procedural_share == 0.0 and not config.folders and not config.arrangements
    if network.views is not None or not alone or not config.pools:
        raise InputError(
            "data.prepared is for a network of any arrangement of views, trained on pools and "
            "nothing else: pass data.pools, and 0 as data.procedural_share"
        )
    return prepared_source(
        config.pools,
        folder,
        network,
        config.batch_size,
        config.seed,
        augmentation=config.augmentation or AugmentationConfig(flips=False, turns=False),
    )


def _selection(name: str) -> Selection:
    """A selection of views by its name; ``select_views`` refuses what is none."""
    rows, times, columns = name.partition("x")
    if times and rows.isdecimal() and columns.isdecimal():
        return int(rows), int(columns)
    return cast(Selection, name)


def _check_views(scenes: SceneConfig, network: NetworkConfig) -> None:
    if network.views is None or (scenes.views == "all" and scenes.grid == network.views):
        return
    v, u = network.views
    raise InputError(
        f"the network takes all views of a {v}x{u} grid; pass --data.scenes.views all "
        f"--data.scenes.grid {v} {u}"
    )
