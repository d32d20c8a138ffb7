"""Light fields as NumPy arrays: ``.npz`` and ``.npy``."""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from occjax.errors import InputError
from occjax.io.atomic import atomic_path
from occjax.io.files import reading
from occjax.lightfield import LightField

EXTRAS = ("ground_truth", "disparity_range", "positions")
"""Fields of a light field that an ``.npz`` may have beside ``views``."""


def read_arrays(path: str | Path, *, key: str | None = None) -> LightField:
    """Read a light field from ``.npz`` or ``.npy``.

    Args:
        path: File with views ``[V, U, H, W]`` or ``[V, U, H, W, C]``: uint8, uint16, or floating
            point in [0, 1]; a fourth channel (alpha) is dropped. An ``.npz`` keeps them under
            ``views`` or as its only array, and may have ``ground_truth`` ``[H, W]``,
            ``disparity_range`` ``[2]`` and ``positions`` ``[V, U, 2]`` beside ``views``, in upper
            or lower case.
        key: Name of the views in the ``.npz``, if another. Further arrays may then be there; they
            are not read.

    Raises:
        InputError: If the file cannot be read, has arrays of unknown names, or its values are no
            light field.

    Example:
        >>> import tempfile
        >>> path = Path(tempfile.mkdtemp()) / "views.npy"
        >>> np.save(path, np.zeros((3, 3, 8, 8), np.uint8))
        >>> read_arrays(path).views.shape
        (3, 3, 8, 8, 1)
    """
    path = Path(path)
    arrays = _arrays(path)
    views = check_views(path, _choose(path, arrays, key))
    extras = _extras(path, arrays, key)
    if "ground_truth" in extras:
        extras["ground_truth"] = check_ground_truth(path, extras["ground_truth"], views.shape[2:4])
    if "disparity_range" in extras:
        low, high = _pair(path, extras["disparity_range"])
        extras["disparity_range"] = (low, high)
    if "positions" in extras:
        if extras["positions"].shape != (*views.shape[:2], 2):
            raise InputError(
                f"{path}: positions are {list(extras['positions'].shape)}, not [V, U, 2]; "
                "write one (row, column) for each view"
            )
        positions = extras["positions"] = extras["positions"].astype(np.float32)
        several = positions.shape[0] * positions.shape[1] > 1
        if not np.isfinite(positions).all() or (several and not np.ptp(positions, (0, 1)).any()):
            raise InputError(f"{path}: positions are all the same or not finite; correct them")
    return LightField(views=views, name=path.stem, source=path, **extras)


def write_arrays(path: str | Path, light_field: LightField) -> None:
    """Write a light field to an ``.npz`` that :func:`read_arrays` reads, atomically.

    Calibration is not kept.

    Example:
        >>> import tempfile
        >>> path = Path(tempfile.mkdtemp()) / "scene.npz"
        >>> write_arrays(path, LightField(np.zeros((3, 3, 8, 8, 3), np.uint8)))
        >>> read_arrays(path).grid
        (3, 3)
    """
    fields = {name: getattr(light_field, name) for name in EXTRAS}
    present: dict[str, Any] = {
        name: np.asarray(value) for name, value in fields.items() if value is not None
    }
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, views=light_field.views, **present)


