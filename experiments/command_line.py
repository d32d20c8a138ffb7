"""Command line of the scripts: tyro, with one line and exit code 2 for an error of the user."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, NoReturn

import tyro
from tyro.extras import subcommand_cli_from_dict

from occjax.cli.running import exit_with

Command = Callable[..., Any]
"""A function whose parameters are the options; an integer result is the exit code."""

TrueScenes = tyro.conf.Positional[
    Annotated[tuple[Path, ...], tyro.conf.arg(help="Scenes with ground truth.")]
]
"""Type of the argument of several scenes."""

Models = Annotated[tuple[str, ...], tyro.conf.arg(help="Names of models, or files of weights.")]
"""Type of the option ``--models``."""

Small = Annotated[bool, tyro.conf.arg(help="Smoke test on small built-in data; no download.")]
"""Type of the option ``--small``."""

SMOKE_TEST = "This is a smoke test: its results say nothing about a method."


def announce_smoke_test() -> None:
    """Print the limits of a smoke test to standard error; standard output is for tables."""
    print(SMOKE_TEST, file=sys.stderr)


def main(run: Command | Mapping[str, Command], description: str | None) -> NoReturn:
    """Call a function with the options of the command line, and exit.

    Args:
        run: The function, or several by subcommand.
        description: Text for ``--help``.
    """
    description = description and join_prose(description)
    spec = sys.modules["__main__"].__spec__
    prog = None if spec is None else f"python -m {spec.name}"

    def command() -> int:
        if isinstance(run, Mapping):
            result = subcommand_cli_from_dict(dict(run), prog=prog, description=description)
        else:
            result = tyro.cli(run, prog=prog, description=description)
        return result if isinstance(result, int) else 0

    exit_with(command)


def join_prose(text: str) -> str:
    r"""Return the text with the lines of each prose paragraph joined, as tyro expects.

    Example:
        >>> join_prose("What it\n``does``.\n\n    python -m it\n    python -m it --small")
        'What it ``does``.\n\n    python -m it\n    python -m it --small'
    """
    paragraphs = text.split("\n\n")
    laid_out = [part.startswith((" ", "=")) or "\n " in part for part in paragraphs]
    return "\n\n".join(
        part if keep else part.replace("\n", " ")
        for part, keep in zip(paragraphs, laid_out, strict=True)
    )
