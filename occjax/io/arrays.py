"""Light fields as NumPy arrays: ``.npz`` and ``.npy``."""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from occjax.errors import InputError, nearest
from occjax.io.atomic import atomic_path
from occjax.io.axes import axis_order, axis_roles, unstacked
from occjax.io.files import decoding, file_size
from occjax.io.limits import ReadLimits
from occjax.lightfield import LightField

OPTIONAL_FIELDS = ("ground_truth", "disparity_range", "positions", "usable")
"""Fields of a light field that an ``.npz`` may contain in addition to ``views``."""


def read_arrays(
    path: str | Path, *, key: str | None = None, grid: tuple[int, int] | None = None
) -> LightField:
    """Read a light field from ``.npz`` or ``.npy``.

    Args:
        path: File with views ``[V, U, H, W]`` or ``[V, U, H, W, C]``: uint8, uint16, or floating
            point in [0, 1]; a fourth channel (alpha) is dropped. An ``.npz`` stores them as
            ``views`` or as its only array. In addition to ``views`` it may contain
            ``ground_truth`` ``[H, W]`` and ``disparity_range`` ``[2]``, both in pixels per view
            step, ``positions`` ``[V, U, 2]``, the ``(row, column)`` of each camera in view
            steps, and ``usable`` ``[V, U]`` bool, False for views that are missing. The case of the
            names does not matter.
        key: Name of the views in an ``.npz``, if it is not ``views``. Arrays of unknown names are
            then ignored.
        grid: ``(V, U)`` of views ``[V * U, H, W]`` or ``[V * U, H, W, C]``, row by row.

    Returns:
        The light field, named after the file.

    Raises:
        InputError: If the file cannot be read, has arrays of unknown names, or does not contain a
            light field.

    Example:
        >>> import tempfile
        >>> path = Path(tempfile.mkdtemp()) / "views.npy"
        >>> np.save(path, np.zeros((3, 3, 8, 8), np.uint8))
        >>> read_arrays(path).views.shape
        (3, 3, 8, 8, 1)
    """
    path = Path(path)
    arrays = load_arrays(path)
    if key is not None and list(arrays) == [""]:
        raise InputError(
            f"{path}: is one array without a name; leave out key (--key {key}), which chooses "
            "among the arrays of an .npz, HDF5 or .mat file"
        )
    views, fields = _views_and_fields(path, arrays, key)
    views = check_views(path, unstacked(views, grid))
    if "ground_truth" in fields:
        fields["ground_truth"] = check_ground_truth(path, fields["ground_truth"], views.shape[2:4])
    if "disparity_range" in fields:
        fields["disparity_range"] = _check_range(path, fields["disparity_range"])
    if "positions" in fields:
        fields["positions"] = check_positions(path, fields["positions"], views.shape[:2])
    return LightField(views=views, name=path.stem, source=path, **fields)


def write_arrays(path: str | Path, light_field: LightField) -> None:
    """Write a light field to an ``.npz`` that :func:`read_arrays` reads, atomically.

    The calibration is not stored.

    Args:
        path: File to write; an existing file is replaced.
        light_field: Views ``[V, U, H, W, C]`` with their optional fields.

    Raises:
        InputError: If the file cannot be written.

    Example:
        >>> import tempfile
        >>> path = Path(tempfile.mkdtemp()) / "scene.npz"
        >>> write_arrays(path, LightField(np.zeros((3, 3, 8, 8, 3), np.uint8)))
        >>> read_arrays(path).grid
        (3, 3)
    """
    fields = {name: getattr(light_field, name) for name in OPTIONAL_FIELDS}
    present: dict[str, Any] = {
        name: np.asarray(value) for name, value in fields.items() if value is not None
    }
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, views=light_field.views, **present)


def load_arrays(
    path: Path, *, what: str = "a NumPy file", remedy: str = "save the array or copy the file again"
) -> dict[str, np.ndarray]:
    """Read all arrays of an ``.npy`` or ``.npz`` file, after a check of their sizes.

    Args:
        path: The file; its suffix does not matter.
        what: Kind of file that is expected, for messages.
        remedy: What the user can do about a damaged file.

    Returns:
        The arrays by name, in the byte order of this machine; the array of an ``.npy`` file has the
        name ``""``. Entries of an archive that are not named ``.npy`` are ignored.

    Raises:
        InputError: If the file cannot be read, contains Python objects, or is too large
            (:class:`occjax.io.limits.ReadLimits`).
    """
    limits = ReadLimits.current()
    with decoding(path, what, remedy=remedy) as file:
        size = file_size(file)
        start = file.read(6)
        if start == b"\x93NUMPY":
            limits.check_bytes(path, _claimed_bytes(file), size)
            return {"": _native(np.lib.format.read_array(file, allow_pickle=False))}
        if not start.startswith(b"PK"):
            raise ValueError("it does not start with the signature of a NumPy file")
        arrays, total = {}, 0
        with zipfile.ZipFile(file) as archive:
            for entry in archive.infolist():
                if not entry.filename.endswith(".npy"):
                    continue
                if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                    raise ValueError("it is compressed by an unusual method")
                with archive.open(entry) as stream:
                    total += _claimed_bytes(stream)
                    limits.check_bytes(path, total, size)
                    array = np.lib.format.read_array(stream, allow_pickle=False)
                arrays[entry.filename.removesuffix(".npy")] = _native(array)
        return arrays


