"""Files of a scene's folder other than the views: ground truth, camera parameters and masks."""

from __future__ import annotations

import configparser
import json
import math
from pathlib import Path
from typing import Any

import imageio.v3 as imageio
import numpy as np

from experiments.blender.config import RenderConfig
from occjax.errors import InputError
from occjax.io.atomic import atomic_path
from occjax.io.files import decoding
from occjax.io.hci_config import GROUND_TRUTH, PARAMETERS
from occjax.io.pfm import write_pfm
from occjax.lightfield import Calibration

RECORD = "scene.json"
GEOMETRY = "geometry.npz"

MIN_EDGE_STEP = 0.1
"""Disparity step between neighbouring pixels that counts as an edge, pixels per view step."""

EDGE_RADIUS_PX = 1
"""Distance from the pixels at an edge within which pixels are near a discontinuity."""

MAX_NORMAL_VARIATION = 1e-3
"""Variation of a unit normal within a plane that rounding may cause."""


def view_name(number: int) -> str:
    """Return the file name of a view, such as ``input_Cam040.png``."""
    return f"input_Cam{number:03d}.png"


def read_record(folder: Path, config: RenderConfig) -> dict[str, Any] | None:
    """Return the renderer's description of a scene, or None if rendering has not started.

    Raises:
        InputError: If the folder contains a scene rendered with other settings, or the description
            is damaged.
    """
    path = folder / RECORD
    if not path.is_file():
        return None
    remedy = "remove the folder and render it again"
    with decoding(path, "the description of a scene", remedy=remedy, max_bytes=2**24) as file:
        record = json.load(file)
        found = dict(record["config"])
    expected = config.as_dict()
    differ = [name for name in expected if found.get(name) != expected[name]]
    if differ:
        values = ", ".join(f"{name} {found.get(name)} not {expected[name]}" for name in differ)
        raise InputError(f"{folder}: was rendered with {values}; choose another folder")
    return record


def missing_views(folder: Path, config: RenderConfig) -> list[int]:
    """Return the numbers of the views that the folder lacks."""
    return [number for number in range(config.views) if not (folder / view_name(number)).is_file()]


def write_ground_truth(folder: Path, config: RenderConfig) -> None:
    """Write all files other than the views, from the renderer's depth and object maps.

    The files are ``gt_disp_lowres.pfm`` (pixels per view step), ``gt_depth_lowres.pfm`` (metres),
    ``masks/*.png`` (:func:`masks`, and the object number of each pixel) and ``parameters.cfg``,
    which is written last.

    Args:
        folder: Folder with the renderer's description and geometry.
        config: Settings that the scene was rendered with.

    Raises:
        InputError: If the folder has no description of this scene.
    """
    record = read_record(folder, config)
    if record is None:
        raise InputError(f"{folder}: has no {RECORD}; render the scene first")
    with np.load(folder / GEOMETRY) as arrays:
        depth, objects, facing = (arrays[name] for name in ("depth", "objects", "facing"))
    calibration = Calibration(**record["rig"])
    disparity = calibration.disparity(depth.astype(np.float64), depth.shape).astype(np.float32)
    write_pfm(folder / GROUND_TRUTH, disparity)
    write_pfm(folder / "gt_depth_lowres.pfm", depth)
    _write_png(folder / "masks" / "objects.png", objects.astype(np.uint16))
    regions = masks(disparity, objects, facing, plain=record["plain"], glossy=record["glossy"])
    for name, mask in regions.items():
        _write_png(folder / "masks" / f"{name}.png", 255 * mask.astype(np.uint8))
    _write_parameters(folder / PARAMETERS, record["style"], calibration, config, disparity)


def masks(
    disparity: np.ndarray,
    objects: np.ndarray,
    facing: np.ndarray,
    *,
    plain: list[int],
    glossy: list[int],
) -> dict[str, np.ndarray]:
    """Return regions of the centre view for separate error statistics.

    Args:
        disparity: ``[H, W]`` ground truth, pixels per view step.
        objects: ``[H, W]`` object number of each pixel.
        facing: ``[H, W]`` value that is constant only where the surface normal is.
        plain: Numbers of the objects without texture.
        glossy: Numbers of the objects whose appearance changes with the view.

    Returns:
        ``[H, W]`` bool masks by name: ``discontinuities`` (near a disparity edge), ``planes``
        (within a planar surface), ``plain`` and ``glossy`` (on such an object).
    """
    edges = np.zeros(disparity.shape, bool)
    for axis in (0, 1):
        step = np.abs(np.diff(disparity, axis=axis)) > MIN_EDGE_STEP
        for margin in ((1, 0), (0, 1)):
            edges |= np.pad(step, [margin if side == axis else (0, 0) for side in (0, 1)])
    same_object = local_maximum(objects, 1) == -local_maximum(-objects, 1)
    variation = local_maximum(facing, 1) + local_maximum(-facing, 1)
    return {
        "discontinuities": local_maximum(edges, EDGE_RADIUS_PX),
        "planes": same_object & (variation < MAX_NORMAL_VARIATION),
        "plain": np.isin(objects, plain),
        "glossy": np.isin(objects, glossy),
    }


def local_maximum(image: np.ndarray, radius: int) -> np.ndarray:
    """Return the maximum over a square window around each pixel.

    Args:
        image: ``[H, W]`` values.
        radius: Half of the window's side, rounded down, in pixels.

    Returns:
        ``[H, W]`` maxima; windows are cut off at the image border.

    Example:
        >>> local_maximum(np.array([[0, 3, 0, 1, 2]]), 1).tolist()
        [[3, 3, 3, 2, 2]]
    """
    padded = np.pad(image, radius, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (2 * radius + 1,) * 2)
    return windows.max((-2, -1))


def _write_parameters(
    path: Path, style: str, calibration: Calibration, config: RenderConfig, disparity: np.ndarray
) -> None:
    """Write ``parameters.cfg`` in the format of the HCI 4D benchmark."""
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
        # Rounded outwards, so that the range includes every pixel.
        "disp_min": f"{math.floor(1000 * float(disparity.min())) / 1000}",
        "disp_max": f"{math.ceil(1000 * float(disparity.max())) / 1000}",
    }
    with atomic_path(path) as temporary, temporary.open("w") as file:
        parser.write(file)


def _write_png(path: Path, image: np.ndarray) -> None:
    with atomic_path(path) as temporary:
        imageio.imwrite(temporary, image)
