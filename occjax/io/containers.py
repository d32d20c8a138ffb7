"""Light fields in files that hold several arrays: HDF5 and MATLAB's ``.mat``.

MATLAB writes HDF5, and its ``.mat`` files of version 7.3, with the axes in reverse order. The order
of the axes is read from an attribute ``axes``, or inferred from their sizes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from occjax.errors import InputError, nearest, warn
from occjax.io.arrays import check_views, listed
from occjax.io.axes import axis_order, axis_roles, named_axis_order, to_usual_order, unstacked
from occjax.io.consistency import most_consistent
from occjax.io.files import decoder_errors, decoding
from occjax.io.hdf5 import check_heaps, read_dataset
from occjax.io.matlab import read_mat_arrays
from occjax.io.mosaics import repeated_tiles, split_tiles
from occjax.io.naming import GridWarning
from occjax.io.old_hci import old_hci_camera, old_hci_disparity
from occjax.lightfield import LightField

CONTAINER_SUFFIXES = (".h5", ".hdf5", ".mat")
"""Suffixes of the files, in lower case."""

KNOWN_KEYS = ("LF", "Hr_SAI_y")
"""Names of the views in the old HCI benchmark and in sets for super-resolution."""

_TRANSPOSED = str.maketrans("VUHW", "UVWH")


@dataclass(frozen=True)
class StoredArray:
    """An array in a file, which is not read yet.

    Attributes:
        shape: Sizes of its axes.
        read: Returns the array.
        attributes: What the file states about it.
        reversed: Whether the axes are in reverse order, as MATLAB stores them; None if unknown.
    """

    shape: tuple[int, ...]
    read: Callable[[], np.ndarray]
    attributes: Mapping[str, Any] = field(default_factory=dict)
    reversed: bool | None = False


def read_container(
    path: str | Path, *, key: str | None = None, grid: tuple[int, int] | None = None
) -> LightField:
    """Read a light field from an HDF5 or ``.mat`` file.

    Args:
        path: File with views in an array of four or five axes, stacked in one axis in place of two,
            or tiled in two axes. If it has the attributes ``dH``, ``focalLength`` and ``shift`` or
            ``camDistance`` of the old HCI benchmark, the light field has a calibration, and a
            ground truth if there is also an array ``GT_DEPTH``.
        key: Name of the views, with or without the groups; None for ``LF``, ``Hr_SAI_y``, or the
            only array of views.
        grid: ``(V, U)`` of tiled or stacked views; None to detect it.

    Returns:
        The light field, named after the file.

    Raises:
        InputError: If the file cannot be read, h5py is missing, or not exactly one array can be the
            views.

    Warns:
        GridWarning: If the axes are not in the order ``[V, U, H, W, C]``, or if the views may lie
            on their side.
        UserWarning: If the ground truth cannot be used, because attributes are missing.
    """
    path = Path(path)
    if path.suffix.lower() == ".mat" and not _is_hdf5(path):
        arrays = {
            name: StoredArray(array.shape, partial(np.asarray, array))
            for name, array in read_mat_arrays(path).items()
        }
        return _read_light_field(path, arrays, {}, key, grid)
    try:
        import h5py
    except ImportError as error:
        raise InputError(
            f"{path}: reading HDF5 needs h5py; run pip install 'occjax[published]'"
        ) from error
    with decoding(path, "an HDF5 file", max_bytes=math.inf) as opened:
        check_heaps(opened)
        file = h5py.File(path, "r")
    with file:
        found: dict[str, StoredArray] = {}

        def add(name: str, stored: Any) -> None:
            numeric = isinstance(stored, h5py.Dataset) and stored.dtype.kind in "biuf"
            if numeric and stored.shape is not None and not name.startswith("#"):
                matlab = written_by_matlab or "MATLAB_class" in stored.attrs
                read = partial(read_dataset, path, stored)
                attributes = {**stored.parent.attrs, **stored.attrs}
                found[name] = StoredArray(stored.shape, read, attributes, matlab or None)

        with decoder_errors(path, "an HDF5 file", remedy="write or copy it again"):
            written_by_matlab = path.suffix.lower() == ".mat" or file.userblock_size > 0
            file.visititems(add)
            attributes = dict(file.attrs)
        return _read_light_field(path, found, attributes, key, grid)


def _is_hdf5(path: Path) -> bool:
    """Return whether a file is HDF5, with or without the header of MATLAB."""
    with decoding(path, "a MATLAB file", max_bytes=math.inf) as file:
        start = file.read(520)
    return b"\x89HDF\r\n\x1a\n" in (start[:8], start[512:])


def _read_light_field(
    path: Path,
    arrays: dict[str, StoredArray],
    attributes: dict[str, Any],
    key: str | None,
    grid: tuple[int, int] | None,
) -> LightField:
    """Read the views and what belongs to them."""
    name = _find_views(path, arrays, key)
    stored = arrays[name]
    order = "HW"
    if len(stored.shape) == 2:
        image = stored.read()
        if stored.reversed or (stored.reversed is None and "_SAI_" in name):  # written by MATLAB
            image, order = image.T, "WH"
        tiles = grid or repeated_tiles(image)
        if tiles is None:
            raise InputError(
                f"{path}: {name} is {list(image.shape)}, whose grid of tiles is unknown; "
                "pass grid (--grid V U)"
            )
        views = check_views(path, split_tiles(image[..., None], tiles))
    elif grid is not None and not axis_roles(stored.shape):
        views = check_views(path, unstacked(stored.read(), grid))
    else:
        orders, array = _orders(path, name, stored), stored.read()
        readings = [check_views(path, to_usual_order(array, order)) for order in orders]
        chosen = 0 if len(orders) == 1 else most_consistent(readings)
        views, order = readings[chosen], orders[chosen]
        doubt = ""
        if not order.startswith("VUHW"):
            doubt = "; save it as [V, U, H, W, C] if that is wrong"
        elif "axes" not in stored.attributes and views.shape[2] > views.shape[3]:
            # With grid and images both transposed, the views are as consistent. Only the shape of
            # the images is a sign of it.
            doubt = (
                ", images higher than wide; if they lie on their side, it is "
                f"[{', '.join(order.translate(_TRANSPOSED))}]; save it as [V, U, H, W, C]"
            )
        if doubt:
            read = f"{path}: {name} is {list(stored.shape)}, read as [{', '.join(order)}]"
            warn(read + doubt, GridWarning)
    calibration, missing = old_hci_camera({**stored.attributes, **attributes}, views.shape[2:4])
    depth = arrays.get("GT_DEPTH")
    if missing and (depth or len(missing) < 3):  # a file of the old HCI benchmark, incomplete
        warn(
            f"{path}: has no attribute {' and '.join(missing)}, so metric depth and GT_DEPTH are "
            "not used; add the attributes"
        )
    truth = None
    if depth and calibration:
        values = depth.read()
        if values.ndim == len(order.replace("C", "")):
            values = to_usual_order(values, order.replace("C", ""))
        elif order.index("W") < order.index("H"):
            values = values.T
        truth = old_hci_disparity(path, values, calibration, views.shape[:4])
    return LightField(
        views=views, name=path.stem, source=path, calibration=calibration, ground_truth=truth
    )


def _find_views(path: Path, arrays: dict[str, StoredArray], key: str | None) -> str:
    """Return the name of the views."""
    if key is not None:
        matching = [name for name in arrays if key in (name, name.rsplit("/")[-1])]
    else:
        matching = [name for name in KNOWN_KEYS if name in arrays][:1] or [
            name
            for name, stored in arrays.items()
            if axis_roles(stored.shape) and not any(s in name.lower() for s in ("depth", "disp"))
        ]
        if not matching and len(arrays) == 1:
            matching = list(arrays)  # tiled or stacked views, or a message on its shape
    if len(matching) == 1:
        return matching[0]
    if key is not None:
        problem = f"has no array {key!r}" if not matching else f"has several arrays {key!r}"
    else:
        problem = "has several arrays of views" if matching else "has no array of views"
    advice = "save the views as [V, U, H, W, C]" if not arrays else "pass key (--key NAME)"
    if key is not None and not matching:
        advice = nearest(key, [name.rsplit("/")[-1] for name in arrays], otherwise=advice)
    raise InputError(f"{path}: {problem} (it has: {listed(arrays)}); {advice}")


def _orders(path: Path, name: str, stored: StoredArray) -> list[str]:
    """Return the plausible orders of the axes of the views."""
    named = np.ravel(stored.attributes.get("axes", ())).tolist()
    words = [str(w, "utf-8", "replace") if isinstance(w, bytes) else str(w) for w in named]
    if order := named_axis_order(" ".join(words), stored.shape):
        return [order]
    roles = axis_roles(stored.shape)
    if not roles:
        raise InputError(
            f"{path}: {name} is {list(stored.shape)}, in which no order of the axes V, U (views), "
            "H, W (pixels) and C (colours) is plausible; save the views as [V, U, H, W, C], or "
            "pass grid (--grid V U) for [V * U, H, W, C]"
        )
    # Other programs than MATLAB rarely put the axes of the images before those of the views, so if
    # the writer is unknown, this order is read as MATLAB's.
    matlab = [
        role.startswith(("S", "CS")) if stored.reversed is None else stored.reversed
        for role in roles
    ]
    return [axis_order(role, reverse=reverse) for role, reverse in zip(roles, matlab, strict=True)]
