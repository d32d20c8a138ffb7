"""``occjax train``: every field of a recipe is an option."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated

from tyro.conf import AvoidSubcommands, Positional, arg

from occjax.errors import InputError
from occjax.models import PRESETS, preset
from occjax.training.config import RunConfig, TrainConfig
from occjax.training.data import DataConfig, fixed, make_source, validation_scenes
from occjax.training.logging import read_log
from occjax.training.loop import train
from occjax.training.recipes import RECIPES, Recipe, recipe
from occjax.training.validation import scenes_from_folders

DEFAULT_RECIPE = "light"


def training_command(arguments: Sequence[str]) -> Callable[..., int]:
    """The command ``train``, for the command line to register.

    The defaults of its options are those of the recipe and the network that the arguments name, so
    that ``--help`` shows them and any of them can be changed besides.

    Args:
        arguments: Of the program, without its name.

    Returns:
        The command, which returns its exit code.
    """
    defaults = _defaults(arguments)

    def train_command(
        folder: Positional[
            Annotated[Path, arg(help="Where everything goes; one that is there is gone on with.")]
        ],
        recipe: Annotated[
            str, arg(help=f"What to start from: {', '.join(RECIPES)}.")
        ] = DEFAULT_RECIPE,
        network_preset: Annotated[
            str | None,
            arg(
                help=f"Network in place of the recipe's: {', '.join(PRESETS)}.",
                metavar="NETWORK",
                help_behavior_hint="",
            ),
        ] = None,
        config: Annotated[AvoidSubcommands[TrainConfig], arg(name="")] = defaults.train,
        data: AvoidSubcommands[DataConfig] = defaults.data,
        run: Annotated[RunConfig, arg(name="")] = defaults.run,
        validate: Annotated[
            tuple[Path, ...], arg(help="Scenes with ground truth to validate on.", metavar="SCENE")
        ] = (),
        validation_samples: Annotated[
            int, arg(help="Procedural light fields to validate on besides.")
        ] = 0,
        initial_weights: Annotated[
            Path | None,
            arg(help="Weights to begin with.", metavar="FILE", help_behavior_hint=""),
        ] = None,
        overfit_one: Annotated[
            bool, arg(help="Train on the first batch alone, and see that it is learnt by heart.")
        ] = False,
    ) -> int:
        """Train a network, or go on with training it."""
        _check_names(recipe, network_preset)
        if overfit_one and config.steps < 2 * run.log_every:
            raise InputError(
                f"--overfit-one compares the first line of the log with the last: {config.steps} "
                f"steps with a line every {run.log_every} have one at most; pass more --steps or a "
                "smaller --log-every"
            )
        source = make_source(data, config.network)
        scenes = scenes_from_folders(validate, config, views=data.scenes.views)
        scenes += validation_scenes(data, validation_samples)
        trained = train(
            config,
            fixed(source) if overfit_one else source,
            folder,
            run=run,
            validation=scenes,
            data={**dataclasses.asdict(data), "overfit_one": overfit_one},
            initial_weights=initial_weights,
        )
        if overfit_one:
            return _report_overfit(folder)
        if trained.finished:
            print(
                f"trained: {trained.weights}\n"
                f"use it with: occjax estimate SCENE -o FOLDER --weights {trained.weights}"
            )
        else:
            print(f"stopped after step {int(trained.state.step)}; start again to go on")
        return 0

    return train_command


def _defaults(arguments: Sequence[str]) -> Recipe:
    """The recipe that the arguments name; names that are wrong are reported by the command."""
    name = _value_of(arguments, "--recipe") or DEFAULT_RECIPE
    chosen = recipe(name if name in RECIPES else DEFAULT_RECIPE)
    network_name = _value_of(arguments, "--network-preset")
    if network_name is None or network_name not in PRESETS:
        return chosen
    network = preset(network_name)
    scenes = chosen.data.scenes
    if network.views is not None:
        scenes = dataclasses.replace(scenes, grid=network.views, views="all")
    return dataclasses.replace(
        chosen,
        train=dataclasses.replace(chosen.train, network=network),
        data=dataclasses.replace(chosen.data, scenes=scenes),
    )


def _value_of(arguments: Sequence[str], option: str) -> str | None:
    """Value of an option, whichever way it is given."""
    for argument, following in zip(arguments, (*arguments[1:], None), strict=True):
        name, equals, value = argument.partition("=")
        if name.replace("_", "-") == option:
            return value if equals else following
    return None


def _check_names(recipe_name: str, network_name: str | None) -> None:
    recipe(recipe_name)
    if network_name is not None:
        preset(network_name)


def _report_overfit(folder: Path) -> int:
    """Whether the one batch was learnt: 1, with a message, if the loss has not halved."""
    entries = [entry for entry in read_log(folder) if entry["kind"] == "train"]
    first, last = entries[0], entries[-1]
    print(
        f"one batch: loss {first['loss']:.4f} at step {first['step']}, {last['loss']:.4f} at step "
        f"{last['step']}; BadPix 0.07 {first['badpix']:.1f} %, {last['badpix']:.1f} %"
    )
    if last["loss"] <= 0.5 * first["loss"]:
        return 0
    print("occjax: the loss of one batch has not halved: something is wrong", file=sys.stderr)
    return 1
