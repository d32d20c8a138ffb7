"""The commands ``refocus`` and ``sweep``."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from tyro.conf import FlagCreatePairsOff, OmitArgPrefixes, Positional, arg

from occjax.cli.options import ViewOrderOptions, numbers, option, pair
from occjax.errors import InputError
from occjax.io.atomic import atomic_path

if TYPE_CHECKING:
    from occjax.viz.refocusing import Refocuser

SceneArgument = Annotated[
    Path, Positional, option("Folder of views, image of all views, or array file.", "SCENE")
]
Rate = Annotated[float, arg(metavar="RATE", help="Frames per second of a video.")]

PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".tif")
"""Suffixes of pictures that are written, in lower case."""


def refocus_command(
    scene: SceneArgument,
    output: Annotated[
        Path,
        arg(
            aliases=["-o"],
            metavar="FILE",
            help="Picture to write, or with --sweep a video: .mp4 (extra video), .webp or .gif.",
        ),
    ],
    disparity: Annotated[
        float | None, option("Disparity in focus, in pixels per view step.", "D")
    ] = None,
    at: Annotated[
        tuple[int, int] | None,
        pair(int),
        option("Focus on this pixel (row, column) of the centre view.", "Y X"),
    ] = None,
    sweep: Annotated[
        tuple[float, float, int] | None,
        numbers(float, float, int, meaning="two disparities and a whole number of frames"),
        option("Move the focus from disparity LOW to HIGH in N frames.", "LOW HIGH N"),
    ] = None,
    all_in_focus: Annotated[
        bool,
        FlagCreatePairsOff,
        option("Make everything sharp: the centre view with less noise, by disparity."),
    ] = False,
    aperture: Annotated[
        float | None,
        option("Diameter of the aperture, in view steps; by default all views.", "S"),
    ] = None,
    result: Annotated[
        Path | None,
        option(
            "Folder of results of this scene, for --at and --all-in-focus; by default the "
            "disparity is estimated.",
            "FOLDER",
        ),
    ] = None,
    fps: Rate = 12.0,
    view_order: OmitArgPrefixes[ViewOrderOptions] = ViewOrderOptions(),
) -> int:
    """Write an image with another focus or aperture, or a video that moves the focus.

    $ occjax refocus SCENE --disparity 0.5 -o near.png
    $ occjax refocus SCENE --at 120 200 --aperture 4 -o there.png
    $ occjax refocus SCENE --sweep -2 2 40 -o sweep.mp4
    $ occjax refocus SCENE --all-in-focus --result results/SCENE -o sharp.png
    """
    modes = {"--disparity": disparity, "--at": at, "--sweep": sweep}
    given = [name for name, value in modes.items() if value is not None]
    given += ["--all-in-focus"] * all_in_focus
    if len(given) != 1:
        raise InputError(
            f"pass one of {', '.join(modes)} and --all-in-focus, not "
            f"{' and '.join(given) or 'none of them'}"
        )
    if aperture is not None and not aperture >= 0.0:
        raise InputError(f"--aperture is {aperture:g}; it must be at least 0 view steps")
    if result is not None and not (at or all_in_focus):
        raise InputError(f"--result is only for --at and --all-in-focus, not for {given[0]}")
    # Pillow is imported here, so that a wrong argument is reported without it.
    from PIL import Image

    from occjax.io.video import check_video, write_video

    if sweep is not None:
        low, high, count = sweep
        if count < 2:
            raise InputError(f"--sweep has {count} frames; pass at least 2")
        check_video(output, fps)
        refocuser = _refocuser(scene, view_order)
        frames = (refocuser.image(d, aperture=aperture) for d in np.linspace(low, high, count))
        write_video(output, frames, frames_per_second=fps)
        print(f"{output}: {count} frames, focus from disparity {low:g} to {high:g}")
        return 0
    if output.suffix.lower() not in PICTURE_SUFFIXES:
        raise InputError(
            f"{output}: not the name of a picture; use one of the suffixes "
            f"{', '.join(PICTURE_SUFFIXES)}"
        )
    refocuser = _refocuser(scene, view_order)
    if all_in_focus:
        picture = refocuser.all_in_focus(_disparity_map(refocuser, result), aperture=aperture)
        written = "all in focus"
    else:
        if at is not None:
            disparity = _disparity_at(refocuser, at, result)
            print(f"pixel {at[0]} {at[1]}: disparity {disparity:.2f} pixels per view step")
        assert disparity is not None
        picture = refocuser.image(disparity, aperture=aperture)
        written = f"focus at disparity {disparity:.2f} pixels per view step"
    with atomic_path(output) as temporary:
        Image.fromarray(picture).save(temporary)
    print(f"{output}: {written}")
    return 0


def sweep_command(
    scene: SceneArgument,
    output: Annotated[
        Path,
        arg(
            aliases=["-o"],
            metavar="FILE",
            help="Video to write: .mp4 (extra video), .webp or .gif.",
        ),
    ],
    path: Annotated[
        Literal["circle", "row", "column"],
        arg(
            help="Path of the camera: a circle around the centre view, or its row or column of "
            "views, there and back."
        ),
    ] = "circle",
    fps: Rate = 12.0,
    view_order: OmitArgPrefixes[ViewOrderOptions] = ViewOrderOptions(),
) -> int:
    """Write a video that moves through the views, so that parallax shows what is near and far.

    $ occjax sweep SCENE -o parallax.webp
    """
    from occjax.io.video import check_video, write_video

    check_video(output, fps)
    refocuser = _refocuser(scene, view_order)
    count = write_video(output, refocuser.sweep(path), frames_per_second=fps)
    print(f"{output}: {count} views")
    return 0


def _refocuser(scene: Path, view_order: ViewOrderOptions) -> Refocuser:
    """Read a light field and prepare it."""
    from occjax.viz.refocusing import Refocuser

    return Refocuser(view_order.load(scene))


def _disparity_map(refocuser: Refocuser, result: Path | None) -> np.ndarray:
    """Return the disparity map of a folder of results, or estimate it."""
    from occjax.estimators import Estimate, estimate

    if result is not None:
        return Estimate.load(result, light_field=refocuser.light_field).disparity
    return estimate(refocuser.light_field).disparity


def _disparity_at(refocuser: Refocuser, at: tuple[int, int], result: Path | None) -> float:
    """Return the disparity at a pixel, of a folder of results or estimated around the pixel."""
    light_field = refocuser.light_field
    height, width = light_field.image_size
    if not (0 <= at[0] < height and 0 <= at[1] < width):
        raise InputError(
            f"--at {at[0]} {at[1]} is outside the views of {height}x{width} pixels; rows are 0 to "
            f"{height - 1}, columns 0 to {width - 1}"
        )
    if result is not None:
        disparity = float(_disparity_map(refocuser, result)[at])
    else:
        from occjax.estimators import estimate
        from occjax.layout import disparity_range_of

        window_px = 128  # a square part of the views is enough
        top, left = (
            min(max(place - window_px // 2, 0), max(size - window_px, 0))
            for place, size in zip(at, light_field.image_size, strict=True)
        )
        views = light_field.views[:, :, top : top + window_px, left : left + window_px]
        window = dataclasses.replace(light_field, views=views, ground_truth=None)
        found = estimate(window, disparity_range=disparity_range_of(light_field)[0])
        disparity = float(found.disparity[at[0] - top, at[1] - left])
    if math.isnan(disparity):
        raise InputError(f"--at {at[0]} {at[1]} has no disparity; choose another pixel")
    return disparity
