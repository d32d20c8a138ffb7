"""The bundled sample light field: a photorealistic rendering by this project, with ground truth.

``python -m experiments.blender.make_sample`` makes its files from a rendered scene.
"""

from __future__ import annotations

from importlib import resources

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
