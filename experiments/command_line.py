"""How every script is called: by tyro, and a fault of the user's is one line and exit code 2."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import tyro

from occjax.errors import InputError


def main(run: Callable[..., Any]) -> None:
    """Call a function with the options of the command line.

    Args:
        run: Whose parameters are the options.
    """
    try:
        tyro.cli(run)
    except InputError as error:
        print(f"{sys.argv[0]}: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)
