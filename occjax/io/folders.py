"""A folder with one image per view."""

from __future__ import annotations

import dataclasses
import math
import os
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from occjax.errors import InputError, warn
from occjax.io.arrays import check_ground_truth, check_views, read_npy
from occjax.io.config import ReadingConfig
from occjax.io.files import read_errors
from occjax.io.hci_config import GROUND_TRUTH, PARAMETERS, HciConfig, read_hci_config
from occjax.io.hdr import tone_mapped
from occjax.io.images import IMAGE_SUFFIXES, read_image
from occjax.io.layouts import FolderLayout
from occjax.io.limits import ReadLimits
from occjax.io.naming import GridWarning, NamedViews, find_views, first_few
from occjax.io.naming.fitting_patterns import fitting_patterns
from occjax.io.naming.patterns import is_in_subfolders
from occjax.io.pfm import read_pfm
from occjax.io.positions import gantry_grid, read_positions
from occjax.io.view_files import ViewFiles
from occjax.layout.hypotheses import best_hypothesis, row_major_offsets
from occjax.lightfield import LightField, centre_index

Progress = Callable[[int, int], None]
"""Called with the number of views read and the number of all views."""


def read_folder(
    folder: str | Path,
    *,
    layout: FolderLayout | None = None,
    pattern: str | None = None,
    grid: tuple[int, int] | None = None,
    progress: Progress | None = None,
) -> tuple[LightField, ViewFiles]:
    """Read a folder with one image per view.

    In addition to the views it reads the files that belong to the layout: ``parameters.cfg`` and
    ``gt_disp_lowres.pfm`` (HCI), ``R_C_disparity.npy`` of the centre view (UrbanLF), the camera
    positions in the file names (Stanford) or in ``positions.npy`` or ``positions.csv`` (others).

    Args:
        folder: The folder.
        layout: ``"hci"``, ``"lytro"``, ``"urbanlf"`` or ``"stanford"``; None to detect it.
        pattern: File names of any other layout, with ``{v}`` and ``{u}`` for the view's row and
            column or ``{i}`` for its number, row by row; may name files in subfolders.
        grid: ``(V, U)``; None to detect it.
        progress: Called after each view.

    Returns:
        The light field as stored, named after the folder, with ``usable`` None even if views are
        missing; and the files of the views, whose :meth:`ViewFiles.usable` gives the mask.

    Raises:
        InputError: If the views form no grid, many cannot be read or have different sizes, or
            another file of the layout is damaged.

    Warns:
        GridWarning: If the grid is guessed from the number of views or from the photo-consistency,
            or if views are missing, cannot be decoded, or have another size than the others.
    """
    folder = Path(folder)
    config = _read_config(folder) if layout in (None, "hci") and pattern is None else None
    layout, named = find_views(
        str(folder),
        _file_names(folder, nested=is_in_subfolders(pattern)),
        layout=layout,
        pattern=pattern,
        grid=grid or (config.grid if config else None),
    )
    positions: np.ndarray | None
    if layout == "stanford":
        named, positions = gantry_grid(str(folder), named)
    else:
        named, positions = read_positions(folder, named)
    views, present = _read_views(folder, named, progress)
    if (other := named.other_grid) and positions is None:
        # The names fit two grids, such as 1x16 and 4x4, with the views in the same order.
        line = views.reshape(-1, *views.shape[2:])
        best = best_hypothesis(line, [row_major_offsets(named.grid), row_major_offsets(other)])
        if best.number == 1 and best.clear:
            named = dataclasses.replace(named.regrouped(other), guessed=True)
            views = line.reshape(*named.grid, *line.shape[1:])
            present = present.reshape(named.grid)
        elif best.number == 1 or best.alike:
            note = f"{named.guess_note}, though {other[0]}x{other[1]} fits about as well"
            named = dataclasses.replace(named, guessed=True, guess_note=note)
    if named.guessed:
        warn(
            f"{folder}: {math.prod(named.grid)} views taken as {named.grid[0]}x{named.grid[1]}"
            f"{named.guess_note}; pass grid (--grid V U) if that is wrong",
            GridWarning,
        )
    low, high = config.disparity_range if config and config.disparity_range else (0.0, 0.0)
    if max(-low, high) > max(views.shape[2:4]):  # neighbouring views would not overlap
        raise InputError(
            f"{folder / PARAMETERS}: disparities of {low:g} to {high:g} pixels exceed the "
            f"size of the views ({max(views.shape[2:4])}); correct disp_min and disp_max in [meta]"
        )
    light_field = LightField(
        views=views,
        name=folder.resolve().name,
        calibration=config.calibration if config else None,
        disparity_range=config.disparity_range if config else None,
        ground_truth=_read_ground_truth(folder, layout, named, views.shape[2:4]),
        positions=positions,
        source=folder,
    )
    return light_field, ViewFiles(str(folder), named, present)


