"""The bundled sample light field: a photorealistic rendering by this project, with ground truth.

``python -m experiments.blender.make_sample`` makes its files from a rendered scene.
"""

from __future__ import annotations

from pathlib import Path

from occjax.io import read_image, read_pfm, split_tiles
from occjax.io.hci_config import read_hci_config
from occjax.lightfield import LightField

GRID = (9, 9)
"""Rows and columns of views."""

VIEWS_FILE = "sample_views.jpg"
DISPARITY_FILE = "sample_disparity.pfm"
PARAMETERS_FILE = "sample_parameters.cfg"


def sample() -> LightField:
    """Return the bundled sample: 9x9 views of 256x256 pixels, ground truth and calibration.

    Returns:
        Light field with uint8 views ``[9, 9, 256, 256, 3]``.

    Example:
        >>> light_field = sample()
        >>> light_field.grid, light_field.image_size, light_field.ground_truth.shape
        ((9, 9), (256, 256), (256, 256))
    """
    folder = Path(__file__).parent
    config = read_hci_config(folder / PARAMETERS_FILE)
    return LightField(
        views=split_tiles(read_image(folder / VIEWS_FILE), GRID),
        name="sample",
        calibration=config.calibration,
        disparity_range=config.disparity_range,
        ground_truth=read_pfm(folder / DISPARITY_FILE),
    )
