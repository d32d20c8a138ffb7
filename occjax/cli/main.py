"""The command line: all commands, each imported when it is needed."""

from __future__ import annotations

import gc
import importlib
import itertools
import sys
from collections.abc import Callable
from typing import NamedTuple

import occjax
from occjax.errors import InputError, nearest
from occjax.xla import disable_unrolling


class Command(NamedTuple):
    """A command of the command line.

    Attributes:
        group: Heading under which the help on all commands lists it.
        module: Module that defines it, in a function of its name with ``_command`` appended.
        summary: Its line in the help on all commands.
    """

    group: str
    module: str
    summary: str


COMMANDS = {
    "estimate": Command("Estimate", "estimating", "Estimate disparity maps."),
    "demo": Command("Estimate", "estimating", "Estimate the bundled sample."),
    "view": Command("Look", "viewing", "Look at results in the browser."),
    "report": Command("Look", "reporting", "Write an HTML page on results."),
    "refocus": Command("Look", "refocusing", "Change the focus or the aperture."),
    "sweep": Command("Look", "refocusing", "Write a video through the views."),
    "check": Command("Measure", "measuring", "Measure view order and disparity range."),
    "evaluate": Command("Measure", "measuring", "Compare with the ground truth."),
    "convert": Command("Convert", "converting", "Convert maps to depth, points or other formats."),
    "pool": Command("Train", "pooling", "Render procedural light fields."),
    "train": Command("Train", "training", "Train a network, or resume its training."),
    "weights": Command("Set up", "weights", "List or download weights."),
    "cache": Command("Set up", "caching", "Show or remove compiled programs."),
}

SHELLS = ("bash", "zsh")
"""Shells whose completion tyro writes without another package."""


def main() -> None:
    """Run the command line and exit with its code."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            # File names may contain characters that the terminal cannot encode; they are escaped.
            stream.reconfigure(errors="backslashreplace")
    arguments = sys.argv[1:]
    if arguments in (["--version"], ["-V"]):
        print(f"occjax {occjax.__version__}")
        sys.exit(0)
    from occjax.cli.running import exit_with

    disable_unrolling()
    try:
        exit_with(lambda: _run(arguments))
    finally:
        # At exit, Python would search all objects for reference cycles, which takes 0.5 s.
        gc.freeze()


def _run(arguments: list[str]) -> int:
    """Run the command that the arguments name, or print the help on all commands."""
    name = arguments[0] if arguments else ""
    if name in COMMANDS:
        import tyro

        return tyro.cli(_function(name, arguments[1:]), prog=f"occjax {name}", args=arguments[1:])
    if name in ("", "-h", "--help"):
        print(_help())
        return 0 if name else 2
    if name == "--print-completion":
        return _print_completion(arguments[1:])
    advice = nearest(name, COMMANDS, otherwise=f"the commands are {', '.join(COMMANDS)}")
    raise InputError(f"{name} is not a command; {advice}")


def _help() -> str:
    """Return the help on all commands."""
    lines = [
        (occjax.__doc__ or "").splitlines()[0],
        "",
        "usage: occjax COMMAND [OPTIONS]",
        "       occjax COMMAND --help",
    ]
    for group, commands in itertools.groupby(COMMANDS.items(), lambda item: item[1].group):
        lines += ["", f"{group}:"]
        lines += [f"  {name:<10}{command.summary}" for name, command in commands]
    lines += [
        "",
        "  --version                  Print the version.",
        f"  --print-completion SHELL   Print a completion script for {', '.join(SHELLS)}.",
    ]
    return "\n".join(lines)


def _print_completion(arguments: list[str]) -> int:
    """Print the completion script of a shell, for all commands with their options."""
    if len(arguments) != 1 or arguments[0] not in SHELLS:
        raise InputError(f"pass the name of a shell to --print-completion: {', '.join(SHELLS)}")
    import tyro

    app = tyro.extras.SubcommandApp()
    for name in COMMANDS:
        app.command(name=name)(_function(name, []))
    app.cli(prog="occjax", args=["--tyro-print-completion", *arguments])
    return 0


def _function(name: str, arguments: list[str]) -> Callable[..., int]:
    """Import the function of a command; for ``train``, with the defaults of recipe and model."""
    module = importlib.import_module(f"occjax.cli.{COMMANDS[name].module}")
    function = getattr(module, f"{name}_command")
    return function(arguments) if name == "train" else function
