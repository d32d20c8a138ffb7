"""Settings with which XLA compiles the networks in four fifths of the time on a CPU.

The programs run as fast, since memory limits their speed.
"""

from __future__ import annotations

import os

WITHOUT_UNROLLING = "--xla_backend_extra_options=xla_cpu_disable_loop_unrolling"
"""XLA does not unroll loops. With :func:`compiler_options`, the results are the same bytes."""

_OPTIMIZATION_LEVEL = "xla_backend_optimization_level"


def compiler_options() -> dict[str, str | bool]:
    """Return the options of a program for a CPU, unless the user has set them for all programs.

    Example:
        >>> from unittest.mock import patch
        >>> with patch.dict(os.environ, {"XLA_FLAGS": ""}):
        ...     compiler_options()
        {'xla_backend_optimization_level': '1'}
    """
    is_set = _OPTIMIZATION_LEVEL in os.environ.get("XLA_FLAGS", "")
    return {} if is_set else {_OPTIMIZATION_LEVEL: "1"}


def disable_unrolling() -> None:
    """Add :data:`WITHOUT_UNROLLING` to ``XLA_FLAGS``, unless the user has set such options there.

    If ``XLA_FLAGS`` names a file of flags, it stays as it is. The command line calls this function
    before JAX compiles; later it has no effect. The library does not, since the flag changes how
    other programs of the process are compiled.

    Example:
        >>> from unittest.mock import patch
        >>> with patch.dict(os.environ, {"XLA_FLAGS": "--xla_dump_to=dumps"}):
        ...     disable_unrolling()
        ...     os.environ["XLA_FLAGS"]
        '--xla_dump_to=dumps --xla_backend_extra_options=xla_cpu_disable_loop_unrolling'
    """
    flags = os.environ.get("XLA_FLAGS", "").strip()
    is_file = flags and not flags.startswith("--")
    if not is_file and "--xla_backend_extra_options" not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} {WITHOUT_UNROLLING}".strip()


def user_settings() -> dict[str, str]:
    """Return the environment variables of XLA as the user has set them.

    Example:
        >>> from unittest.mock import patch
        >>> with patch.dict(os.environ, {"XLA_FLAGS": WITHOUT_UNROLLING}):
        ...     user_settings()["XLA_FLAGS"]
        ''
    """
    return {
        name: value.replace(WITHOUT_UNROLLING, "").strip()
        for name, value in sorted({"XLA_FLAGS": "", **os.environ}.items())
        if name.startswith("XLA_")
    }