def load_fields(
    path: Path, fields: Mapping[str, Any], *, what: str, remedy: str
) -> dict[str, np.ndarray]:
    """Read the arrays of an ``.npz`` file that this package wrote.

    Args:
        path: The file.
        fields: Type of each array, for instance ``UInt8[np.ndarray, "h w"]``. Axes of the same name
            have the same size in all arrays.
        what: Kind of file that is expected, for messages.
        remedy: What the user can do about a damaged file.

    Returns:
        The arrays of these names.

    Raises:
        InputError: If the file cannot be read, or lacks an array of these types and sizes.
    """
    from jaxtyping import jaxtyped

    arrays = load_arrays(path, what=what, remedy=remedy)
    with jaxtyped("context"):
        for name, kind in fields.items():
            if name not in arrays or not isinstance(arrays[name], kind):
                raise InputError(
                    f"{path}: is not {what}: {name} is missing or has another type or size; "
                    f"{remedy}"
                )
    return {name: arrays[name] for name in fields}


def _claimed_bytes(file: Any) -> int:
    """Return the number of bytes that the header of an ``.npy`` file claims; rewind the file."""
    file.seek(0)
    start = io.BytesIO(file.read(2**14))  # the header must end there
    file.seek(0)
    if np.lib.format.read_magic(start) == (1, 0):
        shape, _, dtype = np.lib.format.read_array_header_1_0(start)
    else:
        shape, _, dtype = np.lib.format.read_array_header_2_0(start)
    if any(length < 0 for length in shape):
        raise ValueError("its header has a negative size")
    return math.prod(shape) * max(1, dtype.itemsize)


def _native(array: np.ndarray) -> np.ndarray:
    """Return an array in the byte order of this machine."""
    return array.astype(array.dtype.newbyteorder("="), copy=False)


def read_npy(path: Path) -> np.ndarray:
    """Read one array from an ``.npy`` file; pickled objects are refused.

    Returns:
        The array, of any shape and numeric type.

    Raises:
        InputError: If the file cannot be read or is an archive of arrays.
    """
    arrays = load_arrays(path)
    if list(arrays) != [""]:
        raise InputError(f"{path}: is an .npz archive named .npy; rename it")
    return arrays[""]


def check_views(path: Path, views: np.ndarray) -> np.ndarray:
    """Return views as ``[V, U, H, W, C]`` uint8, uint16 or float32 in [0, 1], with C of 1 or 3.

    Args:
        path: File or folder that the views come from, for messages.
        views: ``[V, U, H, W]`` or ``[V, U, H, W, C]`` with C up to 4; an alpha channel is dropped.

    Raises:
        InputError: If the shape, type or values are not those of a light field.
    """
    roles = axis_roles(views.shape)
    if not roles:
        raise InputError(
            f"{path}: views have the shape {list(views.shape)}; reorder them to [V, U, H, W] or "
            "[V, U, H, W, C] with 1 or 3 channels; for [V * U, H, W] or [V * U, H, W, C] pass "
            "grid (--grid V U)"
        )
    if not roles[0].startswith("AASS"):
        raise InputError(
            f"{path}: views have the shape {list(views.shape)}, which looks like "
            f"[{', '.join(axis_order(roles[0], reverse=False))}]; transpose it to [V, U, H, W...]"
        )
    views = views if views.ndim == 5 else views[..., None]
    views = views[..., : 1 if views.shape[-1] < 3 else 3]
    if views.dtype.kind == "u" and views.dtype.itemsize <= 2:  # in either byte order
        return np.ascontiguousarray(views, views.dtype.newbyteorder("="))
    if not np.issubdtype(views.dtype, np.floating):
        raise InputError(
            f"{path}: views have the type {views.dtype}; save them as uint8, uint16 or float "
            "in [0, 1]"
        )
    low, high = views.min(), views.max()
    if not (np.isfinite(low) and np.isfinite(high)):
        raise InputError(f"{path}: pixels are NaN or infinite; replace them, e.g. by nan_to_num")
    if low < 0.0 or high > 1.0:
        raise InputError(
            f"{path}: floating point pixels reach from {low:.4g} to {high:.4g}; "
            "scale and clip them to [0, 1]"
        )
    return np.ascontiguousarray(views, np.float32)


