"""The bundled sample light field.

It is a rendering of :func:`occjax.data.still_life.still_life` by this library, with exact ground
truth. ``python -m occjax.data.sample`` renders it again and replaces the bundled files; it takes
some minutes and gives the same bytes on the same machine and versions.
"""

from __future__ import annotations

import math
from importlib import resources
from pathlib import Path

import imageio.v3 as imageio
import jax.numpy as jnp
import numpy as np
from tqdm import tqdm

from occjax.data.procedural import Rendered, centre_disparity, render_rows, view_visibility
from occjax.data.still_life import PERSPECTIVE, RELIEF, still_life
from occjax.io.atomic import atomic_path
from occjax.io.pfm import read_pfm, write_pfm
from occjax.lightfield import Calibration, LightField
from occjax.ops.geometry import view_offsets

GRID = (9, 9)
IMAGE_SIZE = (256, 256)
SAMPLES = 5
"""Rays per pixel along each axis."""

VIEWS_FILE = "sample_views.jpg"
DISPARITY_FILE = "sample_disparity.pfm"
JPEG_STEPS = (5, 12)
"""Quantisation steps of brightness and of colour.

Equal for all frequencies, which gives the smallest error for a file's size; the usual tables favour
the eye and blur the fine texture that disparity is found by. Without loss the views take 6 MB.
"""

FOCUS_DISTANCE_M = 0.5
SENSOR_SIZE_MM = 36.0
"""Sizes that put the scene on a real table; only their ratios show in the images."""


def sample() -> LightField:
    """The bundled sample: 9x9 views of 256x256 pixels, with exact ground truth and calibration.

    Returns:
        uint8 views ``[9, 9, 256, 256, 3]`` and everything that a light field can know.

    Example:
        >>> light_field = sample()
        >>> light_field.grid, light_field.image_size, light_field.ground_truth.shape
        ((9, 9), (256, 256), (256, 256))
    """
    folder = resources.files("occjax.data")
    with resources.as_file(folder / VIEWS_FILE) as path:
        views = untile(imageio.imread(path), GRID)
    with resources.as_file(folder / DISPARITY_FILE) as path:
        disparity = read_pfm(path)
    # The searched range is the scene's, rounded outwards to tenths.
    lowest, highest = float(disparity.min()), float(disparity.max())
    return LightField(
        views=views,
        name="sample",
        calibration=calibration(),
        disparity_range=(math.floor(lowest * 10.0) / 10.0, math.ceil(highest * 10.0) / 10.0),
        ground_truth=disparity,
    )


def calibration() -> Calibration:
    """Cameras in the terms of the HCI format.

    With ``perspective = focus * sensor / (baseline * focal * W)`` and a focal length of ``relief /
    perspective`` pixels, the baseline is the focus distance over the relief.
    """
    return Calibration(
        focal_length_mm=RELIEF / PERSPECTIVE * SENSOR_SIZE_MM / max(IMAGE_SIZE),
        sensor_size_mm=SENSOR_SIZE_MM,
        baseline_mm=1000.0 * FOCUS_DISTANCE_M / RELIEF,
        focus_distance_m=FOCUS_DISTANCE_M,
    )


def render_sample(*, samples: int = SAMPLES, progress: bool = False) -> Rendered:
    """Render the sample's scene: the recipe of the bundled files.

    Args:
        samples: Rays per pixel along each axis.
        progress: Show a progress bar.
    """
    scene = still_life()
    disparity = centre_disparity(scene, IMAGE_SIZE)
    views = np.empty((*GRID, *IMAGE_SIZE, 3), np.float32)
    visibility = np.empty((*GRID, *IMAGE_SIZE), bool)
    offsets = view_offsets(*GRID)
    rows = jnp.arange(IMAGE_SIZE[0])
    for v, u in tqdm(list(np.ndindex(*GRID)), desc="views", disable=not progress):
        views[v, u] = render_rows(scene, offsets[v, u], rows, IMAGE_SIZE, samples=samples)
        visibility[v, u] = view_visibility(scene, disparity, offsets[v, u])
    return Rendered(jnp.asarray(views), disparity, jnp.asarray(visibility))


def to_uint8(images: np.ndarray) -> np.ndarray:
    """Images in [0, 1] as they are stored."""
    return np.floor(np.asarray(images) * 255.0 + 0.5).astype(np.uint8)


def tile(views: np.ndarray) -> np.ndarray:
    """One image ``[V * H, U * W, C]`` of all views, side by side."""
    v, u, h, w, c = views.shape
    return views.transpose(0, 2, 1, 3, 4).reshape(v * h, u * w, c)


def untile(image: np.ndarray, grid: tuple[int, int]) -> np.ndarray:
    """``[V, U, H, W, C]`` views of one image of all views."""
    v, u = grid
    h, w = image.shape[0] // v, image.shape[1] // u
    return np.ascontiguousarray(image.reshape(v, h, u, w, -1).transpose(0, 2, 1, 3, 4))


def write_sample(rendered: Rendered, folder: Path) -> None:
    """Write the bundled files into a folder."""
    with atomic_path(folder / VIEWS_FILE) as path:
        mosaic = tile(to_uint8(np.asarray(rendered.views)))
        tables = [[step] * 64 for step in JPEG_STEPS]
        imageio.imwrite(path, mosaic, qtables=tables, subsampling=0, optimize=True)
    write_pfm(folder / DISPARITY_FILE, np.asarray(rendered.disparity))


if __name__ == "__main__":
    write_sample(render_sample(progress=True), Path(__file__).parent)
