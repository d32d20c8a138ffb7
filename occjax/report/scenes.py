"""Content of a report: what the page shows of one scene, as values that JSON can store."""

from __future__ import annotations

import base64
import io
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from occjax.errors import InputError
from occjax.estimators.protocol import Estimate
from occjax.io.maps import SUMMARY
from occjax.lightfield import Calibration, centre_index
from occjax.results.outputs import has_signal
from occjax.results.reading import read_estimate
from occjax.results.summary import read_summary
from occjax.viz.colour import disparity_norm
from occjax.viz.pictures import view_picture


@dataclass(frozen=True)
class ReportConfig:
    """Limits of the size of a report, which is about 2 MB per scene.

    Attributes:
        max_pixels: Largest number of pixels of a map. Of larger maps, every second, third, ...
            pixel in each direction is shown.
        max_occlusion_px: Longest side of the mosaic of the occlusion maps of all views, in pixels.
        max_points: Largest number of points of a point cloud.
        jpeg_quality: Quality of the pictures, 1 to 95.
    """

    max_pixels: int = 330_000
    max_occlusion_px: int = 1440
    max_points: int = 150_000
    jpeg_quality: int = 85


@dataclass(frozen=True)
class ReportScene:
    """One scene of a report.

    Attributes:
        summary: Content of ``summary.json``.
        data: What the script of the page draws.
    """

    summary: dict[str, Any]
    data: dict[str, Any]


def read_scenes(folders: tuple[Path, ...]) -> list[ReportScene]:
    """Read the scenes of folders of results.

    Args:
        folders: Folders of one scene each, or folders that contain such folders.

    Returns:
        The scenes, in this order.

    Raises:
        InputError: If a folder has no results.
    """
    found: list[Path] = []
    for folder in folders:
        inner = sorted(path.parent for path in folder.glob(f"*/{SUMMARY}"))
        if not inner or (folder / SUMMARY).is_file():
            inner = [folder]
        found += [path for path in inner if path not in found]
    return [
        report_scene(read_estimate(path), read_summary(path / SUMMARY), folder=path)
        for path in found
    ]


def report_scene(
    estimate: Estimate, summary: dict[str, Any], *, folder: Path | None = None
) -> ReportScene:
    """Return what a report shows of an estimate.

    Args:
        estimate: The estimate, with its light field.
        summary: Content of its ``summary.json``.
        folder: Where it comes from, for messages.

    Raises:
        InputError: If the estimate has no light field.
    """
    config, light_field = ReportConfig(), estimate.light_field
    if light_field is None:
        raise InputError(
            f"{folder or summary['scene']}: has no centre view, since an older version wrote it; "
            "estimate again"
        )
    step = int(np.ceil(np.sqrt(estimate.disparity.size / config.max_pixels)))
    signal = has_signal(light_field, estimate.confidence)
    disparity = np.where(signal, estimate.disparity, np.nan)
    truth = light_field.ground_truth
    norm = disparity_norm(disparity, estimate.confidence, truth)
    # Two digits are shown; further digits would only make the file larger.
    confidence = np.where(signal, np.round(estimate.confidence, 2), np.nan)
    maps = {
        "disparity": packed(disparity[::step, ::step]),
        "confidence": packed(confidence[::step, ::step]),
    }
    if summary.get("metrics") is not None and truth is not None:
        maps["error"] = packed((estimate.disparity - truth)[::step, ::step])
    height, width = disparity[::step, ::step].shape
    centre = Image.fromarray(view_picture(light_field.centre)).resize(
        (width, height), Image.Resampling.BOX if step > 1 else None
    )
    data = {
        "height": height,
        "width": width,
        "step": step,
        "limits": [norm.vmin, norm.vmax],
        "maps": maps,
        "centre": _jpeg(centre, config.jpeg_quality),
        "camera": _camera(light_field.calibration, light_field.image_size, step),
        "max_points": config.max_points,
        "occlusion": _occlusion(estimate.occlusion, light_field.view, config),
    }
    return ReportScene(summary, data)


