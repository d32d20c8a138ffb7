"""The command ``cache``."""

from __future__ import annotations

from typing import Annotated, Literal

from tyro.conf import Positional, arg


def cache_command(
    action: Annotated[
        Literal["show", "clear"],
        Positional,
        arg(help="show the folder and size of the compiled programs, or clear (remove) them."),
    ] = "show",
) -> int:
    """Show or remove the compiled programs that are kept for later runs."""
    from occjax.programs import (
        MAX_CACHE_BYTES,
        cache_fault,
        cache_folder,
        cached_programs,
        clear_cache,
    )

    found = cached_programs()
    size = sum(path.stat().st_size for path in found) / 1e6
    content = f"{len(found)} program{'s' * (len(found) != 1)} of {size:.1f} MB"
    if action == "clear":
        clear_cache()
        print(f"{cache_folder()}: removed {content}")
    else:
        limit = MAX_CACHE_BYTES / 1e6
        fault = cache_fault()
        print(
            f"{cache_folder()}: {content}, at most {limit:.0f} MB"
            + (f"; not in use: {fault}" if fault else "")
        )
    return 0
