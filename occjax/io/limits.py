"""Limits on what readers decode, which are compared with the headers of files before decoding.

A file of some kilobytes can claim an image of gigabytes. The work of a reader is therefore bounded
by the limits here and, above some size that every machine can hold, by the size of the file.
"""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

from occjax.errors import InputError

VARIABLES = {
    "image_pixels": "OCCJAX_MAX_IMAGE_PIXELS",
    "light_field_bytes": "OCCJAX_MAX_LIGHT_FIELD_BYTES",
}
"""Environment variables that replace the limits, by the name of the limit."""


@dataclass(frozen=True)
class ReadLimits:
    """Largest sizes that readers accept.

    Attributes:
        image_pixels: Number of pixels of one image file.
        light_field_bytes: Bytes of all decoded arrays of a file, and of all views of a folder.
        small_bytes: Decoded bytes up to which the size of the file does not matter.
        expansion: Decoded bytes per byte of the file, above ``small_bytes``. Deflate, the
            compression of PNG, ``.npz`` and HDF5, reaches 1032 at most.
        views_per_file: Views of the grid, with the missing ones, per image of a folder. A cross of
            views in a grid of NxN has about N / 2.
    """

    image_pixels: int = 2**28
    light_field_bytes: int = 2**31
    small_bytes: int = 2**26
    expansion: int = 1100
    views_per_file: int = 50

    @classmethod
    def current(cls) -> ReadLimits:
        """Return the limits, as the environment variables of :data:`VARIABLES` set them.

        Raises:
            InputError: If a variable is not a positive whole number.

        Example:
            >>> ReadLimits.current().light_field_bytes == 2**31
            True
        """
        given = {
            field: os.environ[name] for field, name in VARIABLES.items() if os.environ.get(name)
        }
        for field, text in given.items():
            if not (text.isdecimal() and 0 < len(text) < 20 and int(text) > 0):
                raise InputError(
                    f"{VARIABLES[field]} is {text[:40]!r}; it must be a positive whole number"
                )
        return dataclasses.replace(cls(), **{field: int(text) for field, text in given.items()})

    def check_image(
        self, path: Path, size: Sequence[int], *, pixel_bytes: int, file_bytes: int
    ) -> None:
        """Check the size of an image in a header.

        Args:
            path: File, for the message.
            size: ``(H, W)`` in pixels.
            pixel_bytes: Bytes of a decoded pixel.
            file_bytes: Size of the file.

        Raises:
            InputError: If the image is too large, or much larger than the file.
        """
        pixels = math.prod(size)
        if pixels > self.image_pixels:
            raise InputError(
                f"{path}: claims {size[1]:.9g}x{size[0]:.9g} pixels, more than the limit of "
                f"{self.image_pixels}; copy it again, or set {VARIABLES['image_pixels']} if that "
                "is right"
            )
        self.check_bytes(path, pixels * pixel_bytes, file_bytes)

    def check_bytes(self, path: Path, count: int, file_bytes: int | None = None) -> None:
        """Check the number of bytes that are decoded from a file or a folder.

        Args:
            path: File or folder, for the message.
            count: Number of decoded bytes.
            file_bytes: Size of the file; None for a folder, whose files are checked one by one.

        Raises:
            InputError: If there are too many, or many more than in the file.

        Example:
            >>> ReadLimits().check_bytes(Path("a.npz"), 10**9, file_bytes=1000)
            Traceback (most recent call last):
            ...
            occjax.errors.InputError: a.npz: claims 1 GB of data in a file of 1000 bytes, which is \
damaged; copy it again
        """
        if count > self.light_field_bytes:
            raise InputError(
                f"{path}: claims {_gigabytes(count)} of data, more than the limit of "
                f"{_gigabytes(self.light_field_bytes)}; read a smaller part, or set "
                f"{VARIABLES['light_field_bytes']} if that is right"
            )
        if file_bytes is not None and count > max(self.small_bytes, self.expansion * file_bytes):
            raise InputError(
                f"{path}: claims {_gigabytes(count)} of data in a file of {file_bytes} bytes, "
                "which is damaged; copy it again"
            )


def _gigabytes(count: int) -> str:
    """Return a number of bytes of any magnitude in words; headers claim numbers beyond floats."""
    return f"{Decimal(count) / 10**9:.3g} GB"
