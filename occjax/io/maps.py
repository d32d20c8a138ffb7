"""Maps of disparity, depth or normals; the suffix of the file name gives the format."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast, get_args

import numpy as np
from PIL import Image

from occjax.errors import InputError
from occjax.io.arrays import read_npy
from occjax.io.atomic import atomic_path
from occjax.io.files import read_errors
from occjax.io.images import read_image
from occjax.io.pfm import read_pfm, write_pfm
from occjax.io.png import read_value_png, write_value_png
from occjax.lightfield import view_name

Quantity = Literal["disparity", "depth"]
"""Quantity of the values of a map."""

UNITS: dict[Quantity, str] = {"disparity": "pixels per view step", "depth": "metres"}

MAP_SUFFIXES = (".pfm", ".npy", ".png")
"""Suffixes of map files that are read and written, in lower case."""

MAP_FILE = f"{', '.join(MAP_SUFFIXES[:-1])} or {MAP_SUFFIXES[-1]} file"
"""Files of :data:`MAP_SUFFIXES`, in words."""

SUMMARY = "summary.json"
"""Name of the file that describes an estimate, in its folder of results."""

RESULTS = "a folder that occjax estimate wrote"
"""A folder of results, in words."""

READ_ONLY_SUFFIXES = (".tif", ".tiff", ".exr")
"""Suffixes of map files that are only read, with floating point values."""


@dataclass(frozen=True, eq=False)
class Map:
    """Disparity or depth of the centre view.

    Attributes:
        values: ``[H, W]`` floating point, in the unit of :data:`UNITS`; NaN is no value.
        quantity: Quantity of the values.
    """

    values: np.ndarray
    quantity: Quantity


def map_of_results(folder: Path, *, accepted: str = RESULTS) -> Path:
    """Return the disparity map in a folder of results.

    Args:
        folder: Folder that ``occjax estimate`` or :meth:`Estimate.save` wrote.
        accepted: What the user can pass, for the message.

    Returns:
        Path of its ``disparity.pfm``.

    Raises:
        InputError: If there is none. The message says whether the results were saved without maps,
            or lie in folders inside of this one.
    """
    with read_errors(folder):
        folder.stat()
    path = folder / "disparity.pfm"
    if path.is_file():
        return path
    if (folder / SUMMARY).is_file():
        raise InputError(
            f"{folder}: its results were saved without maps; estimate again and add maps to --save"
        )
    inside = sorted(path.parent for path in folder.glob("*/disparity.pfm"))
    if not inside:
        raise InputError(f"{folder}: contains no disparity.pfm; pass {accepted}")
    if len(inside) == 1:
        raise InputError(f"{folder}: contains the results of one scene; pass {inside[0]}")
    names = ", ".join(path.name for path in inside[:5]) + ", ..." * (len(inside) > 5)
    raise InputError(
        f"{folder}: contains the results of {len(inside)} scenes ({names}); pass one of them, such "
        f"as {inside[0]}"
    )


def view_of_map(path: Path) -> str | None:
    """Return the name of the view that a map belongs to, if a summary says so.

    Args:
        path: A folder of results, or a file.

    Returns:
        :func:`occjax.lightfield.view_name` of the view that was estimated; None for other folders
        and files.
    """
    folder = path if path.is_dir() else path.parent
    try:
        summary = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
        files = summary["files"]
    except (OSError, ValueError, TypeError, KeyError):  # perhaps a file of another program
        return None
    return view_name(summary.get("view")) if path.is_dir() or path.name in files else None


def read_map(
    path: str | Path,
    *,
    quantity: Quantity | None = None,
    scale: float | None = None,
    offset: float | None = None,
) -> Map:
    """Read a map of disparity or depth.

    Args:
        path: ``.pfm``, ``.npy``, grey ``.png``, or ``.tif`` or ``.exr`` file of floating point
            values; or a folder of results, of which ``disparity.pfm`` is read.
        quantity: Quantity of the values. By default the one that a PNG states, else depth if the
            file name contains it (``depth.npy``, ``gt_depth_lowres.pfm``), else disparity.
        scale: Value of one code, for a PNG that does not store its scale.
        offset: Value of code 0, for such a PNG; 0 by default.

    Returns:
        The map ``[H, W]``, top row first.

    Raises:
        InputError: If the file does not contain one map of real numbers, or states another
            quantity.

    Example:
        >>> import tempfile
        >>> path = Path(tempfile.mkdtemp()) / "depth.npy"
        >>> np.save(path, np.array([[1, 2]]))
        >>> read_map(path).quantity, read_map(path).values.tolist()
        ('depth', [[1.0, 2.0]])
    """
    path = Path(path)
    with read_errors(path):
        path.stat()
    if path.is_dir():
        path = map_of_results(path, accepted=f"{RESULTS} or a {MAP_FILE}")
    suffix = path.suffix.lower()
    if suffix != ".png" and (scale is not None or offset is not None):
        raise InputError(f"{path}: --scale and --offset apply only to a PNG; pass neither")
    stated = None
    if suffix == ".png":
        values, stated = read_value_png(path, scale=scale, offset=offset)
    elif suffix == ".pfm":
        values = read_pfm(path)
    elif suffix == ".npy":
        values = read_npy(path)
        if values.dtype.kind not in "iuf":
            raise InputError(f"{path}: does not contain real numbers; save them as float32")
        if values.dtype.kind != "f":
            values = values.astype(np.float64)
    elif suffix in READ_ONLY_SUFFIXES:
        image = read_image(path)
        if not np.issubdtype(image.dtype, np.floating):
            raise InputError(f"{path}: holds {image.dtype} codes; save the map as 32-bit floats")
        values = image[..., 0] if image.shape[2] == 1 else image
    elif suffix == ".npz":
        raise InputError(f"{path}: an archive of arrays; save the map alone, as a .npy file")
    else:
        raise InputError(
            f"{path}: not a map of disparity or depth; pass a .pfm, .npy, .png, .tif or .exr file"
        )
    if values.ndim != 2 or values.size == 0:
        raise InputError(f"{path}: holds {list(values.shape)}, not a map [H, W]; pass one map")
    return Map(values, _quantity(path, stated, quantity))


def write_map(path: str | Path, content: Map) -> float:
    """Write a map of disparity or depth, atomically.

    Args:
        path: ``.pfm`` or ``.npy``, for 32-bit floats, or ``.png``, for 16-bit codes
            (:mod:`occjax.io.png`); an existing file is replaced.
        content: The map.

    Returns:
        The greatest difference between a value and what is read back from 16-bit codes, in the
        unit of the map; 0 for 32-bit floats.

    Raises:
        InputError: If the suffix is another one, or the file cannot be written.

    Example:
        >>> import tempfile
        >>> path = Path(tempfile.mkdtemp()) / "map.png"
        >>> precision = write_map(path, Map(np.array([[0.5, 3.0]]), "depth"))
        >>> read_map(path).quantity, read_map(path).values.tolist()
        ('depth', [[0.5, 3.0]])
    """
    if Path(path).suffix.lower() == ".png":
        unit = UNITS[content.quantity]
        return write_value_png(path, content.values, quantity=content.quantity, unit=unit)
    _write_floats(path, content.values)
    return 0.0


def write_normals(path: str | Path, normals: np.ndarray) -> None:
    """Write unit normals, atomically.

    Args:
        path: ``.npy`` or ``.pfm`` for 32-bit floats, or ``.png`` for the usual colours: red, green
            and blue are ``(n + 1) / 2`` of x, y and z, 0 to 255; black is no normal. An existing
            file is replaced.
        normals: ``[H, W, 3]`` unit vectors, NaN for no normal.

    Raises:
        InputError: If the suffix is another one, or the file cannot be written.

    Example:
        >>> import tempfile
        >>> path = Path(tempfile.mkdtemp()) / "normals.png"
        >>> write_normals(path, np.array([[[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]]]))
        >>> np.asarray(Image.open(path)).tolist()
        [[[128, 128, 255], [0, 128, 128]]]
    """
    if normals.ndim != 3 or normals.shape[2] != 3 or normals.size == 0:
        raise InputError(f"{path}: normals must be [H, W, 3], not {list(normals.shape)}")
    if Path(path).suffix.lower() != ".png":
        _write_floats(path, normals)
        return
    known = np.isfinite(normals).all(axis=-1, keepdims=True)
    levels = np.floor(127.5 * (np.where(known, normals, -1.0) + 1.0) + 0.5)
    with atomic_path(path) as temporary:
        Image.fromarray(np.clip(levels, 0, 255).astype(np.uint8)).save(temporary, format="PNG")


def flipped_and_negated_maps(disparity: np.ndarray) -> dict[str, np.ndarray]:
    """Return a map ``[H, W]`` with the usual mistakes undone, by words for a message.

    Example:
        >>> flipped_and_negated_maps(np.array([[1, 2], [3, 4]]))["rows are reversed"].tolist()
        [[3, 4], [1, 2]]
    """
    return {
        "rows are reversed": disparity[::-1],
        "columns are reversed": disparity[:, ::-1],
        "rows and columns are reversed": disparity[::-1, ::-1],
        "sign is reversed": -disparity,
    }


def _write_floats(path: str | Path, array: np.ndarray) -> None:
    """Write an array as 32-bit floats."""
    suffix = Path(path).suffix.lower()
    if suffix == ".pfm":
        write_pfm(path, array)
    elif suffix == ".npy":
        with atomic_path(path) as temporary, temporary.open("wb") as file:
            np.save(file, np.asarray(array, np.float32))
    else:
        raise InputError(f"{path}: the name must end in {', '.join(MAP_SUFFIXES)}; rename it")


def _quantity(path: Path, stated: str | None, given: Quantity | None) -> Quantity:
    """Return the quantity that the file states, the given one, or that of the file name."""
    if stated is not None and stated not in get_args(Quantity):
        raise InputError(f"{path}: states that it holds {stated[:40]!r}, not disparity or depth")
    if stated is not None and given not in (None, stated):
        raise InputError(f"{path}: states that it holds {stated}, not {given}")
    named: Quantity = "depth" if "depth" in path.stem.lower() else "disparity"
    return cast(Quantity | None, stated) or given or named
