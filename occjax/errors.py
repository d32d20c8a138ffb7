"""The exception for unusable input, checks that raise it, and warnings."""

from __future__ import annotations

import difflib
import operator
import os
import sys
import warnings
from collections.abc import Iterable
from typing import Any, cast, get_args


class InputError(ValueError):
    """A file, folder or argument cannot be used.

    The message is one line: what is wrong, where, and what to do. The command line prints it
    without a traceback and exits with code 2.
    """


def warn(message: str, category: type[Warning] = UserWarning) -> None:
    """Issue a warning that names the last line outside of this package: that of the user.

    Args:
        message: One line: what is wrong, where, and what to do.
        category: Class of the warning.

    Example:
        >>> with warnings.catch_warnings(record=True, action="always") as caught:
        ...     warn("views.png: is dark; use a longer exposure")
        >>> str(caught[0].message)
        'views.png: is dark; use a longer exposure'
    """
    # From Python 3.12 on, skip_file_prefixes of warnings.warn does the same.
    package = os.path.dirname(__file__) + os.sep
    frame, level = sys._getframe(), 1
    while frame.f_back is not None and frame.f_code.co_filename.startswith(package):
        frame, level = frame.f_back, level + 1
    warnings.warn(message, category, stacklevel=level)


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
        raise InputError(f"{name} is {value!r}; {nearest(value, allowed)}")


def check_whole_pair(name: str, value: object, *, minimum: int = 1) -> None:
    """Check that an argument is two whole numbers, of rows and of columns.

    Args:
        name: Name of the argument, for the message.
        value: Value to check.
        minimum: Smallest allowed number.

    Raises:
        InputError: If it is not two whole numbers, or one is smaller.

    Example:
        >>> check_whole_pair("grid", (9, 9))
    """
    try:
        row, column = map(operator.index, cast(Any, value))
    except (TypeError, ValueError):
        row = column = minimum - 1
    if min(row, column) < minimum:
        raise InputError(
            f"{name} is {value!r}; it must be two whole numbers (row, column) of at least {minimum}"
        )


def nearest(name: object, names: Iterable[str], *, otherwise: str = "") -> str:
    """Return advice on an unknown name: the known name that is most like it, else all of them.

    Args:
        name: The unknown name.
        names: The known names.
        otherwise: Advice if none is like it; by default the list of the names.

    Returns:
        The end of a message.

    Example:
        >>> nearest("Photometrik", ["proposal", "photometric"])
        "did you mean 'photometric'?"
        >>> nearest("raft", ["proposal", "photometric"])
        "choose 'proposal' or 'photometric'"
    """
    names = list(names)
    by_lower_case = {known.lower(): known for known in names}
    text = str(name).lower()
    cutoff = 0.6 if len(text) > 2 else 1.0  # two letters are like too many names
    similar = difflib.get_close_matches(text, by_lower_case, n=1, cutoff=cutoff)
    if similar:
        return f"did you mean {by_lower_case[similar[0]]!r}?"
    return otherwise or f"choose {' or '.join(map(repr, names))}"
