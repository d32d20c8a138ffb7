"""All commands put together."""

from __future__ import annotations

import sys

import jax
import platformdirs
from tyro.extras import SubcommandApp

import occjax
from occjax.cli.converting import convert_command
from occjax.cli.estimating import demo_command, estimate_command
from occjax.cli.measuring import check_command, evaluate_command
from occjax.cli.pooling import pool_command
from occjax.cli.running import exit_with
from occjax.cli.weights import fetch_command, list_command
from occjax.render.command import render_command


def _app(arguments: list[str]) -> SubcommandApp:
    """The commands; that of training reads the arguments for its defaults."""
    weights = SubcommandApp()
    weights.command(name="list")(list_command)
    weights.command(name="fetch")(fetch_command)
    app = SubcommandApp()
    app.command(name="estimate")(estimate_command)
    app.command(name="evaluate")(evaluate_command)
    app.command(name="check")(check_command)
    app.command(name="convert", help=_convert_help(arguments))(convert_command)
    app.command(name="demo")(demo_command)
    app.command(weights, name="weights", help="Weights of the networks.")
    app.command(name="pool")(pool_command)
    app.command(name="train")(_train_command(arguments))
    app.command(name="render")(render_command)
    return app


def _convert_help(arguments: list[str]) -> str | None:
    """All of its docstring for itself, without the examples in the help on all commands."""
    alone = arguments[:1] == ["convert"]
    return None if alone else (convert_command.__doc__ or "").splitlines()[0]


def _train_command(arguments: list[str]):
    if arguments[:1] != ["train"]:

        def train_command() -> int:
            """Train a network, or go on with training it."""
            return 0  # only its first line is shown, by the help on all commands

        return train_command
    # Optimisers and checkpoints take a second to import, which no other command should wait for.
    from occjax.training.command import training_command

    return training_command(arguments[1:])


def main() -> None:
    """Run the command line and exit with its code."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # a name the terminal cannot show is no reason to fail
            stream.reconfigure(errors="backslashreplace")
    if sys.argv[1:] in (["--version"], ["-V"]):
        print(f"occjax {occjax.__version__}")
        sys.exit(0)
    _cache_compilations()
    exit_with(
        lambda: _app(sys.argv[1:]).cli(prog="occjax", description=occjax.__doc__.splitlines()[0])
    )


def _cache_compilations() -> None:
    """Keep compiled programs in the user's cache, so that a second run starts at once."""
    jax.config.update("jax_compilation_cache_dir", platformdirs.user_cache_dir("occjax") + "/xla")
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)
