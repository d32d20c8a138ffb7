"""Readers of light fields, and the files that results are written to."""

from occjax.io.arrays import read_arrays, write_arrays
from occjax.io.atomic import atomic_folder, atomic_path
from occjax.io.checking import OrientationReport, check
from occjax.io.images import read_image
from occjax.io.loading import Layout, OrientationWarning, load
from occjax.io.maps import Map, read_map, write_map, write_normals
from occjax.io.mosaics import join_macpi, join_tiles, split_macpi, split_tiles
from occjax.io.naming import GridWarning
from occjax.io.orientation import ORIENTATIONS, Orientation
from occjax.io.pfm import read_pfm, write_pfm
from occjax.io.submission import check_submission, write_submission

__all__ = [
    "ORIENTATIONS",
    "GridWarning",
    "Layout",
    "Map",
    "Orientation",
    "OrientationReport",
    "OrientationWarning",
    "atomic_folder",
    "atomic_path",
    "check",
    "check_submission",
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
    "write_submission",
]