def packed(values: np.ndarray) -> dict[str, Any]:
    """Return a map as 16-bit codes, compressed, in text.

    A value is ``low + scale * code``. Codes are stored as differences from the pixel to the left,
    in the first column from the pixel above. Zigzag coding turns the differences 0, -1, 1, -2, ...
    into 0, 1, 2, 3, ... The upper bytes of all pixels come first, then the lower bytes. Such data
    compress well, because neighbouring pixels have similar values.

    Args:
        values: ``[H, W]``; pixels that are not finite have the code 65535.

    Returns:
        ``low``, ``scale`` and ``codes``.

    Example:
        >>> packed(np.array([[0.0, 1.0]]))["scale"] * 65534
        1.0
    """
    known = np.isfinite(values)
    low, high = (
        (float(values[known].min()), float(values[known].max())) if known.any() else (0.0, 1.0)
    )
    no_value = 65535
    scale = (high - low) / (no_value - 1) or 1.0
    codes = np.full(values.shape, no_value, np.int64)
    codes[known] = np.rint((values[known].astype(np.float64) - low) / scale)
    change = np.diff(codes, axis=1, prepend=0)
    change[:, 0] = np.diff(codes[:, 0], prepend=0)
    change = (change + 32768) % 65536 - 32768
    zigzag = np.where(change < 0, -2 * change - 1, 2 * change).astype(np.uint16)
    planes = np.stack([zigzag >> 8, zigzag & 255]).astype(np.uint8)
    codes_text = base64.b64encode(zlib.compress(planes.tobytes(), 9)).decode("ascii")
    return {"low": low, "scale": scale, "codes": codes_text}


def _camera(
    calibration: Calibration | None, image_size: tuple[int, int], step: int
) -> dict[str, float] | None:
    """Return focal length in shown pixels, and inverse depth as slope * disparity + constant."""
    if calibration is None:
        return None
    zero, one = (calibration.inverse_depth(d, image_size) for d in (0.0, 1.0))
    focal_length = calibration.focal_length_pixels(image_size) / step
    return {"focal_length": focal_length, "slope": one - zero, "constant": zero}


def _occlusion(
    occlusion: np.ndarray | None, view: tuple[int, int] | None, config: ReportConfig
) -> dict[str, Any] | None:
    """Return a mosaic of the occlusion maps; light is occluded."""
    if occlusion is None:
        return None
    centre = centre_index(occlusion.shape[:2])
    if view is not None:  # The grid is padded so that the view is its centre; remove the padding.
        rows, columns = (
            slice(at - own, 2 * at - own + 1) for at, own in zip(centre, view, strict=True)
        )
        occlusion, centre = occlusion[rows, columns], view
    v, u, height, width = occlusion.shape
    zoom = min(1.0, config.max_occlusion_px / max(v * height, u * width))
    height, width = max(1, int(zoom * height)), max(1, int(zoom * width))
    levels = np.rint(255.0 * np.clip(np.nan_to_num(occlusion), 0.0, 1.0)).astype(np.uint8)
    # As in the figure, the colours end at the 99th percentile, since most values are small.
    positive = levels[levels > 0]
    white = max(1.0, float(np.percentile(positive, 99.0)) if positive.size else 255.0)
    mosaic = Image.new("L", (u * width, v * height))
    for row, column in np.ndindex(v, u):
        brightened = np.clip(levels[row, column] * (255.0 / white), 0, 255).astype(np.uint8)
        tile = Image.fromarray(brightened).resize((width, height), Image.Resampling.BOX)
        mosaic.paste(tile, (column * width, row * height))
    return {
        "image": _jpeg(mosaic, config.jpeg_quality),
        "grid": [v, u],
        "centre": list(centre),
        "size": [height, width],
        "white": white / 255.0,
    }


def _jpeg(image: Image.Image, quality: int) -> str:
    """Return the ``data:`` address of an image."""
    file = io.BytesIO()
    image.save(file, format="JPEG", quality=quality)
    return "data:image/jpeg;base64," + base64.b64encode(file.getvalue()).decode("ascii")
