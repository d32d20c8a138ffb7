"""Names of the layouts in which light fields are stored."""

from __future__ import annotations

from typing import Literal

FolderLayout = Literal["hci", "lytro", "urbanlf", "stanford"]
"""Layout of a folder with one image per view."""

Mosaic = Literal["tiled", "macpi", "quilt"]
"""Arrangement of all views in one image."""

Layout = Literal[FolderLayout, Mosaic, "array", "hdf5"]
"""Layout of the files of a light field."""
