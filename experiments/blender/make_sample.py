"""Make the bundled sample light field from a rendered scene.

    python -m experiments.blender FOLDER --seeds 3010 3011 --samples 128
    python -m experiments.blender.make_sample FOLDER/s3010

The first command renders one scene, of seed 3010. The second takes seconds and writes the three
files of :mod:`occjax.data.bundled_sample`.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import imageio.v3 as imageio
from tyro.conf import Positional

from experiments.command_line import main
from occjax.data import bundled_sample
from occjax.data.bundled_sample import DISPARITY_FILE, GRID, PARAMETERS_FILE, VIEWS_FILE
from occjax.errors import InputError
from occjax.io import atomic_path, join_tiles, load, write_pfm
from occjax.io.hci_config import GROUND_TRUTH, PARAMETERS

JPEG_STEPS = (5, 12)
"""Quantisation steps of brightness and of colour, equal for all frequencies.

Equal steps give the smallest error for a file size. The usual tables favour the eye and blur the
fine texture that disparity estimation needs.
"""


def make_sample(
    scene: Positional[Path], folder: Path = Path(bundled_sample.__file__).parent
) -> None:
    """Write the bundled files from a rendered scene.

    Args:
        scene: Folder of a scene with 9x9 views that ``experiments.blender`` has rendered.
        folder: Folder of the files, by default that of the package.

    Raises:
        InputError: If the scene cannot be read, does not have 9x9 views, or has no ground truth or
            no calibration.
    """
    light_field = load(scene)
    truth = light_field.ground_truth
    if truth is None or light_field.calibration is None:
        missing = GROUND_TRUTH if truth is None else PARAMETERS
        raise InputError(f"{scene}: has no {missing}; the sample needs it")
    if light_field.grid != GRID:
        v, u = light_field.grid
        raise InputError(f"{scene}: has {v}x{u} views; the sample has {GRID[0]}x{GRID[1]}")
    with atomic_path(folder / VIEWS_FILE) as path:
        tables = [[step] * 64 for step in JPEG_STEPS]
        mosaic = join_tiles(light_field.views)
        imageio.imwrite(path, mosaic, qtables=tables, subsampling=0, optimize=True)
    write_pfm(folder / DISPARITY_FILE, truth)
    shutil.copyfile(scene / PARAMETERS, folder / PARAMETERS_FILE)


if __name__ == "__main__":
    main(make_sample, __doc__)
