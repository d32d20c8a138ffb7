"""Readers of light fields, and the files that results are written to."""

from occjax.io.atomic import atomic_folder, atomic_path
from occjax.io.pfm import read_pfm, write_pfm

__all__ = ["atomic_folder", "atomic_path", "read_pfm", "write_pfm"]
