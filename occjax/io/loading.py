"""Reading a light field of any supported format."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import cast, get_args

import numpy as np

from occjax.errors import InputError, check_one_of, check_whole_pair, warn
from occjax.io.arrays import read_arrays
from occjax.io.consistency import ground_truth_mismatch
from occjax.io.containers import CONTAINER_SUFFIXES, read_container
from occjax.io.files import read_errors
from occjax.io.folders import Progress, read_folder
from occjax.io.frames import refuse_video_frames
from occjax.io.hdr import tone_mapped
from occjax.io.images import (
    IMAGE_SUFFIXES,
    PLENOPTIC_REMEDY,
    PLENOPTIC_SUFFIXES,
    UNSUPPORTED_SUFFIXES,
)
from occjax.io.layouts import FolderLayout, Layout, Mosaic
from occjax.io.mosaics import read_mosaic
from occjax.io.positions import warn_of_unit
from occjax.io.view_files import ViewFiles
from occjax.layout import (
    Orientation,
    ViewOrderConfig,
    ViewOrderReport,
    check,
    declaration,
    declared_orientation,
    straightened,
)
from occjax.lightfield import MIN_VIEW_SIZE_PX, LightField, view_offsets


class ViewOrderWarning(UserWarning):
    """The views or the ground truth have another order than declared, or none is consistent."""


def load(
    path: str | Path,
    *,
    layout: Layout | str | None = None,
    pattern: str | None = None,
    grid: tuple[int, int] | None = None,
    order: str = "vu",
    flip: str = "",
    spacing: tuple[float, float] | None = None,
    key: str | None = None,
    name: str | None = None,
    views: tuple[int, int] | None = None,
    max_disparity: float | None = None,
    check_orientation: bool = True,
    progress: Progress | None = None,
) -> LightField:
    """Read a light field from a folder of views, an image of all views, or an array file.

    Args:
        path: Folder with one image per view (HCI, Lytro, UrbanLF, Stanford, or any other through
            ``pattern``); one image of all views (tiled or MacPI, which need ``grid``, or a quilt);
            ``.npz`` or ``.npy``; HDF5 or ``.mat`` (:func:`occjax.io.containers.read_container`).
        layout: Layout of the files (:data:`Layout`); None to detect it.
        pattern: File names of the views, with ``{v}`` and ``{u}`` for row and column or ``{i}`` for
            the number, row by row.
        grid: ``(V, U)``, rows and columns of views as stored; None to detect it. An array that has
            one axis of views in place of two needs it. With layout
            ``"quilt"``, rows and columns of tiles.
        order: ``"vu"`` if the files count rows first, ``"uv"`` if columns, ``"serpentine"`` if they
            count rows first and every second row backwards.
        flip: Axes of the grid that run backwards: ``"v"`` if rows run from bottom to top, ``"u"``
            if columns run from right to left, ``"vu"`` if both.
        spacing: Distance of neighbouring view rows and of neighbouring view columns, in any unit,
            if they differ; disparity is then in pixels per row step. None to measure their ratio.
        key: Name of the views in an ``.npz``, HDF5 or ``.mat`` file.
        name: Name of the scene; by default the name of the file or folder.
        views: ``(V, U)``, rows and columns of views around the centre view to keep; None for all.
        max_disparity: Largest disparity to search when the range is measured, in pixels per view
            step; None to find it, up to 0.4 of the shorter side of the views.
        check_orientation: Whether to measure the view order from the images, to warn if it differs
            from the declared one, and to store the measurement in ``view_order_report``.
        progress: Called with the number of views read and the number of all views.

    Returns:
        The light field ``[V, U, H, W, C]``, in the convention of :mod:`occjax.lightfield`.

    Raises:
        InputError: If it cannot be read; the message names the file and what to do.

    Warns:
        ViewOrderWarning: If another view order is clearly better, none is consistent, or the ground
            truth is upside down, mirrored or has the opposite sign.
        GridWarning: If the grid, the pattern of the names or the order of axes is guessed, if the
            images also fit another arrangement, if views are missing, or if the positions in an
            ``.npz`` seem not to be in view steps.
        UserWarning: If views of high dynamic range are tone-mapped.

    Example:
        >>> import tempfile, numpy as np
        >>> path = Path(tempfile.mkdtemp()) / "scene.npy"
        >>> np.save(path, np.zeros((5, 5, 16, 16, 3), np.uint8))
        >>> load(path).grid
        (5, 5)
    """
    path = Path(path)
    check_options(layout, grid, order, flip, spacing, views, max_disparity)
    declared = declared_orientation(order, flip)
    with read_errors(path):
        path.stat()
    stored, files = _read(path, cast(Layout | None, layout), pattern, grid, key, progress)
    mosaic = files is None and path.suffix.lower() in IMAGE_SUFFIXES
    # A mosaic was split by this grid, and a quilt of these tiles becomes one row of views.
    if grid is not None and not mosaic and layout != "quilt" and stored.grid != tuple(grid):
        raise InputError(
            f"{path}: has {stored.grid[0]}x{stored.grid[1]} views, not {grid[0]}x{grid[1]}; "
            "leave out grid"
        )
    if min(stored.image_size) < MIN_VIEW_SIZE_PX:
        height, width = stored.image_size
        raise InputError(
            f"{path}: views are {height}x{width} pixels; give views of at least "
            f"{MIN_VIEW_SIZE_PX}x{MIN_VIEW_SIZE_PX}, arrays as [V, U, H, W] or [V, U, H, W, C]"
        )
    if order == "serpentine":
        stored = stored.rearranged(straightened)
    light_field = declared.apply(stored) if declared != Orientation() else stored
    if files is not None:
        usable = files.usable(
            lambda grid: declared.lay_out(straightened(grid) if order == "serpentine" else grid)
        )
        light_field = dataclasses.replace(light_field, usable=usable)
    if spacing is not None:
        if light_field.positions is not None:
            raise InputError(
                f"{path}: has camera positions; leave out spacing, or remove the positions"
            )
        rows, columns = spacing
        offsets = view_offsets(*light_field.grid, column_spacing=columns / rows)
        light_field = dataclasses.replace(light_field, positions=offsets)
    if views is not None:
        if any(np.greater(views, light_field.grid)):
            raise InputError(
                f"{path}: views {views[0]} {views[1]} is to keep {views[0]} rows and {views[1]} "
                f"columns of views around the centre view, but the grid has {light_field.grid[0]} "
                f"rows and {light_field.grid[1]} columns; pass smaller numbers or leave out views "
                "(--views)"
            )
        light_field = light_field.central(*views)
    if name is not None:
        light_field = dataclasses.replace(light_field, name=name)
    if check_orientation and light_field.grid != (1, 1):
        report = check(light_field, ViewOrderConfig(max_disparity_px=max_disparity))
        from_names = grid is None and order != "serpentine" and stored.calibration is None
        if files is not None and from_names and stored.positions is None:
            names_declared = layout is not None or pattern is not None
            refuse_video_frames(stored, files, declared, report, declared=names_declared)
        _warn_of_view_order(path, light_field, declared, report)
        light_field = dataclasses.replace(light_field, view_order_report=report)
        truth = light_field.ground_truth
        has_truth = truth is not None and bool(np.isfinite(truth).any())
        if has_truth and not report.clearly_worse and (fault := ground_truth_mismatch(light_field)):
            warn(
                f"{path}: the ground truth agrees with the views if {fault}; correct its file",
                ViewOrderWarning,
            )
    return light_field


def check_options(
    layout: str | None,
    grid: tuple[int, int] | None,
    order: str,
    flip: str,
    spacing: tuple[float, float] | None,
    views: tuple[int, int] | None,
    max_disparity: float | None,
) -> None:
    """Check options of :func:`load` before anything is read.

    Raises:
        InputError: If an option has an impossible value.
    """
    declared_orientation(order, flip)
    if layout is not None:
        check_one_of("layout", layout, Layout)
    if grid is not None:
        check_whole_pair("grid", grid)
    if views is not None:
        check_whole_pair("views", views)
    if spacing is not None and not all(0 < distance < math.inf for distance in spacing):
        rows, columns = spacing
        raise InputError(f"spacing is {rows:g} {columns:g}; it must be two positive numbers")
    if max_disparity is not None and not 0 < max_disparity < math.inf:
        raise InputError(f"max_disparity is {max_disparity}; it must be a positive number")


def _read(
    path: Path,
    layout: Layout | None,
    pattern: str | None,
    grid: tuple[int, int] | None,
    key: str | None,
    progress: Progress | None,
) -> tuple[LightField, ViewFiles | None]:
    """Read the light field as stored, and the files of its views if it is a folder."""
    if path.is_dir():
        if layout in get_args(Mosaic) or layout in ("array", "hdf5"):
            raise InputError(f"{path}: is a folder, but layout {layout!r} is a file; name the file")
        in_folder = cast(FolderLayout | None, layout)
        return read_folder(path, layout=in_folder, pattern=pattern, grid=grid, progress=progress)
    if pattern is not None or layout in get_args(FolderLayout):
        option = f"layout {layout!r}" if pattern is None else f"pattern {pattern!r}"
        raise InputError(f"{path}: is a file, but {option} is for a folder; name its folder")
    suffix = path.suffix.lower()
    if layout == "array" or (layout is None and suffix in (".npz", ".npy")):
        light_field = read_arrays(path, key=key, grid=grid)
        if light_field.positions is not None:
            warn_of_unit(path, light_field.positions)
        return light_field, None
    if layout == "hdf5" or (layout is None and suffix in CONTAINER_SUFFIXES):
        return read_container(path, key=key, grid=grid), None
    if layout in get_args(Mosaic) or (layout is None and suffix in IMAGE_SUFFIXES):
        views = tone_mapped(path, read_mosaic(path, grid, cast(Mosaic | None, layout)))
        return LightField(views=views, name=path.stem, source=path), None
    if suffix in PLENOPTIC_SUFFIXES:
        raise InputError(f"{path}: {PLENOPTIC_REMEDY}")
    if suffix in UNSUPPORTED_SUFFIXES:
        raise InputError(f"{path}: {suffix} images are not read; convert it to PNG")
    raise InputError(
        f"{path}: unknown kind of file; give a folder of views, an image ("
        f"{', '.join(IMAGE_SUFFIXES)}), .npz, .npy, .h5, .hdf5 or .mat"
    )


def _warn_of_view_order(
    path: Path, light_field: LightField, declared: Orientation, report: ViewOrderReport
) -> None:
    """Warn if the view order differs from the declared one, or none is consistent."""
    if not report.plausible:
        rows, columns = light_field.grid
        warn(
            f"{path}: no view order of the {rows}x{columns} grid is consistent; "
            "check the grid and the file layout; if neighbouring views differ by more than 0.4 of "
            "their shorter side, pass max_disparity (--max-disparity)",
            ViewOrderWarning,
        )
    if report.disorder is not None:
        warn(f"{path}: {report.position_notes[0]}", ViewOrderWarning)
    if report.clearly_worse:
        likely = [declared.then(report.best)]
        if not report.sign_known:
            likely.append(declared.then(report.best.reversed_sign))
            likely.sort(key=lambda orientation: len(orientation.flip))
        warn(
            f"{path}: the images show another order of the views than declared "
            f"({report.best.name}); {' or '.join(map(declaration, likely))}",
            ViewOrderWarning,
        )
