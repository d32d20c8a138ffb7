"""The command ``convert``."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Annotated, Literal, cast

import numpy as np
from tyro.conf import FlagCreatePairsOff, OmitArgPrefixes, Positional, arg

from occjax.cli.options import Stored, option
from occjax.errors import InputError
from occjax.inference.conversion import convert_map, normals, point_cloud, write_points
from occjax.io import Map, read_map, write_map, write_normals
from occjax.io.files import reading
from occjax.io.hci_config import read_hci_config
from occjax.io.maps import UNITS, Quantity
from occjax.lightfield import Calibration
from occjax.viz.canvas import save
from occjax.viz.figures import depth_figure, disparity_figure

Goal = Literal["disparity", "depth", "normals", "points"]

SUFFIXES: dict[Goal, tuple[str, ...]] = {
    "disparity": (".pfm", ".npy", ".png"),
    "depth": (".pfm", ".npy", ".png"),
    "normals": (".npy", ".png", ".pfm"),
    "points": (".ply",),
}
"""Endings of the files that each of them is written to."""

NAMES: dict[str, Goal] = {"depth": "depth", "disp": "disparity", "normal": "normals"}
"""What a file of such a name is expected to hold."""

RELIEF = ("points", "disparity")
"""What can be made, and of what, without a camera."""


def convert_command(
    source: Positional[
        Annotated[
            Path,
            arg(
                metavar="MAP",
                help="Disparity or depth: .pfm, .npy or .png, or a folder of results.",
            ),
        ]
    ],
    target: Positional[
        Annotated[Path, arg(metavar="FILE", help="What to write; its ending says the format.")]
    ],
    to: Annotated[
        Goal | None,
        option(
            "disparity, depth, normals or points. By default points for a .ply, else what the map "
            "holds, in another format.",
            "WHAT",
        ),
    ] = None,
    from_: Annotated[
        Quantity | None,
        arg(
            name="from",
            metavar="WHAT",
            help="disparity or depth: what the map holds, if it does not say so itself. By default "
            "depth if it is named so, else disparity.",
            help_behavior_hint="",
        ),
    ] = None,
    parameters: Annotated[
        Path | None,
        option(
            "The camera, as parameters.cfg of the HCI format. By default the one in the scene, or "
            "beside the map.",
            "FILE",
        ),
    ] = None,
    scene: Annotated[
        Path | None,
        option("The light field: its camera, and its centre view for the colours.", "SCENE"),
    ] = None,
    picture: FlagCreatePairsOff[
        Annotated[
            bool,
            arg(
                help="Write a .png in colours to look at; values cannot be got back from it.",
                help_behavior_hint="",
            ),
        ]
    ] = False,
    overwrite: FlagCreatePairsOff[
        Annotated[
            bool,
            arg(help="Replace FILE if it is there.", help_behavior_hint=""),
        ]
    ] = False,
    scale: Annotated[
        float | None,
        option("For a .png of another program: value = scale * code + offset.", "S"),
    ] = None,
    offset: Annotated[float | None, option("Likewise; 0 by default.", "O")] = None,
    stored: OmitArgPrefixes[Stored] = Stored(),
) -> int:
    """Convert a map of disparity or depth: other formats, depth, normals, a point cloud.

    The format is that of FILE's ending:
    $ occjax convert disparity.pfm disparity.npy
    $ occjax convert disparity.pfm disparity.png (16 bits, which know their scale)
    $ occjax convert disparity.png again.pfm
    $ occjax convert disparity.pfm look.png --picture

    With the camera of an HCI scene, SCENE/parameters.cfg, also what the map says about space:
    $ occjax convert disparity.pfm depth.pfm --to depth --scene SCENE
    $ occjax convert depth.npy disparity.npy --to disparity --scene SCENE
    $ occjax convert disparity.pfm cloud.ply --scene SCENE
    $ occjax convert disparity.pfm normals.png --to normals --scene SCENE

    Depth is in metres, disparity in pixels per view step. In space x is to the right, y up and z to
    the viewer.
    """
    _check_target(source, target, to, picture=picture, overwrite=overwrite)
    content = read_map(source, quantity=from_, scale=scale, offset=offset)
    goal: Goal = to or ("points" if target.suffix.lower() == ".ply" else content.quantity)
    _check_goal(target, to, goal, picture=picture)
    print(f"{source}: {_description(content)}")
    camera = _camera(source, content, goal, scene, parameters)
    if goal == "points":
        centre = None if scene is None else stored.load(scene, check_orientation=False).centre
        print(f"{target}: {_write_points(target, content, camera, centre)}")
    elif goal == "normals":
        found = normals(content, cast(Calibration, camera))
        write_normals(target, found)
        print(f"{target}: {_normals_description(found)}")
    else:
        made = content if camera is None else convert_map(content, goal, camera)
        print(f"{target}: {_write_map(target, made, picture=picture)}")
    return 0


def _check_target(
    source: Path, target: Path, to: Goal | None, *, picture: bool, overwrite: bool
) -> None:
    """What is wrong with the target already before anything is read."""
    suffix = target.suffix.lower()
    every = sorted({ending for endings in SUFFIXES.values() for ending in endings})
    if suffix not in every:
        raise InputError(f"{target}: its ending says the format; let it be {', '.join(every)}")
    if to is not None and suffix not in SUFFIXES[to]:
        raise InputError(
            f"{target}: {to} cannot be written as {suffix}; end the name in "
            f"{' or '.join(SUFFIXES[to])}"
            + (", or leave out --to for points" if suffix == ".ply" else "")
        )
    if picture and suffix != ".png":
        raise InputError(f"{target}: a picture is a .png; end the name so or leave out --picture")
    with reading(target):
        present, folder = target.exists(), target.is_dir()
        itself = present and source.exists() and target.samefile(source)
    if folder:
        raise InputError(f"{target}: is a folder; name the file to write in it")
    if itself:
        raise InputError(f"{target}: is the map itself; choose another name for what is made of it")
    if present and not overwrite:
        raise InputError(f"{target}: is there already; choose another name or pass --overwrite")


def _check_goal(target: Path, to: Goal | None, goal: Goal, *, picture: bool) -> None:
    """What would surprise whoever reads the target."""
    if picture and goal == "normals":
        raise InputError(f"{target}: normals are a picture as they are; leave out --picture")
    named = [holds for word, holds in NAMES.items() if word in target.stem.lower()]
    if to is None and goal != "points" and named and goal not in named:
        raise InputError(
            f"{target}: its name says {named[0]}, but {goal} would be written to it; pass "
            f"--to {named[0]}, or choose another name"
        )


def _camera(
    source: Path, content: Map, goal: Goal, scene: Path | None, parameters: Path | None
) -> Calibration | None:
    """The camera, where one is needed: as named, of the scene, or beside the map, in that order."""
    if goal == content.quantity:
        if parameters is None and scene is None:
            return None
        raise InputError(
            f"{source}: holds {goal}, and to write the same no camera is needed; pass what to make "
            "of it (--to), or leave out --parameters and --scene"
        )
    beside = source if source.is_dir() else source.parent
    places = [folder / "parameters.cfg" for folder in (scene, beside) if folder is not None]
    path = parameters or next((place for place in places if place.is_file()), None)
    if path is None:
        if (goal, content.quantity) == RELIEF:
            return None
        without = "none is beside the map" if scene is None else f"{scene} has none"
        raise InputError(
            f"{source}: {goal} cannot be made of {content.quantity} without the camera; pass "
            f"--parameters FILE, or --scene SCENE that has a parameters.cfg ({without})"
        )
    path = path / "parameters.cfg" if path.is_dir() else path
    config = read_hci_config(path)
    print(f"camera: {path}")
    if config.image_size is not None and config.image_size != content.values.shape:
        expected, found = (
            "x".join(map(str, size)) for size in (config.image_size, content.values.shape)
        )
        warnings.warn(
            f"{path}: is for views of {expected} pixels (rows x columns), but the map has {found}; "
            "it is taken for the whole view at another resolution, not a part of it",
            stacklevel=2,
        )
    return config.calibration


def _write_map(target: Path, content: Map, *, picture: bool) -> str:
    """Write the map or its picture; returns what was written, in words."""
    if picture:
        figure = depth_figure if content.quantity == "depth" else disparity_figure
        save(figure(content.values), target)
        return f"picture of {_description(content)}"
    precision = write_map(target, content)
    rounded = f"; values are kept to within {precision:.2g}" if precision else ""
    return _description(content) + rounded


def _write_points(
    target: Path, content: Map, camera: Calibration | None, centre: np.ndarray | None
) -> str:
    """Write the points; returns what was written, in words."""
    cloud = point_cloud(content, camera)
    count = write_points(target, cloud, centre=centre)
    colours = "" if centre is None else " in the colours of the centre view"
    left_out = content.values.size - count
    relief = (
        "\n  note: without a camera (--parameters or --scene) they are a relief in pixels, whose "
        "depth has no true scale"
    )
    return (
        f"{count} points{colours}; {cloud.unit}"
        + f"\n  note: {left_out} pixels without a place in space are left out" * bool(left_out)
        + relief * (camera is None)
    )


def _normals_description(found: np.ndarray) -> str:
    missing = int(np.isnan(found[..., 0]).sum())
    return (
        f"{_size(found)} unit normals; x right, y up, z to the viewer"
        + f"; {missing} pixels have none" * bool(missing)
    )


def _description(content: Map) -> str:
    """Size, quantity and range in words, and what has no number."""
    values = content.values
    finite = values[np.isfinite(values)]
    parts = [f"{_size(values)} {content.quantity}"]
    if finite.size:
        parts.append(f"{finite.min():.4g} to {finite.max():.4g} {UNITS[content.quantity]}")
    infinite, missing = int(np.isinf(values).sum()), int(np.isnan(values).sum())
    if infinite:
        parts.append(f"{infinite} pixels infinite")
    if missing:
        parts.append(f"{missing} pixels without value")
    return ", ".join(parts)


def _size(values: np.ndarray) -> str:
    return f"{values.shape[0]}x{values.shape[1]} pixels (rows x columns) of"
