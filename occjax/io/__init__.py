"""Readers of light fields, and readers and writers of maps."""

from occjax.io.arrays import read_arrays, write_arrays
from occjax.io.atomic import atomic_folder, atomic_path
from occjax.io.images import read_image
from occjax.io.loading import Layout, ViewOrderWarning, load
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
