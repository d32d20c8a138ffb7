"""The command ``convert``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, cast

import numpy as np
from tyro.conf import FlagCreatePairsOff, OmitArgPrefixes, Positional, arg

from occjax.cli.options import CameraOptions, ViewOrderOptions, choice, option
from occjax.errors import InputError, warn
from occjax.io import Map, read_map, write_map, write_normals
from occjax.io.files import read_errors
from occjax.io.hci_config import PARAMETERS, read_hci_config
from occjax.io.maps import MAP_SUFFIXES, SUMMARY, UNITS, Quantity, view_of_map
from occjax.lightfield import Calibration, view_name
from occjax.results.conversion import convert_map, normals, point_cloud, write_points
from occjax.results.summary import read_summary, stored_calibration

Target = Literal["disparity", "depth", "normals", "points"]

SUFFIXES: dict[Target, tuple[str, ...]] = {
    "disparity": MAP_SUFFIXES,
    "depth": MAP_SUFFIXES,
    "normals": MAP_SUFFIXES,
    "points": (".ply",),
}
"""Suffixes of the files that each target can be written to."""

NAMES: dict[str, Target] = {"depth": "depth", "disp": "disparity", "normal": "normals"}
"""Targets that file names suggest."""


def convert_command(
    source: Annotated[
        Path,
        Positional,
        arg(
            metavar="MAP",
            help="Map of disparity or depth: .pfm, .npy or .png, or a folder of results.",
        ),
    ],
    target: Annotated[
        Path, Positional, arg(metavar="FILE", help="File to write; its suffix gives the format.")
    ],
    to: Annotated[
        Target | None,
        choice(Target),
        option(
            "Quantity to write: disparity, depth, normals or points. By default points for a .ply, "
            "else the quantity of MAP.",
            "WHAT",
        ),
    ] = None,
    from_: Annotated[
        Quantity | None,
        choice(Quantity),
        arg(
            name="from",
            metavar="WHAT",
            help="Quantity of MAP, if the file does not state it: disparity or depth. By default "
            "depth if the file name contains it, else disparity.",
            help_behavior_hint="",
        ),
    ] = None,
    parameters: Annotated[
        Path | None,
        option(
            "Camera, as a parameters.cfg of the HCI format. By default the one in SCENE, or in the "
            "folder of MAP, or the one that summary.json in the folder of MAP names.",
            "FILE",
        ),
    ] = None,
    scene: Annotated[
        Path | None,
        option("Light field whose camera, and centre view for the colours, are used.", "SCENE"),
    ] = None,
    picture: Annotated[
        bool,
        FlagCreatePairsOff,
        option("Write a .png in colours for viewing; values cannot be recovered from it."),
    ] = False,
    overwrite: Annotated[bool, FlagCreatePairsOff, option("Replace FILE if it exists.")] = False,
    scale: Annotated[
        float | None,
        option("Scale of a .png of another program: value = scale * code + offset.", "S"),
    ] = None,
    offset: Annotated[
        float | None, option("Offset of a .png of another program; 0 by default.", "O")
    ] = None,
    camera: OmitArgPrefixes[CameraOptions] = CameraOptions(),
    view_order: OmitArgPrefixes[ViewOrderOptions] = ViewOrderOptions(),
) -> int:
    """Convert a map of disparity or depth to another format, to depth, normals or a point cloud.

    The suffix of FILE gives the format:
    $ occjax convert disparity.pfm disparity.npy
    $ occjax convert disparity.pfm disparity.png (16 bits, which store their scale)
    $ occjax convert disparity.png again.pfm
    $ occjax convert disparity.pfm picture.png --picture

    Depth, points and normals need the camera: of an HCI scene (SCENE/parameters.cfg), of the folder
    of results that MAP lies in, or of the options below:
    $ occjax convert disparity.pfm depth.pfm --to depth --scene SCENE
    $ occjax convert depth.npy disparity.npy --to disparity --scene SCENE
    $ occjax convert disparity.pfm cloud.ply --scene SCENE
    $ occjax convert disparity.pfm normals.png --to normals --scene SCENE
    $ occjax convert results/SCENE depth.pfm --to depth
    $ occjax convert disparity.pfm depth.pfm --to depth --focal-length-mm 25 --sensor-mm 22.3
    --baseline-mm 40 --focus-m inf

    Depth is in metres, disparity in pixels per view step. In space x is to the right, y up and z to
    the viewer. Points of a folder of results are those of its estimate: coloured by centre.png, and
    without pixels without signal.
    """
    _check_target(source, target, to, picture=picture, overwrite=overwrite)
    content = read_map(source, quantity=from_, scale=scale, offset=offset)
    quantity: Target = to or ("points" if target.suffix.lower() == ".ply" else content.quantity)
    _check_quantity(target, to, quantity, picture=picture)
    print(f"{source}: {_describe(content)}")
    calibration = _read_camera(source, content, quantity, scene, parameters, camera)
    if quantity == "points":
        from occjax.results.reading import stored_cloud  # imports JAX

        centre, mask = stored_cloud(source) if source.is_dir() else (None, None)
        if scene is not None:
            view = view_of_map(source)
            if view not in (None, view_name(None)):
                raise InputError(
                    f"{source}: is of the {view}, but the colours of --scene are those of the "
                    "centre view; leave out --scene"
                )
            centre = view_order.load(scene, check_orientation=False).centre
        written = _write_points(target, content, calibration, centre, mask)
    elif quantity == "normals":
        vectors = normals(content, cast(Calibration, calibration))
        write_normals(target, vectors)
        missing = int(np.isnan(vectors[..., 0]).sum())
        written = f"{_size(vectors)} unit normals; x right, y up, z to the viewer"
        written += f"; {missing} pixels have none" * bool(missing)
    else:
        converted = content if calibration is None else convert_map(content, quantity, calibration)
        written = _write_map(target, converted, picture=picture)
    print(f"{target}: {written}")
    return 0


def _check_target(
    source: Path, target: Path, to: Target | None, *, picture: bool, overwrite: bool
) -> None:
    """Raise an error for a target that cannot be written, whatever the source contains."""
    suffix = target.suffix.lower()
    known = sorted({suffix for suffixes in SUFFIXES.values() for suffix in suffixes})
    if suffix not in known:
        raise InputError(f"{target}: unknown format; use one of the suffixes {', '.join(known)}")
    if to is not None and suffix not in SUFFIXES[to]:
        raise InputError(
            f"{target}: {to} cannot be written as {suffix}; use the suffix "
            f"{' or '.join(SUFFIXES[to])}"
            + (", or leave out --to for points" if suffix == ".ply" else "")
        )
    if picture and suffix != ".png":
        raise InputError(f"{target}: a picture is a .png; change the suffix or leave out --picture")
    with read_errors(target):
        exists, is_folder = target.exists(), target.is_dir()
        is_source = exists and source.exists() and target.samefile(source)
    if is_folder:
        raise InputError(f"{target}: is a folder; name the file to write in it")
    if is_source:
        raise InputError(f"{target}: is the map itself; choose another name for the result")
    if exists and not overwrite:
        raise InputError(f"{target}: already exists; choose another name or pass --overwrite")


def _check_quantity(target: Path, to: Target | None, quantity: Target, *, picture: bool) -> None:
    """Raise an error for a target whose name contradicts its content."""
    if picture and quantity == "normals":
        raise InputError(f"{target}: normals are always in colours; leave out --picture")
    named = [suggested for word, suggested in NAMES.items() if word in target.stem.lower()]
    if to is None and quantity != "points" and named and quantity not in named:
        raise InputError(
            f"{target}: its name says {named[0]}, but {quantity} would be written to it; pass "
            f"--to {named[0]}, or choose another name"
        )


def _read_camera(
    source: Path,
    content: Map,
    quantity: Target,
    scene: Path | None,
    parameters: Path | None,
    options: CameraOptions,
) -> Calibration | None:
    """Return the camera of the options, the given file, the scene, or the folder of the map."""
    if quantity == content.quantity:
        if (parameters, scene, options) == (None, None, CameraOptions()):
            return None
        raise InputError(
            f"{source}: already holds {quantity}, for which no camera is needed; pass --to, or "
            "leave out --parameters, --scene and the options of the camera"
        )
    folder = source if source.is_dir() else source.parent
    nearby = [path / PARAMETERS for path in (scene, folder) if path is not None]
    path = parameters or next((path for path in nearby if path.is_file()), None)
    stored = None
    if path is not None:
        stored = _read_parameters(path, content)
    elif (folder / SUMMARY).is_file():
        stored = stored_calibration(read_summary(folder / SUMMARY))
        if stored is not None:
            print(f"camera: {folder / SUMMARY}")
    calibration = options.calibration(stored)
    if calibration is None and (content.quantity, quantity) != ("disparity", "points"):
        missing = "none is next to the map" if scene is None else f"{scene} has none"
        raise InputError(
            f"{source}: converting {content.quantity} to {quantity} needs the camera; pass "
            f"--parameters FILE, or --scene SCENE that has a parameters.cfg ({missing}), or "
            "--focal-length-mm, --sensor-mm, --baseline-mm and --focus-m"
        )
    return calibration  # None for points, which are then in pixels


def _read_parameters(path: Path, content: Map) -> Calibration:
    """Read the camera from a ``parameters.cfg``; warn if it is for views of another size."""
    path = path / PARAMETERS if path.is_dir() else path
    config = read_hci_config(path)
    print(f"camera: {path}")
    size = content.values.shape
    if config.image_size not in (None, size):
        expected, found = ("x".join(map(str, shape)) for shape in (config.image_size, size))
        warn(
            f"{path}: is for views of {expected} pixels (rows x columns), but the map has {found}; "
            "the map is treated as a resized view, not as a crop"
        )
    return config.calibration


def _write_map(target: Path, content: Map, *, picture: bool) -> str:
    """Write the map or its picture; returns a description of what was written."""
    if picture:
        from occjax.viz import depth_figure, disparity_figure, save

        figure = depth_figure if content.quantity == "depth" else disparity_figure
        save(figure(content.values), target)
        return f"picture of {_describe(content)}"
    precision = write_map(target, content)
    rounded = f"; values are kept to within {precision:.2g}" if precision else ""
    return _describe(content) + rounded


def _write_points(
    target: Path,
    content: Map,
    camera: Calibration | None,
    centre: np.ndarray | None,
    mask: np.ndarray | None,
) -> str:
    """Write the points; returns a description of what was written."""
    cloud = point_cloud(content, camera)
    count = write_points(target, cloud, centre=centre, mask=mask)
    colours = "" if centre is None else " in the colours of the centre view"
    lines = [f"{count} points{colours}; {cloud.unit}"]
    if missing := content.values.size - count:
        unsure = " or left out by the estimate" if mask is not None else ""
        lines.append(f"note: {missing} pixels without a point in space{unsure} are left out")
    if camera is None:
        lines.append(
            "note: without a camera (--parameters, --scene or --focal-length-mm) the points are in "
            "pixels, and their depth has no true scale"
        )
    return "\n  ".join(lines)


def _describe(content: Map) -> str:
    """Describe size, quantity and range of a map, and its pixels without a finite value."""
    values = content.values
    finite = values[np.isfinite(values)]
    parts = [f"{_size(values)} {content.quantity}"]
    if finite.size:
        parts.append(f"{finite.min():.4g} to {finite.max():.4g} {UNITS[content.quantity]}")
    if infinite := int(np.isinf(values).sum()):
        parts.append(f"{infinite} pixels infinite")
    if missing := int(np.isnan(values).sum()):
        parts.append(f"{missing} pixels without value")
    return ", ".join(parts)


def _size(values: np.ndarray) -> str:
    return f"{values.shape[0]}x{values.shape[1]} pixels (rows x columns) of"
