"""The source of batches that the settings of the training data describe."""

from __future__ import annotations

import dataclasses
from functools import partial
from pathlib import Path

import jax

from occjax.data.config import AugmentationConfig
from occjax.data.folders import folder_source
from occjax.data.pool import pool_source
from occjax.data.scenes import load_scenes
from occjax.data.sources import ALL_ROWS, Source, cached_source, mixture, procedural_source
from occjax.errors import InputError
from occjax.lightfield import LightField
from occjax.models import ModelConfig, ProposalNetConfig
from occjax.training.config import DataConfig, LearnedPart
from occjax.training.initial import NO_SELECTION, initial_variables
from occjax.training.prepared import prepared_source
from occjax.training.step import BatchSource
from occjax.training.tasks import task_of
from occjax.training.validation import scenes_from_batch

VALIDATION_SEED = 2**31
"""Added to the seed for procedural scenes that only validation uses."""


def make_source(
    config: DataConfig,
    network: ModelConfig,
    *,
    trained: LearnedPart = "selector",
    initial_weights: str | Path | None = None,
) -> BatchSource:
    """Return the source of batches that the settings describe.

    Args:
        config: Sources and shares.
        network: Model to train.
        trained: For ProposalNet, the part that is trained.
        initial_weights: Initial weights of the training: a file, or a name that
            ``occjax weights list`` prints. Their selector prepares light fields for the residual.

    Returns:
        Function from the step to its batch.

    Raises:
        InputError: If the scenes do not have the views of the model, if there are no data, or if a
            folder cannot be used.

    Example:
        >>> from occjax.training import recipe
        >>> tiny = recipe("tiny")
        >>> source = make_source(tiny.data, tiny.train.network)  # source(0) is the first batch
    """
    views = task_of(network, trained=trained).view_selection(config.scenes.views)
    if not isinstance(views, str) and (config.scenes.views, config.scenes.grid) != ("all", views):
        v, u = views
        raise InputError(
            f"the network takes all views of a {v}x{u} grid; pass --data.scenes.views all "
            f"--data.scenes.grid {v} {u}"
        )
    if config.kept < 0:
        raise InputError(f"data.kept is {config.kept}; pass 0 or more")
    if config.prepared is not None:
        variables = None
        if trained == "residual":
            if initial_weights is None:
                raise InputError(NO_SELECTION)
            variables = initial_variables(network, initial_weights)
        return _prepared(config, config.prepared, network, variables)
    size, seed, augmentation = config.batch_size, config.seed, config.augmentation
    parts: dict[Source, float] = {}
    if config.procedural_share > 0.0:
        parts[_procedural(config, size, seed)] = config.procedural_share
    for pool in config.pools if config.pool_share > 0.0 else ():
        pooled = pool_source(pool, size, seed, augmentation=augmentation, views=views)
        parts[pooled] = config.pool_share / len(config.pools)
    if config.folders and config.folder_share > 0.0:
        scenes = load_scenes(config.folders, views=views)
        drawn = folder_source(scenes, size, seed, augmentation=augmentation)
        parts[drawn] = config.folder_share
    if not parts:
        raise InputError(
            "there is no training data; give data.procedural_share, data.pools or data.folders"
        )
    return mixture(parts) if len(parts) > 1 else next(iter(parts))


def validation_scenes(config: DataConfig, count: int) -> list[LightField]:
    """Render procedural light fields that training never uses, always the same ones."""
    if not count:
        return []
    unvaried = dataclasses.replace(config, augmentation=None, kept=0)
    source = _procedural(unvaried, count, config.seed + VALIDATION_SEED)
    return scenes_from_batch(source(0), "procedural", disparity_range=config.scenes.disparity_range)


def fixed(source: BatchSource) -> BatchSource:
    """Return a source that gives the first batch of another source in every step."""
    batch = jax.block_until_ready(source(0))
    return lambda step, rows=ALL_ROWS, /: jax.tree.map(lambda field: field[rows], batch)


def _procedural(config: DataConfig, batch_size: int, seed: int) -> Source:
    make = partial(cached_source, count=config.kept) if config.kept else procedural_source
    return make(config.scenes, batch_size=batch_size, seed=seed, augmentation=config.augmentation)


def _prepared(
    config: DataConfig, folder: Path, network: ModelConfig, variables: dict | None
) -> BatchSource:
    unvaried = AugmentationConfig(
        flips=False, turns=False, gamma=1.0, contrast=1.0, brightness=0.0, noise=0.0
    )
    pools = config.pools if config.pool_share > 0.0 else ()
    folders = config.folders if config.folder_share > 0.0 else ()
    only_files = bool(pools or folders) and config.procedural_share == 0.0
    if not isinstance(network, ProposalNetConfig) or not only_files:
        raise InputError(
            "data.prepared needs the proposal network, and pools or folders as its only data; pass "
            "--recipe proposal or residual, --data.pools or --data.folders, and "
            "--data.procedural-share 0"
        )
    return prepared_source(
        pools,
        folder,
        network,
        config.batch_size,
        config.seed,
        augmentation=config.augmentation or unvaried,
        patches=config.patches,
        scenes=load_scenes(folders, views=network.views) if folders else (),
        weights=(config.pool_share, config.folder_share),
        variables=variables,
    )