def check_ground_truth(path: Path, disparity: np.ndarray, size: tuple[int, ...]) -> np.ndarray:
    """Return ground truth as ``[H, W]`` float32.

    Args:
        path: File that it comes from, for messages.
        disparity: Array of any shape and type.
        size: ``(H, W)`` of the views, in pixels.

    Raises:
        InputError: If it does not consist of numbers, does not have the size of the views, or has
            disparities larger than them.
    """
    if disparity.shape != tuple(size) or disparity.dtype.kind not in "iuf":
        raise InputError(
            f"{path}: ground truth is {list(disparity.shape)} {disparity.dtype} but the views are "
            f"{list(size)}; put the right file there or remove it"
        )
    with np.errstate(over="ignore"):  # values beyond float32 become infinite, which is no value
        disparity = np.ascontiguousarray(disparity, np.float32)
    finite = np.abs(disparity[np.isfinite(disparity)])
    if finite.size and finite.max() > max(size):
        raise InputError(
            f"{path}: ground truth reaches {finite.max():.4g} pixels per view step, more than the "
            f"size of the views ({max(size)}); it may be depth, in another unit or byte-swapped"
        )
    return disparity


def check_positions(path: Path, positions: np.ndarray, grid: tuple[int, ...]) -> np.ndarray:
    """Return camera positions as ``[V, U, 2]`` float32.

    Args:
        path: File that they come from, for messages.
        positions: Array of any shape and type.
        grid: ``(V, U)`` of the views.

    Raises:
        InputError: If there is not one position ``(row, column)`` for each view, or they are all
            the same or not finite.
    """
    (rows, columns), shape = grid, positions.shape
    if shape != (rows, columns, 2) or positions.dtype.kind not in "iuf":
        number = f"has {shape[0]} positions" if shape[1:] == (2,) else "has positions"
        raise InputError(
            f"{path}: {number}, {positions.dtype} {list(shape)}, but the {rows}x{columns} grid has "
            f"{rows * columns} views; write one position (row, column) for each, also for missing "
            "ones, in the order of the views"
        )
    # A larger number is not a length in any unit.
    wrong = np.argwhere(~(np.abs(positions) < 1e15).all(-1))
    if wrong.size:
        row, column = wrong[0]
        raise InputError(
            f"{path}: {len(wrong)} of {rows * columns} positions are NaN, infinite or too large, "
            f"the first in row {row}, column {column} (counted from 0); write numbers"
        )
    positions = positions.astype(np.float32)
    if grid != (1, 1) and not np.ptp(positions, (0, 1)).any():
        raise InputError(f"{path}: positions are all the same; write where each camera is")
    return positions


def _check_range(path: Path, values: np.ndarray) -> tuple[float, float]:
    """Return the disparity range as (minimum, maximum)."""
    if values.shape != (2,) or values.dtype.kind not in "iuf" or not values[0] < values[1]:
        shown = " ".join(str(values).split())[:80]
        raise InputError(f"{path}: disparity_range is {shown}; write (minimum, maximum)")
    return float(values[0]), float(values[1])


def _views_and_fields(
    path: Path, arrays: dict[str, np.ndarray], key: str | None
) -> tuple[np.ndarray, dict[str, Any]]:
    """Return the array of the views, and the optional fields; other names need a key."""
    if key is None and len(arrays) == 1:
        return next(iter(arrays.values())), {}
    named = {name.lower(): array for name, array in arrays.items()}
    if len(named) < len(arrays):
        raise InputError(f"{path}: has keys that differ only in case; remove one of them")
    name = key or "views"
    if name.lower() not in named:
        present = [array for array in arrays if array]
        raise InputError(
            f"{path}: has no array {name!r} (it has: {listed(arrays)}); "
            f"{nearest(name, present, otherwise='pass key (--key NAME)')}"
        )
    known = ("views", *OPTIONAL_FIELDS)
    unknown = [name for name in arrays if name.lower() not in known]
    if unknown and key is None:
        raise InputError(
            f"{path}: has unknown keys ({', '.join(unknown)}); known are {', '.join(known)}; "
            "rename or remove the others, or pass key (--key views)"
        )
    return named[name.lower()], {field: named[field] for field in OPTIONAL_FIELDS if field in named}


def listed(arrays: Mapping[str, Any]) -> str:
    """Return the names and ``shape`` of some arrays, for messages; ``"none"`` if there is none."""
    content = [f"{name} {list(array.shape)}" for name, array in arrays.items()]
    return ", ".join(content[:8]) + ", ..." * (len(content) > 8) if content else "none"
