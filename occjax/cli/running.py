"""How a command ends: warnings and faults of the input are one line each, and an exit code."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable
from typing import NoReturn

from tqdm import tqdm

from occjax.errors import InputError


def exit_with(command: Callable[[], int]) -> NoReturn:
    """Run a command and exit with its code.

    Args:
        command: Returns the exit code. What the input is at fault for is one line and code 2.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("default", UserWarning)
        warnings.showwarning = show_warning
        sys.exit(_code_of(command))


def show_warning(message, category, filename, lineno, file=None, line=None) -> None:
    """A warning as one line, without the place in the code that means nothing to a user."""
    tqdm.write(f"occjax: warning: {message}", file=sys.stderr)


def _code_of(command: Callable[[], int]) -> int:
    try:
        code = command()
        sys.stdout.flush()
    except InputError as error:
        print(f"occjax: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:  # the reader of our output, head for instance, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except KeyboardInterrupt:
        print("occjax: interrupted", file=sys.stderr)
        return 130
    return code
