"""``parameters.cfg``: camera and disparity range of a scene of the HCI 4D benchmark."""

from __future__ import annotations

import configparser
import math
from dataclasses import dataclass
from pathlib import Path

from occjax.errors import InputError
from occjax.io.files import reading
from occjax.lightfield import Calibration


@dataclass(frozen=True)
class HciConfig:
    """What ``parameters.cfg`` says.

    Attributes:
        calibration: Camera parameters.
        disparity_range: ``(minimum, maximum)`` in pixels per view step, if given.
        grid: ``(V, U)``, if given.
        image_size: ``(H, W)`` of the views in pixels, if given.
    """

    calibration: Calibration
    disparity_range: tuple[float, float] | None
    grid: tuple[int, int] | None
    image_size: tuple[int, int] | None = None


def read_hci_config(path: str | Path) -> HciConfig:
    """Read the ``parameters.cfg`` of an HCI scene.

    Args:
        path: File with the sections ``intrinsics``, ``extrinsics`` and ``meta``.

    Raises:
        InputError: If the file cannot be read, lacks a camera parameter, or has an impossible one.

    Example:
        >>> import tempfile
        >>> path = Path(tempfile.mkdtemp()) / "parameters.cfg"
        >>> _ = path.write_text('''[intrinsics]
        ... focal_length_mm = 100.0
        ... sensor_size_mm = 35.0
        ... [extrinsics]
        ... baseline_mm = 50.0
        ... focus_distance_m = 7.2
        ... [meta]
        ... disp_min = -1.6
        ... disp_max = 1.5''')
        >>> read_hci_config(path).disparity_range
        (-1.6, 1.5)
    """
    path = Path(path)
    parser = configparser.ConfigParser(interpolation=None)
    with reading(path):
        content = path.read_bytes()
    try:
        parser.read_string(content.decode("utf-8-sig"))
    except (configparser.Error, UnicodeDecodeError) as error:
        reason = " ".join(str(error).split())[:120]
        raise InputError(
            f"{path}: not a configuration file ({reason}); copy it again or remove it"
        ) from error
    calibration = Calibration(
        focal_length_mm=_required(path, parser, "intrinsics", "focal_length_mm"),
        sensor_size_mm=_required(path, parser, "intrinsics", "sensor_size_mm"),
        baseline_mm=_required(path, parser, "extrinsics", "baseline_mm"),
        focus_distance_m=_required(path, parser, "extrinsics", "focus_distance_m"),
    )
    lowest = _number(path, parser, "meta", "disp_min")
    highest = _number(path, parser, "meta", "disp_max")
    if lowest is not None and highest is not None and not lowest < highest:
        raise InputError(
            f"{path}: disp_min is {lowest:g} and disp_max is {highest:g} in [meta]; "
            "disp_min must be the lower one"
        )
    rows = _count(path, parser, "extrinsics", "num_cams_y")
    columns = _count(path, parser, "extrinsics", "num_cams_x")
    height = _count(path, parser, "intrinsics", "image_resolution_y_px")
    width = _count(path, parser, "intrinsics", "image_resolution_x_px")
    return HciConfig(
        calibration=calibration,
        disparity_range=None if lowest is None or highest is None else (lowest, highest),
        grid=None if rows is None or columns is None else (rows, columns),
        image_size=None if height is None or width is None else (height, width),
    )


def _required(path: Path, parser: configparser.ConfigParser, section: str, field: str) -> float:
    """A positive number that must be there."""
    number = _number(path, parser, section, field)
    if number is None:
        raise InputError(f"{path}: has no {field} in [{section}]; add it, or remove the file")
    if number <= 0.0:
        raise InputError(f"{path}: {field} in [{section}] is {number}; it must be positive")
    return number


def _count(path: Path, parser: configparser.ConfigParser, section: str, field: str) -> int | None:
    """A positive whole number, of cameras or pixels, or None where the file does not have it."""
    number = _number(path, parser, section, field)
    if number is not None and (number < 1 or number != int(number)):
        raise InputError(
            f"{path}: {field} in [{section}] is {number:g}; it must be a positive whole number"
        )
    return None if number is None else int(number)


def _number(
    path: Path, parser: configparser.ConfigParser, section: str, field: str
) -> float | None:
    """A number, or None where the file does not have it."""
    text = parser.get(section, field, fallback=None)
    if text is None:
        return None
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"{path}: {field} in [{section}] is {text[:40]!r}; it must be a number")
    return number
