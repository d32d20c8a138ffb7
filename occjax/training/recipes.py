"""Trainings by name: what to start from, and the paper's own."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from occjax.data.augmentation import AugmentationConfig
from occjax.data.scene_config import TEXTURED, Defects, SceneConfig
from occjax.errors import InputError
from occjax.models import NetworkConfig, preset
from occjax.training.config import LossConfig, OptimiserConfig, RunConfig, TrainConfig
from occjax.training.data import DataConfig

EPOCH = 4000
"""Steps of an epoch as published."""


@dataclass(frozen=True)
class Recipe:
    """A training with its data.

    Attributes:
        train: What is trained and how.
        data: On what.
        run: How to go about it.
    """

    train: TrainConfig
    data: DataConfig
    run: RunConfig = field(default_factory=RunConfig)


def light() -> Recipe:
    """The light network on procedural light fields.

    Command: ``occjax train runs/light --recipe light``; on a CPU from a pool, with
    ``--data.procedural-share 0 --data.pools POOL --data.prepared FOLDER``.
    """
    optimiser = OptimiserConfig(peak_rate=2e-3, warm_up=200, weight_decay=1e-4, clip=1.0)
    loss = LossConfig(penalty="log", width=0.05, distribution=1.0, settled=0.2)
    # The camera's own faults are among the generator's.
    augmentation = AugmentationConfig(
        crop=(96, 96), gamma=1.0, contrast=1.2, brightness=0.0, noise=0.008, noise_probability=0.3
    )
    return Recipe(
        TrainConfig(preset("light"), loss, optimiser, steps=20_000, ema_decay=0.997),
        DataConfig(batch_size=4, photographs=True, scenes=TEXTURED, augmentation=augmentation),
    )


def full() -> Recipe:
    """The network of the paper with the right warp, on procedural light fields, for a GPU.

    Command: ``occjax train runs/full --recipe full``: 20,000 steps of 32 patches in bfloat16.
    """
    network = preset("occcasnet")
    optimiser = OptimiserConfig(peak_rate=2e-3, warm_up=200, weight_decay=1e-4, clip=1.0)
    loss = LossConfig(distribution=0.1, border=2)
    scenes = dataclasses.replace(
        _all_views(network, 64),
        low_contrast=0.1,
        textureless=0.03,
        calm=0.1,
        defects=Defects(noise=0.3),
    )
    # Rendered anew for each step, they would take nearly as long as the steps.
    data = DataConfig(
        batch_size=32, kept=6000, photographs=True, scenes=scenes, augmentation=_square(32)
    )
    return Recipe(TrainConfig(network, loss, optimiser, steps=20_000, precision="bfloat16"), data)


def published() -> Recipe:
    """Optimiser, batch and length of the published training: 120 epochs of 4000 steps.

    Command: ``occjax train runs/published --recipe published --data.folders FOLDER``, with the
    folder of the HCI benchmark's 16 additional scenes.
    """
    network = preset("occcasnet", feature_statistics="per_view")
    optimiser = OptimiserConfig(
        peak_rate=1e-3, schedule="halving", epoch_steps=EPOCH, halving_epochs=30
    )
    return Recipe(
        TrainConfig(network, LossConfig(), optimiser, steps=120 * EPOCH, ema_decay=0.0),
        DataConfig(
            batch_size=32, procedural_share=0.0, published=True, scenes=_all_views(network, 32)
        ),
        RunConfig(validate_every=EPOCH),
    )


def tiny() -> Recipe:
    """A network of 3x3 views on small scenes, to try things on with a CPU.

    Command: ``occjax train runs/tiny --recipe tiny``.
    """
    network = preset("tiny")
    scenes = dataclasses.replace(
        _all_views(network, 32), disparity_range=(-2.0, 2.0), disparity_width=(0.4, 4.0), rays=1
    )
    optimiser = OptimiserConfig(peak_rate=3e-3, warm_up=20, clip=1.0)
    return Recipe(
        TrainConfig(network, LossConfig(), optimiser, steps=500, ema_decay=0.98),
        DataConfig(batch_size=4, scenes=scenes, augmentation=_square(32)),
        RunConfig(validate_every=250, validation_border=4),
    )


RECIPES: Mapping[str, Callable[[], Recipe]] = MappingProxyType(
    {each.__name__: each for each in (light, full, published, tiny)}
)


def recipe(name: str) -> Recipe:
    """A training by its name.

    Args:
        name: One of :data:`RECIPES`.

    Returns:
        The recipe; change it with ``dataclasses.replace``.

    Raises:
        InputError: If there is none of that name.

    Example:
        >>> recipe("full").train.steps
        20000
    """
    if name not in RECIPES:
        raise InputError(f"there is no recipe named {name!r}; there are {', '.join(RECIPES)}")
    return RECIPES[name]()


def _all_views(network: NetworkConfig, size: int) -> SceneConfig:
    """Square scenes with the views that a network takes."""
    assert network.views is not None
    return SceneConfig(image_size=(size, size), grid=network.views, views="all")


def _square(size: int) -> AugmentationConfig:
    return AugmentationConfig(crop=(size, size))
