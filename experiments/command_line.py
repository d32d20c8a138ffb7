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
    spec = sys.modules["__main__"].__spec__
    prog = None if spec is None else f"python -m {spec.name}"

    def command() -> int:
        if isinstance(run, Mapping):
            result = subcommand_cli_from_dict(dict(run), prog=prog, description=description)
        else:
            result = tyro.cli(run, prog=prog, description=description)
        return result if isinstance(result, int) else 0

    exit_with(command)
