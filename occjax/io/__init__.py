"""Readers of light fields, and readers and writers of maps."""

from __future__ import annotations

from typing import TYPE_CHECKING

from occjax.lazy import lazy_names

if TYPE_CHECKING:
    from occjax.io.arrays import read_arrays, write_arrays
    from occjax.io.atomic import atomic_folder, atomic_path
    from occjax.io.images import read_image
    from occjax.io.layouts import Layout
    from occjax.io.loading import ViewOrderWarning, load
    from occjax.io.maps import Map, read_map, write_map, write_normals
    from occjax.io.mosaics import join_macpi, join_tiles, split_macpi, split_tiles
    from occjax.io.naming import GridWarning
    from occjax.io.pfm import read_pfm, write_pfm

__all__ = [
    "GridWarning",
    "Layout",
    "Map",
    "ViewOrderWarning",
    "atomic_folder",
    "atomic_path",
    "join_macpi",
    "join_tiles",
    "load",
    "read_arrays",
    "read_image",
    "read_map",
    "read_pfm",
    "split_macpi",
    "split_tiles",
    "write_arrays",
    "write_map",
    "write_normals",
    "write_pfm",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "occjax.io.arrays": ("read_arrays", "write_arrays"),
        "occjax.io.atomic": ("atomic_folder", "atomic_path"),
        "occjax.io.images": ("read_image",),
        "occjax.io.layouts": ("Layout",),
        "occjax.io.loading": ("ViewOrderWarning", "load"),
        "occjax.io.maps": ("Map", "read_map", "write_map", "write_normals"),
        "occjax.io.mosaics": ("join_macpi", "join_tiles", "split_macpi", "split_tiles"),
        "occjax.io.naming": ("GridWarning",),
        "occjax.io.pfm": ("read_pfm", "write_pfm"),
    },
)
