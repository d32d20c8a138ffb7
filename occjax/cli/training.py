"""The command ``train``: every field of a recipe is an option."""

from __future__ import annotations

import dataclasses
import itertools
import shlex
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated

from tyro.conf import AvoidSubcommands, Positional, arg

from occjax.cli.options import option
from occjax.errors import InputError
from occjax.models import PRESETS, OccCasNetConfig, preset
from occjax.training.config import DataConfig, HostConfig, RunConfig, TrainConfig
from occjax.training.recipes import RECIPES, Recipe, recipe

DEFAULT_RECIPE = "proposal"


def train_command(arguments: Sequence[str]) -> Callable[..., int]:
    """Return the function of the command ``occjax train``.

    The defaults of its options are those of the recipe and the model that the arguments name, so
    that ``--help`` shows them and any of them can be changed.

    Raises:
        InputError: If there is no recipe or model of the given name.
    """
    defaults = _defaults(arguments)

    def command(
        folder: Annotated[
            Path,
            Positional,
            arg(help="Training folder; if it contains a checkpoint, training resumes."),
        ],
        recipe: Annotated[str, arg(help=f"Recipe: {', '.join(RECIPES)}.")] = DEFAULT_RECIPE,
        network_preset: Annotated[
            str | None, option(f"Model instead of the recipe's: {', '.join(PRESETS)}.", "NETWORK")
        ] = None,
        config: Annotated[AvoidSubcommands[TrainConfig], arg(name="")] = defaults.train,
        data: AvoidSubcommands[DataConfig] = defaults.data,
        run: Annotated[RunConfig, arg(name="")] = defaults.run,
        hosts: Annotated[HostConfig, arg(name="")] = HostConfig(),
        validate: Annotated[
            tuple[Path, ...], arg(help="Scenes with ground truth to validate on.", metavar="SCENE")
        ] = (),
        validation_samples: Annotated[
            int, arg(help="Number of procedural light fields to validate on.")
        ] = 0,
        initial_weights: Annotated[
            Path | None,
            option(
                "Initial weights: a file, or a name from 'occjax weights list'. By default random "
                "weights; the recipe residual needs trained ones.",
                "FILE",
            ),
        ] = None,
        overfit_one: Annotated[
            bool, arg(help="Train on the first batch only, and check that its loss halves.")
        ] = False,
        replay: Annotated[
            int | None,
            option(
                "Repeat this step, whose loss was not finite and which training stored, and print "
                "where its numbers stop being finite.",
                "STEP",
            ),
        ] = None,
    ) -> int:
        """Train a model, or resume its training."""
        if overfit_one and config.steps < 2 * run.log_every:
            raise InputError(
                f"--overfit-one needs two lines of the log, but {config.steps} steps with a line "
                f"every {run.log_every} have fewer; pass more --steps or a smaller --log-every"
            )
        # The rest imports JAX. A wrong argument is reported without it.
        from occjax.training.data import fixed, make_source, validation_scenes
        from occjax.training.hosts import first_process_first, is_first_process, join_processes
        from occjax.training.loop import train
        from occjax.training.replay import replay_step
        from occjax.training.validation import scenes_from_folders

        join_processes(hosts)
        if replay is not None:
            print("\n".join(replay_step(config, folder, replay)))
            return 0
        source = first_process_first(
            lambda: make_source(
                data, config.network, trained=config.trained, initial_weights=initial_weights
            )
        )
        scenes = scenes_from_folders(validate)
        scenes += validation_scenes(data, validation_samples)
        resume_command = shlex.join(["occjax", "train", *arguments])
        try:
            trained = train(
                config,
                fixed(source) if overfit_one else source,
                folder,
                run=run,
                validation=scenes,
                data={**dataclasses.asdict(data), "overfit_one": overfit_one},
                batch_size=data.batch_size,
                initial_weights=initial_weights,
            )
        except KeyboardInterrupt:
            print(f"resume with: {resume_command}")
            raise
        if not is_first_process():
            return 0
        if overfit_one and trained.finished:
            return _report_overfit(folder)
        if trained.finished:
            print(
                f"trained: {trained.weights}\n"
                f"use it with: occjax estimate SCENE -o FOLDER --weights {trained.weights}"
            )
        else:
            step = int(trained.state.step)
            print(f"stopped after step {step}; resume with: {resume_command}")
        return 0

    return command


def _defaults(arguments: Sequence[str]) -> Recipe:
    """Return the recipe that the arguments name, with the model that they name."""
    chosen = recipe(_value_of(arguments, "--recipe") or DEFAULT_RECIPE)
    name = _value_of(arguments, "--network-preset")
    if name is None:
        return chosen
    network, scenes = preset(name), chosen.data.scenes
    if isinstance(network, OccCasNetConfig):
        scenes = dataclasses.replace(scenes, grid=network.views, views="all")
    return dataclasses.replace(
        chosen,
        train=dataclasses.replace(chosen.train, network=network),
        data=dataclasses.replace(chosen.data, scenes=scenes),
    )


def _value_of(arguments: Sequence[str], option: str) -> str | None:
    """Return the value of an option, given as ``--option value`` or ``--option=value``."""
    for argument, following in itertools.zip_longest(arguments, arguments[1:]):
        name, equals, value = argument.partition("=")
        if name.replace("_", "-") == option:
            return value if equals else following
    return None


def _report_overfit(folder: Path) -> int:
    """Print first and last loss of the one batch; return 1 if the loss has not halved."""
    from occjax.training.logging import read_log

    entries = [entry for entry in read_log(folder) if entry["kind"] == "train"]
    first, last = entries[0], entries[-1]
    print(
        f"one batch: loss {first['loss']:.4f} at step {first['step']}, {last['loss']:.4f} at step "
        f"{last['step']}; BadPix 0.07 {first['badpix']:.1f} %, {last['badpix']:.1f} %"
    )
    if last["loss"] <= 0.5 * first["loss"]:
        return 0
    print("occjax: the loss of one batch has not halved: training is broken", file=sys.stderr)
    return 1
