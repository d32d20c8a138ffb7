"""Point clouds in the PLY format, which every 3D viewer opens."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from occjax.errors import InputError
from occjax.io.atomic import atomic_path

PLACE = [(name, "<f4") for name in ("x", "y", "z")]
COLOUR = [(name, "u1") for name in ("red", "green", "blue")]


def write_ply(
    path: str | Path, points: np.ndarray, colours: np.ndarray | None, *, comment: str = ""
) -> None:
    r"""Write a point cloud atomically, as binary little-endian PLY.

    Args:
        path: File to write; one that is there is replaced.
        points: ``[N, 3]`` coordinates x, y, z; stored as 32-bit floats.
        colours: ``[N, 3]`` uint8 red, green, blue; None for points without colour.
        comment: One line for the header, such as the unit.

    Raises:
        InputError: If the arrays do not fit together or the file cannot be written.

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
    fields = PLACE if colours is None else PLACE + COLOUR
    vertices = np.empty(len(points), fields)
    for axis, (name, _) in enumerate(PLACE):
        vertices[name] = points[:, axis]
    if colours is not None:
        for channel, (name, _) in enumerate(COLOUR):
            vertices[name] = colours[:, channel]
    kinds = {"<f4": "float", "u1": "uchar"}
    header = [
        "ply",
        "format binary_little_endian 1.0",
        *([f"comment {comment}"] if comment else []),
        f"element vertex {len(points)}",
        *(f"property {kinds[kind]} {name}" for name, kind in fields),
        "end_header\n",
    ]
    with atomic_path(path) as temporary:
        temporary.write_bytes("\n".join(header).encode("ascii", "replace") + vertices.tobytes())
