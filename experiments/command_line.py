"""How every script is called: by tyro, and a fault of the user's is one line and exit code 2."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from typing import Any, NoReturn

import tyro
from tyro.extras import subcommand_cli_from_dict

from occjax.cli.running import exit_with

Command = Callable[..., Any]
"""Its parameters are the options. If it returns a whole number, that is the exit code."""


def main(run: Command | Mapping[str, Command], description: str | None) -> NoReturn:
    """Call a function with the options of the command line, and exit.

    Args:
        run: The function, or several by the name of a command.
        description: For ``--help``.
    """
    description = description and one_line_each(description)
    spec = sys.modules["__main__"].__spec__
    prog = None if spec is None else f"python -m {spec.name}"

    def command() -> int:
        if isinstance(run, Mapping):
            result = subcommand_cli_from_dict(dict(run), prog=prog, description=description)
        else:
            result = tyro.cli(run, prog=prog, description=description)
        return result if isinstance(result, int) else 0

    exit_with(command)


def one_line_each(text: str) -> str:
    r"""Paragraphs of prose without line breaks: tyro would keep those before what is no letter.

    Example:
        >>> one_line_each("What it\n``does``.\n\n    python -m it\n    python -m it --small")
        'What it ``does``.\n\n    python -m it\n    python -m it --small'
    """
    paragraphs = text.split("\n\n")
    laid_out = [part.startswith((" ", "=")) or "\n " in part for part in paragraphs]
    return "\n\n".join(
        part if keep else part.replace("\n", " ")
        for part, keep in zip(paragraphs, laid_out, strict=True)
    )
