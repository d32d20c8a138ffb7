"""What a scene's folder holds beside the views: ground truth, camera parameters and masks."""

from __future__ import annotations

import configparser
import json
import math
from pathlib import Path
from typing import Any

import imageio.v3 as imageio
import numpy as np

from occjax.errors import InputError
from occjax.io.atomic import atomic_path
from occjax.io.pfm import write_pfm
from occjax.lightfield import Calibration
from occjax.render.config import RenderConfig

RECORD = "scene.json"
GEOMETRY = "geometry.npz"

JUMP = 0.1
"""Difference of neighbouring pixels' disparities above which a surface is taken to end there."""

NEAR_JUMP = 2
"""Pixels on both sides of a jump that count as discontinuity."""

SAME_NORMAL = 1e-3
"""Variation of a unit normal that rounding may cause."""


def view_name(number: int) -> str:
    """File name of a view: ``input_Cam040.png``."""
    return f"input_Cam{number:03d}.png"


def read_record(folder: Path, config: RenderConfig) -> dict[str, Any] | None:
    """What the renderer wrote about a scene, or None where it has not begun.

    Raises:
        InputError: If the folder has a scene that was rendered with other values.
    """
    path = folder / RECORD
    if not path.is_file():
        return None
    try:
        record = json.loads(path.read_text())
        found = record["config"]
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: is damaged; remove the folder and render it again") from error
    wanted = config.as_dict()
    differ = [name for name in wanted if found.get(name) != wanted[name]]
    if differ:
        values = ", ".join(f"{name} {found.get(name)} not {wanted[name]}" for name in differ)
        raise InputError(f"{folder}: was rendered with {values}; choose another folder")
    return record


def missing_views(folder: Path, config: RenderConfig) -> list[int]:
    """Numbers of the views that are not in the folder yet."""
    return [number for number in range(config.views) if not (folder / view_name(number)).is_file()]


def write_ground_truth(folder: Path, config: RenderConfig) -> None:
    """Write everything but the views, from what the renderer measured.

    ``gt_disp_lowres.pfm`` in pixels per view step, ``gt_depth_lowres.pfm`` in metres,
    ``masks/*.png`` (:func:`masks`, and the number of the object at each pixel) and, last of all,
    ``parameters.cfg``.

    Args:
        folder: Of the scene, with the renderer's record and geometry and the centre view.
        config: What it was rendered with.
    """
    record = read_record(folder, config)
    if record is None:
        raise InputError(f"{folder}: has no {RECORD}; render the scene first")
    with np.load(folder / GEOMETRY) as arrays:
        depth, objects, facing = (arrays[name] for name in ("depth", "objects", "facing"))
    calibration = Calibration(**record["rig"])
    disparity = disparity_from_depth(depth, calibration)
    write_pfm(folder / "gt_disp_lowres.pfm", disparity)
    write_pfm(folder / "gt_depth_lowres.pfm", depth)
    _write_png(folder / "masks" / "objects.png", objects.astype(np.uint16))
    regions = masks(disparity, objects, facing, plain=record["plain"], glossy=record["glossy"])
    for name, mask in regions.items():
        _write_png(folder / "masks" / f"{name}.png", 255 * mask.astype(np.uint8))
    _write_parameters(folder / "parameters.cfg", record["style"], calibration, config, disparity)


def disparity_from_depth(depth: np.ndarray, calibration: Calibration) -> np.ndarray:
    """Disparity of a depth map (:meth:`occjax.lightfield.Calibration.disparity`), for a file.

    Args:
        depth: ``[H, W]`` metres along the optical axis; may be infinite.
        calibration: Of the cameras.

    Returns:
        ``[H, W]`` float32 disparity in pixels per view step; nearer points have larger ones.

    Example:
        >>> camera = Calibration(100.0, 35.0, baseline_mm=50.0, focus_distance_m=7.0)
        >>> disparity = disparity_from_depth(np.array([[3.5, 7.0, np.inf]]), camera)
        >>> [round(float(value), 3) for value in disparity[0]]
        [0.061, 0.0, -0.061]
    """
    height, width = depth.shape
    return calibration.disparity(depth.astype(np.float64), (height, width)).astype(np.float32)


def masks(
    disparity: np.ndarray,
    objects: np.ndarray,
    facing: np.ndarray,
    *,
    plain: list[int],
    glossy: list[int],
) -> dict[str, np.ndarray]:
    """Regions of the centre view over which errors are worth averaging.

    Args:
        disparity: ``[H, W]`` ground truth.
        objects: ``[H, W]`` number of the object at each pixel.
        facing: ``[H, W]`` a number that is constant only where the normal of the surface is.
        plain: Objects that have no texture.
        glossy: Objects whose looks change with the view.

    Returns:
        ``[H, W]`` bool by name: ``discontinuities`` (close to a jump of disparity), ``planes``
        (within a flat surface), ``plain`` and ``glossy`` (on such an object).
    """
    jumps = np.zeros(disparity.shape, bool)
    across = np.abs(np.diff(disparity, axis=1)) > JUMP
    down = np.abs(np.diff(disparity, axis=0)) > JUMP
    jumps[:, 1:] |= across
    jumps[:, :-1] |= across
    jumps[1:] |= down
    jumps[:-1] |= down
    same_object = largest_around(objects, 1) == -largest_around(-objects, 1)
    bend = largest_around(facing, 1) + largest_around(-facing, 1)
    return {
        "discontinuities": largest_around(jumps, NEAR_JUMP - 1),
        "planes": same_object & (bend < SAME_NORMAL),
        "plain": np.isin(objects, plain),
        "glossy": np.isin(objects, glossy),
    }


def largest_around(image: np.ndarray, radius: int) -> np.ndarray:
    """Greatest value within a square around each pixel.

    Args:
        image: ``[H, W]`` values.
        radius: The square's side is twice this and one more.

    Returns:
        ``[H, W]``.

    Example:
        >>> largest_around(np.array([[0, 3, 0, 1, 2]]), 1).tolist()
        [[3, 3, 3, 2, 2]]
    """
    padded = np.pad(image, radius, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (2 * radius + 1,) * 2)
    return windows.max((-2, -1))


def _write_parameters(
    path: Path, style: str, calibration: Calibration, config: RenderConfig, disparity: np.ndarray
) -> None:
    """``parameters.cfg`` as in the HCI 4D benchmark."""
    rows, columns = config.grid
    height, width = config.image_size
    parser = configparser.ConfigParser()
    parser["intrinsics"] = {
        "image_resolution_x_px": str(width),
        "image_resolution_y_px": str(height),
        "focal_length_mm": repr(calibration.focal_length_mm),
        "sensor_size_mm": repr(calibration.sensor_size_mm),
        "fstop": "100.0",
    }
    parser["extrinsics"] = {
        "num_cams_x": str(columns),
        "num_cams_y": str(rows),
        "baseline_mm": repr(calibration.baseline_mm),
        "focus_distance_m": repr(calibration.focus_distance_m),
    }
    parser["meta"] = {
        "scene": path.parent.resolve().name,
        "category": style,
        # Rounded outwards, so that the range holds every pixel.
        "disp_min": f"{math.floor(1000 * float(disparity.min())) / 1000}",
        "disp_max": f"{math.ceil(1000 * float(disparity.max())) / 1000}",
    }
    with atomic_path(path) as temporary, temporary.open("w") as file:
        parser.write(file)


def _write_png(path: Path, image: np.ndarray) -> None:
    with atomic_path(path) as temporary:
        imageio.imwrite(temporary, image)
