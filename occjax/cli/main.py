"""The command line: all commands, each imported when it is needed."""

from __future__ import annotations

import gc
import importlib
import sys
from collections.abc import Callable
from typing import NamedTuple

import occjax
from occjax.errors import InputError, nearest


class Command(NamedTuple):
    """A command of the command line.

    Attributes:
        module: Module that defines it.
        function: Name of its function.
        summary: Its line in the help on all commands.
    """

    module: str
    function: str
    summary: str


COMMANDS = {
    "estimate": Command(
        "estimating", "estimate_command", "Estimate disparity maps and write them with pictures."
    ),
    "demo": Command(
        "estimating", "demo_command", "Estimate the bundled sample and compare with the truth."
    ),
    "view": Command("viewing", "view_command", "Look at results in the browser."),
    "refocus": Command(
        "refocusing", "refocus_command", "Write an image or a video with another focus or aperture."
    ),
    "sweep": Command("refocusing", "sweep_command", "Write a video that moves through the views."),
    "report": Command(
        "reporting", "report_command", "Write a page on results: maps, scores, points, settings."
    ),
    "check": Command(
        "measuring", "check_command", "Measure the order of the views and the disparity range."
    ),
    "evaluate": Command(
        "measuring", "evaluate_command", "Compare a disparity map with the ground truth."
    ),
    "convert": Command(
        "converting", "convert_command", "Convert maps: formats, depth, normals, point clouds."
    ),
    "weights": Command(
        "weights", "weights_command", "List the weights in the package, or download the published."
    ),
    "cache": Command(
        "caching", "cache_command", "Show or remove the compiled programs that are kept."
    ),
    "pool": Command("pooling", "pool_command", "Render procedural light fields for training."),
    "train": Command("training", "", "Train a network, or resume its training."),
}


def main() -> None:
    """Run the command line and exit with its code."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # a name that the terminal cannot show is no failure
            stream.reconfigure(errors="backslashreplace")
    arguments = sys.argv[1:]
    if arguments in (["--version"], ["-V"]):
        print(f"occjax {occjax.__version__}")
        sys.exit(0)
    from occjax.cli.running import exit_with

    try:
        exit_with(lambda: _run(arguments))
    finally:
        # Python would search the objects of all imported packages for cycles, for 0.5 s.
        gc.freeze()


def _run(arguments: list[str]) -> int:
    """Run the command that the arguments name, or print the help on all commands."""
    import tyro

    name = arguments[0] if arguments else ""
    if name in COMMANDS:
        return tyro.cli(_function(name, arguments[1:]), prog=f"occjax {name}", args=arguments[1:])
    if name and not name.startswith("-"):
        advice = nearest(name, COMMANDS, otherwise=f"the commands are {', '.join(COMMANDS)}")
        raise InputError(f"{name} is not a command; {advice}")
    app = tyro.extras.SubcommandApp()
    for command, (_, _, summary) in COMMANDS.items():
        app.command(name=command)(_described(summary))
    summary = (occjax.__doc__ or "").splitlines()[0]
    return app.cli(prog="occjax", description=summary, args=arguments)


def _function(name: str, arguments: list[str]) -> Callable[..., int]:
    """Import the function of a command; that of training reads the arguments for its defaults."""
    command = COMMANDS[name]
    if name == "train":
        from occjax.training.command import training_command

        return training_command(arguments)
    module = importlib.import_module(f"occjax.cli.{command.module}")
    return getattr(module, command.function)


def _described(summary: str) -> Callable[[], int]:
    """Return a function whose docstring is the summary, for the help on all commands."""

    def command() -> int:
        return 0

    command.__doc__ = summary
    return command
