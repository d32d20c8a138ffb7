"""``parameters.cfg``: camera and disparity range of a scene of the HCI 4D benchmark."""

from __future__ import annotations

import configparser
import math
from dataclasses import dataclass
from pathlib import Path

from occjax.errors import InputError
from occjax.io.files import decoding
from occjax.lightfield import Calibration

PARAMETERS = "parameters.cfg"
"""Name of the file in the folder of a scene."""

GROUND_TRUTH = "gt_disp_lowres.pfm"
"""Name of the file with the true disparity of the centre view, in pixels per view step."""


@dataclass(frozen=True)
class HciConfig:
    """Content of ``parameters.cfg``.

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

    Returns:
        Camera, disparity range and sizes.

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
    fields = _Fields(path)
    calibration = Calibration(
        focal_length_mm=fields.positive("intrinsics", "focal_length_mm"),
        sensor_size_mm=fields.positive("intrinsics", "sensor_size_mm"),
        baseline_mm=fields.positive("extrinsics", "baseline_mm"),
        focus_distance_m=fields.positive("extrinsics", "focus_distance_m"),
    )
    lowest, highest = fields.number("meta", "disp_min"), fields.number("meta", "disp_max")
    if lowest is not None and highest is not None and not lowest < highest:
        raise InputError(
            f"{path}: disp_min is {lowest:g} and disp_max is {highest:g} in [meta]; "
            "disp_min must be the lower one"
        )
    rows, columns = (fields.count("extrinsics", f"num_cams_{axis}") for axis in "yx")
    height, width = (fields.count("intrinsics", f"image_resolution_{axis}_px") for axis in "yx")
    return HciConfig(
        calibration=calibration,
        disparity_range=None if lowest is None or highest is None else (lowest, highest),
        grid=None if rows is None or columns is None else (rows, columns),
        image_size=None if height is None or width is None else (height, width),
    )


class _Fields:
    """The fields of a configuration file, checked when they are read."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.parser = configparser.ConfigParser(interpolation=None)
        what, remedy = "a configuration file", "copy it again or remove it"
        # Files of the benchmark have 1 kB. The time of the parser grows with the square of the
        # length of a line.
        with decoding(path, what, remedy=remedy, max_bytes=2**13) as file:
            self.parser.read_string(file.read().decode("utf-8-sig"))

    def number(self, section: str, field: str) -> float | None:
        """Return a number, or None if the file does not have it."""
        text = self.parser.get(section, field, fallback=None)
        if text is None:
            return None
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            raise InputError(
                f"{self.path}: {field} in [{section}] is {text[:40]!r}; it must be a number"
            )
        return number

    def positive(self, section: str, field: str) -> float:
        """Return a required positive number."""
        number = self.number(section, field)
        if number is None:
            raise InputError(
                f"{self.path}: has no {field} in [{section}]; add it, or remove the file"
            )
        if number <= 0.0:
            raise InputError(
                f"{self.path}: {field} in [{section}] is {number}; it must be positive"
            )
        return number

    def count(self, section: str, field: str) -> int | None:
        """Return a positive number of cameras or pixels, or None if the file does not have it."""
        number = self.number(section, field)
        if number is not None and (number < 1 or number != int(number)):
            raise InputError(
                f"{self.path}: {field} in [{section}] is {number:g}; it must be a positive whole "
                "number"
            )
        return None if number is None else int(number)
