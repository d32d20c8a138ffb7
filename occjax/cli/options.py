"""Options that several commands share."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from tyro.conf import arg
from tyro.constructors import PrimitiveConstructorSpec

from occjax.errors import InputError
from occjax.io.layouts import Layout
from occjax.lightfield import Calibration, LightField


def option(help: str, metavar: str | None = None, *aliases: str) -> Any:
    """Describe an argument, without the note on its default that tyro would add."""
    return arg(help=help, metavar=metavar, aliases=aliases, help_behavior_hint="")


def pair(kind: type[int] | type[float]) -> Any:
    """Describe an option of exactly two numbers, see :func:`numbers`.

    Args:
        kind: ``int`` or ``float``.
    """
    return numbers(kind, kind, meaning={int: "two whole numbers", float: "two numbers"}[kind])


def choice(values: Any) -> Any:
    """Describe an option of one of several words; ``None``, its default, cannot be passed.

    Without this, ``None`` would be offered among the words.

    Args:
        values: The ``typing.Literal`` that lists the words.
    """
    return PrimitiveConstructorSpec(
        nargs=1,
        metavar="",  # ``option`` has one
        instance_from_str=lambda words: words[0],
        is_instance=lambda value: value is None or value in get_args(values),
        str_from_instance=lambda value: [value] if value else [],
        choices=get_args(values),
    )


def numbers(*kinds: type[int] | type[float], meaning: str, any_count: bool = False) -> Any:
    """Describe an option of one number per kind; ``None``, its default, cannot be passed.

    Without this, the option would take all words that follow it, also the name of the scene.

    Args:
        *kinds: ``int`` or ``float`` for each number.
        meaning: What they are in words, for messages.
        any_count: Whether the option takes one or more numbers, of the only kind.
    """

    def parse(words: list[str]) -> tuple[int | float, ...]:
        try:
            repeated = kinds * max(1, len(words)) if any_count else kinds
            return tuple(kind(word) for kind, word in zip(repeated, words, strict=True))
        except ValueError:
            raise ValueError(f"pass {meaning}, not {' '.join(words) or 'none'}") from None

    return PrimitiveConstructorSpec(
        nargs="*" if any_count else len(kinds),
        metavar="",  # ``option`` has one
        instance_from_str=parse,
        is_instance=lambda value: value is None or isinstance(value, tuple),
        str_from_instance=lambda value: [str(number) for number in value or ()],
    )


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
        tuple[int, int] | None,
        pair(int),
        option("Number of view rows and columns, as stored.", "V U"),
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
        pair(float),
        option(
            "Distance of neighbouring view rows and of view columns, in any unit, if they differ.",
            "ROWS COLUMNS",
        ),
    ] = None
    views: Annotated[
        tuple[int, int] | None,
        pair(int),
        option("Use only so many rows and columns of views around the centre view.", "V U"),
    ] = None
    max_disparity: Annotated[
        float | None,
        option(
            "Largest disparity to search when the range is measured, in pixels per view step. By "
            "default up to 0.4 of the shorter side of the views.",
            "D",
        ),
    ] = None

    def check(self) -> None:
        """Check the options that can be checked before the files are read.

        Raises:
            InputError: If an option has an impossible value.
        """
        from occjax.io.loading import check_options

        check_options(
            *(self.layout, self.grid, self.order, self.flip),
            *(self.spacing, self.views, self.max_disparity),
        )

    def load(self, path: Path, **options) -> LightField:
        """Read a light field that is stored this way."""
        from occjax.io.loading import load

        return load(path, **dataclasses.asdict(self), **options)


@dataclasses.dataclass(frozen=True)
class CameraOptions:
    """Camera, for depth in metres; each option overrides what the files of the scene say."""

    focal_length_mm: Annotated[
        float | None, option("Focal length of each camera, in millimetres.", "MM")
    ] = None
    sensor_mm: Annotated[
        float | None, option("Longer side of the sensor of each camera, in millimetres.", "MM")
    ] = None
    baseline_mm: Annotated[
        float | None, option("Distance between neighbouring cameras, in millimetres.", "MM")
    ] = None
    focus_m: Annotated[
        float | None,
        option("Distance at which disparity is zero, in metres; inf for parallel cameras.", "M"),
    ] = None

    def calibration(self, stored: Calibration | None) -> Calibration | None:
        """Return the camera of a scene with the given options in place of stored values.

        Args:
            stored: Camera that the files of the scene describe, if any.

        Raises:
            InputError: If a value is not positive, or if only a part of the camera is known.
        """
        given = dict(zip(_CALIBRATION_FIELDS, dataclasses.astuple(self), strict=True))
        given = {name: value for name, value in given.items() if value is not None}
        for name, value in given.items():
            infinite = math.isinf(value) and name != "focus_distance_m"
            if infinite or not value > 0.0:
                raise InputError(
                    f"{_CALIBRATION_FIELDS[name]} is {value:g}; it must be a positive number"
                )
        if not given:
            return stored
        known = {**(dataclasses.asdict(stored) if stored else {}), **given}
        missing = [option for name, option in _CALIBRATION_FIELDS.items() if name not in known]
        if missing:
            raise InputError(
                f"the camera is known in part only; pass {' and '.join(missing)} too"
                + " (inf for parallel cameras)" * ("--focus-m" in missing)
            )
        return Calibration(**known)


_CALIBRATION_FIELDS = {
    "focal_length_mm": "--focal-length-mm",
    "sensor_size_mm": "--sensor-mm",
    "baseline_mm": "--baseline-mm",
    "focus_distance_m": "--focus-m",
}
"""Fields of :class:`Calibration`, and their options in the order of :class:`CameraOptions`."""
