"""Options that several commands share."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from tyro.conf import arg

from occjax.io.loading import Layout, load
from occjax.lightfield import LightField


def option(help: str, metavar: str, *aliases: str) -> Any:
    """Describe an optional argument; its default ``None`` is not shown."""
    return arg(help=help, metavar=metavar, aliases=aliases, help_behavior_hint="")


@dataclasses.dataclass(frozen=True)
class ViewOrderOptions:
    """How the files store the views; layout and grid are detected if they are not given."""

    layout: Annotated[
        str | None, option(f"How the views are stored: {', '.join(get_args(Layout))}.", "LAYOUT")
    ] = None
    pattern: Annotated[
        str | None,
        option("File names of the views, with {v} and {u} or {i}; * is any text.", "PATTERN"),
    ] = None
    grid: Annotated[
        tuple[int, int] | None, option("Number of view rows and columns, as stored.", "V U")
    ] = None
    key: Annotated[
        str | None, option("Name of the views in an .npz, HDF5 or .mat file.", "NAME")
    ] = None
    order: Annotated[
        Literal["vu", "uv", "serpentine"],
        arg(
            help="vu if the files count rows first, uv if columns, serpentine if rows first and "
            "every second row backwards."
        ),
    ] = "vu"
    flip: Annotated[
        str,
        option("Axes of the grid that are reversed in the files: v, u or vu.", "AXES"),
    ] = ""

    spacing: Annotated[
        tuple[float, float] | None,
        option(
            "Distance of neighbouring view rows and of view columns, in any unit, if they differ.",
            "ROWS COLUMNS",
        ),
    ] = None

    def load(self, path: Path, **options) -> LightField:
        """Read a light field that is stored this way."""
        return load(path, **dataclasses.asdict(self), **options)