def _file_names(folder: Path, *, nested: bool) -> list[str]:
    """Return the relative paths of the visible files in a folder; nested, also in subfolders."""
    with read_errors(folder):
        if nested:
            below = [path.relative_to(folder) for path in folder.rglob("*") if path.is_file()]
            visible = [path for path in below if not any(p.startswith(".") for p in path.parts)]
            return [path.as_posix() for path in visible]
        entries = [entry for entry in os.scandir(folder) if not entry.name.startswith(".")]
        files = [entry.name for entry in entries if entry.is_file()]
        folders = sorted(entry.name for entry in entries if entry.is_dir())
    for entry in entries:
        if entry.name not in files and entry.name.lower().endswith(IMAGE_SUFFIXES):
            what = "a folder" if entry.is_dir() else "a link to a missing file"
            raise InputError(f"{entry.path}: is {what}, not an image; replace or remove it")
    if folders and not any(name.lower().endswith(IMAGE_SUFFIXES) for name in files):
        patterns = subfolder_patterns(folder) or ["row{v}/c{u}.png"]
        raise InputError(
            f"{folder}: has no images; it has folders: {first_few(folders)}; name one of them, or, "
            "if they hold the views of one light field, pass pattern (--pattern "
            f"{' or '.join(map(repr, patterns[:2]))})"
        )
    return files


def subfolder_patterns(folder: Path) -> list[str]:
    """Return the patterns that fit the images in the sub-folders of a folder, taken together.

    Args:
        folder: Folder whose sub-folders may hold the views of one light field.
    """
    with read_errors(folder):
        files = (path.relative_to(folder).as_posix() for path in folder.glob("*/*"))
        names = [name for name in files if not name.startswith(".") and "/." not in name]
    return fitting_patterns([name for name in names if name.lower().endswith(IMAGE_SUFFIXES)])


def _read_config(folder: Path) -> HciConfig | None:
    """Read the camera parameters of an HCI scene, if the folder has them."""
    path = folder / PARAMETERS
    with read_errors(folder):
        present = path.is_file()
    return read_hci_config(path) if present else None


def _read_views(
    folder: Path, named: NamedViews, progress: Progress | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return views ``[V, U, H, W, C]`` and the mask ``[V, U]`` of those that could be read.

    Images are read in threads, since decoders release the GIL. Images that cannot be
    decoded, or are of another size or type than the centre view, count as missing. The pixels of
    missing views are zero.
    """
    paths = {index: folder / match.string for index, match in sorted(named.matches.items())}
    reference = _read_reference_view(paths, centre_index(named.grid))
    ReadLimits.current().check_bytes(folder, math.prod(named.grid) * reference.nbytes)
    views = np.zeros((*named.grid, *reference.shape), reference.dtype)
    present = np.zeros(named.grid, bool)
    broken: list[InputError] = []
    formats: dict[Path, str] = {}  # format of each image that differs from the reference

    def read(path: Path) -> np.ndarray | InputError:
        try:
            return read_image(path)
        except InputError as error:
            return error

    pool = ThreadPoolExecutor(min(8, os.cpu_count() or 1))
    try:
        for done, (index, image) in enumerate(
            zip(paths, pool.map(read, paths.values()), strict=True), start=1
        ):
            if isinstance(image, InputError):
                broken.append(image)
            elif image.shape != reference.shape or image.dtype != reference.dtype:
                formats[paths[index]] = _format(image)
            else:
                views[index], present[index] = image, True
            if progress is not None:
                progress(done, len(paths))
    finally:
        pool.shutdown(cancel_futures=True)
    usual = _format(reference)
    max_unusable = max(1.0, ReadingConfig().max_unusable_fraction * len(paths))
    if len(formats) > max_unusable:
        counts = Counter({usual: int(present.sum())}) + Counter(formats.values())
        listed = " and ".join(f"{count} of {kind}" for kind, count in counts.most_common())
        names = first_few([path.name for path in formats])
        raise InputError(
            f"{folder}: has views of different sizes or types, {listed}; all must be the same; "
            f"crop, convert or remove those that differ from the centre view ({names})"
        )
    if len(broken) > max_unusable:
        raise InputError(f"{broken[0]} ({len(broken)} of {len(paths)} images are damaged)")
    problems = [str(error) for error in broken]
    problems += [f"{path}: is {kind}, not {usual}" for path, kind in formats.items()]
    for problem in problems:
        warn(f"{problem}; the view is not used", GridWarning)
    return check_views(folder, tone_mapped(folder, views)), present


def _read_reference_view(paths: dict[tuple[int, int], Path], centre: tuple[int, int]) -> np.ndarray:
    """Return the centre view; if it is missing or damaged, the first view that can be decoded."""
    first: InputError | None = None
    for path in sorted(paths.values(), key=lambda path: path != paths.get(centre)):
        try:
            return read_image(path)
        except InputError as error:
            first = first or error
    assert first is not None
    raise first


def _format(image: np.ndarray) -> str:
    """Return size, colour and depth of an image in words."""
    height, width, channels = image.shape
    return f"{width}x{height} {'grey' if channels == 1 else 'RGB'} {image.dtype}"


def _read_ground_truth(
    folder: Path, layout: FolderLayout | None, named: NamedViews, size: tuple[int, ...]
) -> np.ndarray | None:
    """Read the disparity of the centre view, if the folder has it."""
    if layout == "hci":
        path = folder / GROUND_TRUTH
        return check_ground_truth(path, read_pfm(path), size) if path.is_file() else None
    if layout == "urbanlf":
        centre = named.matches.get(centre_index(named.grid))
        if centre is None:
            return None
        path = folder / f"{centre['v']}_{centre['u']}_disparity.npy"
        return check_ground_truth(path, read_npy(path), size) if path.is_file() else None
    return None
