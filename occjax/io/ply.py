"""Point clouds in the PLY format, which 3D viewers open."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from occjax.errors import InputError
from occjax.io.atomic import atomic_path

_COORDINATES = [(name, "<f4") for name in ("x", "y", "z")]
_COLOURS = [(name, "u1") for name in ("red", "green", "blue")]
_PLY_TYPES = {"<f4": "float", "u1": "uchar"}


def write_ply(
    path: str | Path, points: np.ndarray, colours: np.ndarray | None, *, comment: str = ""
) -> None:
    r"""Write a point cloud as binary little-endian PLY, atomically.

    Args:
        path: File to write; an existing file is replaced.
        points: ``[N, 3]`` coordinates x, y, z; stored as 32-bit floats.
        colours: ``[N, 3]`` uint8 red, green, blue; None for points without colour.
        comment: One line for the header, such as the unit.

    Raises:
        InputError: If the shapes of the arrays are wrong or differ, the colours are not uint8, or
            the file cannot be written.

    Example:
        >>> import tempfile
        >>> path = Path(tempfile.mkdtemp()) / "points.ply"
        >>> write_ply(path, np.zeros((1, 3)), np.full((1, 3), 255, np.uint8), comment="metres")
        >>> path.read_bytes().split(b"\n")[:4]
        [b'ply', b'format binary_little_endian 1.0', b'comment metres', b'element vertex 1']
    """
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"{path}: points must be [N, 3], not {list(points.shape)}")
    if colours is not None and colours.shape != points.shape:
        raise InputError(
            f"{path}: points and colours must both be [N, 3], not {list(points.shape)} and "
            f"{list(colours.shape)}"
        )
    if colours is not None and colours.dtype != np.uint8:
        raise InputError(f"{path}: colours must be uint8, not {colours.dtype}; scale them to 0-255")
    fields = _COORDINATES if colours is None else _COORDINATES + _COLOURS
    columns = [*points.T] if colours is None else [*points.T, *colours.T]
    vertices = np.empty(len(points), fields)
    for (name, _), column in zip(fields, columns, strict=True):
        vertices[name] = column
    header = [
        "ply",
        "format binary_little_endian 1.0",
        *([f"comment {comment}"] if comment else []),
        f"element vertex {len(points)}",
        *(f"property {_PLY_TYPES[kind]} {name}" for name, kind in fields),
        "end_header\n",
    ]
    with atomic_path(path) as temporary:
        temporary.write_bytes("\n".join(header).encode("ascii", "replace") + vertices.tobytes())