def check_views(path: Path, views: np.ndarray) -> np.ndarray:
    """Views as ``[V, U, H, W, C]`` uint8, uint16 or float32 in [0, 1], with C of 1 or 3.

    Raises:
        InputError: If shape, type or values are none that a light field can have.
    """
    if views.ndim == 4 and views.shape[-1] > 4:  # else views in one row: [N, H, W, C]
        views = views[..., None]
    if views.ndim != 5 or views.shape[-1] not in (1, 2, 3, 4) or 0 in views.shape:
        raise InputError(
            f"{path}: views are {list(views.shape)}; reorder them to [V, U, H, W] or "
            "[V, U, H, W, C] with 1 or 3 channels"
        )
    v, u, h, w = views.shape[:4]
    if v > h and u > w:
        raise InputError(
            f"{path}: views are {list(views.shape)}, which looks like [H, W, V, U...]; "
            "transpose it to [V, U, H, W...]"
        )
    views = views[..., : 1 if views.shape[-1] < 3 else 3]
    if views.dtype in (np.uint8, np.uint16):
        return np.ascontiguousarray(views)
    if not np.issubdtype(views.dtype, np.floating):
        raise InputError(
            f"{path}: views are {views.dtype}; save them as uint8, uint16 or float in [0, 1]"
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
    """Ground truth as ``[H, W]`` float32.

    Raises:
        InputError: If it is not of the size of the views.
    """
    if disparity.shape != tuple(size) or not np.issubdtype(disparity.dtype, np.number):
        raise InputError(
            f"{path}: ground truth is {list(disparity.shape)} {disparity.dtype} but the views are "
            f"{list(size)}; put the right file there or remove it"
        )
    return np.ascontiguousarray(disparity, np.float32)


def read_npy(path: Path) -> np.ndarray:
    """One array from an ``.npy`` file, never a pickle."""
    arrays = _arrays(path)
    if list(arrays) != [""]:
        raise InputError(f"{path}: is an .npz archive named .npy; rename it")
    return arrays[""]


def _arrays(path: Path) -> dict[str, np.ndarray]:
    """All arrays of the file by name; that of an ``.npy`` file has none. Never a pickle."""
    with reading(path), path.open("rb") as file:
        if not file.read(6).startswith((b"PK", b"\x93NUMPY")):
            raise InputError(f"{path}: not a NumPy file; save the array or copy the file again")
        file.seek(0)
        try:
            loaded = np.load(file, allow_pickle=False)
            return {"": loaded} if isinstance(loaded, np.ndarray) else dict(loaded)
        except MemoryError as error:
            raise InputError(
                f"{path}: its header asks for more memory than there is; save the array again, or "
                "cut the light field into smaller ones"
            ) from error
        except (ValueError, EOFError, zipfile.BadZipFile, zlib.error) as error:
            if "Object arrays" in str(error):
                raise InputError(
                    f"{path}: holds pickled objects, which may run code; save a plain array instead"
                ) from error
            raise InputError(
                f"{path}: not a whole NumPy file; save the array or copy the file again"
            ) from error


def _choose(path: Path, arrays: dict[str, np.ndarray], key: str | None) -> np.ndarray:
    """The array that holds the views."""
    if key is None and len(arrays) == 1:
        return next(iter(arrays.values()))
    wanted = key or "views"
    named = {wanted: arrays[wanted]} if wanted in arrays else _lower(path, arrays)
    if wanted not in named:
        names = ", ".join(name for name in arrays if name) or "none"
        example = next((name for name in arrays if name), "NAME")
        raise InputError(
            f"{path}: has no array {wanted!r} (it has: {names}); pass key (--key {example})"
        )
    return named[wanted]


def _extras(path: Path, arrays: dict[str, np.ndarray], key: str | None) -> dict[str, Any]:
    """What is known about the views beside them; refuses what is not understood."""
    if key is None and len(arrays) == 1:
        return {}
    views = "views" if key is None else key.lower()
    named = _lower(path, arrays)
    unknown = [name for name in arrays if name.lower() not in (views, *EXTRAS)]
    if unknown and key is None:
        raise InputError(
            f"{path}: has unknown keys ({', '.join(unknown)}); known are views, "
            f"{', '.join(EXTRAS)}; rename or remove the others, or pass key (--key views)"
        )
    return {name: named[name] for name in EXTRAS if name in named}


def _lower(path: Path, arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Arrays by their names in lower case."""
    lower = {name.lower(): array for name, array in arrays.items()}
    if len(lower) < len(arrays):
        raise InputError(f"{path}: has keys that differ in case alone; remove one of them")
    return lower


def _pair(path: Path, values: np.ndarray) -> tuple[float, float]:
    """Minimum and maximum."""
    if values.shape != (2,) or not values[0] < values[1]:
        raise InputError(f"{path}: disparity_range is {values.tolist()}; write (minimum, maximum)")
    return float(values[0]), float(values[1])
