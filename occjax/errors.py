"""The exception for unusable input, and a check that raises it."""

from __future__ import annotations

from typing import Any, get_args


class InputError(ValueError):
    """A file, folder or argument cannot be used.

    The message is one line: what is wrong, where, and what to do. The command line prints it
    without a traceback and exits with code 2.
    """


def check_one_of(name: str, value: object, choices: Any) -> None:
    """Check that an option has one of the values that its type allows.

    Args:
        name: Name of the option, for the message.
        value: Value to check.
        choices: The ``typing.Literal`` that lists the allowed values.

    Raises:
        InputError: If the value is not in the list.

    Example:
        >>> from typing import Literal
        >>> check_one_of("border", "zero", Literal["replicate", "zero"])
    """
    allowed = get_args(choices)
    if value not in allowed:
        raise InputError(f"{name} is {value!r}; pass {' or '.join(map(repr, allowed))}")
