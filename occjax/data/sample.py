"""The bundled sample light field: a photorealistic rendering by this project, with ground truth.

It is made of a scene of ``occjax render``:

    occjax render FOLDER --seeds 3010 3011 --samples 128
    python -m occjax.data.sample FOLDER/s3010
"""

from __future__ import annotations

import shutil
from importlib import resources
from pathlib import Path

import imageio.v3 as imageio
from tyro.conf import Positional

from occjax.errors import InputError
from occjax.evaluation.scene_files import GROUND_TRUTH, PARAMETERS
from occjax.io import atomic_path, join_tiles, load, read_image, read_pfm, split_tiles, write_pfm
from occjax.io.hci_config import read_hci_config
from occjax.lightfield import LightField

GRID = (9, 9)

VIEWS_FILE = "sample_views.jpg"
DISPARITY_FILE = "sample_disparity.pfm"
PARAMETERS_FILE = "sample_parameters.cfg"
JPEG_STEPS = (5, 12)
"""Quantisation steps of brightness and of colour.

Equal for all frequencies, which gives the smallest error for a file's size; the usual tables favour
the eye and blur the fine texture that disparity is found by.
"""


def sample() -> LightField:
    """The bundled sample: 9x9 views of 256x256 pixels, with ground truth and calibration.

    Returns:
        uint8 views ``[9, 9, 256, 256, 3]`` and everything that a light field can know.

    Example:
        >>> light_field = sample()
        >>> light_field.grid, light_field.image_size, light_field.ground_truth.shape
        ((9, 9), (256, 256), (256, 256))
    """
    folder = resources.files("occjax.data")
    with resources.as_file(folder / VIEWS_FILE) as path:
        views = split_tiles(read_image(path), GRID)
    with resources.as_file(folder / DISPARITY_FILE) as path:
        disparity = read_pfm(path)
    with resources.as_file(folder / PARAMETERS_FILE) as path:
        config = read_hci_config(path)
    return LightField(
        views=views,
        name="sample",
        calibration=config.calibration,
        disparity_range=config.disparity_range,
        ground_truth=disparity,
    )


def write_sample(scene: Positional[Path], folder: Path = Path(__file__).parent) -> None:
    """Make the bundled files of a rendered scene.

    Args:
        scene: Folder of the scene, as ``occjax render`` leaves it.
        folder: Where the files go; by default into the package.

    Raises:
        InputError: If the scene cannot be read, is not of 9x9 views, or has no ground truth or
            calibration.
    """
    light_field = load(scene)
    truth = light_field.ground_truth
    if truth is None or light_field.calibration is None:
        missing = GROUND_TRUTH if truth is None else PARAMETERS
        raise InputError(f"{scene}: has no {missing}; the sample needs it")
    if light_field.grid != GRID:
        v, u = light_field.grid
        raise InputError(f"{scene}: has {v}x{u} views; the sample has 9x9")
    with atomic_path(folder / VIEWS_FILE) as path:
        tables = [[step] * 64 for step in JPEG_STEPS]
        mosaic = join_tiles(light_field.views)
        imageio.imwrite(path, mosaic, qtables=tables, subsampling=0, optimize=True)
    write_pfm(folder / DISPARITY_FILE, truth)
    shutil.copyfile(scene / PARAMETERS, folder / PARAMETERS_FILE)


if __name__ == "__main__":
    import tyro

    from occjax.cli.running import exit_with

    exit_with(lambda: tyro.cli(write_sample) or 0)
