"""Pictures of the documentation's gallery: the bundled sample as other cameras would record it.

``python -m experiments.gallery -o docs/gallery`` writes, for each camera, ``CAMERA.jpg``, which is
centre view, ground truth, estimate and error, and ``CAMERA_views.jpg``, which is all views. Cost: a
minute on two cores. Expected: the estimates of all three cameras look alike.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import numpy as np
from PIL import Image
from tyro.conf import arg

import occjax
from experiments.command_line import main
from occjax.data.bundled_sample import sample
from occjax.io.mosaics import join_tiles
from occjax.lightfield import LightField, centre_index, to_unit_float, view_offsets

SHRINK = 4
"""Factor by which the views are reduced in the picture of all views."""


def plenoptic(light_field: LightField) -> LightField:
    """Return the views of a lenslet camera: darker towards the rim of the aperture, with noise."""
    reach = np.linalg.norm(view_offsets(*light_field.grid), axis=-1)
    transmitted = np.clip(1.15 - (reach / 5.2) ** 4, 0.02, 1.0)[..., None, None, None]
    noise = np.random.default_rng(0).normal(0.0, 0.01, light_field.views.shape)
    views = np.clip(transmitted * to_unit_float(light_field.views) + noise, 0.0, 1.0)
    return _with_views(light_field, views, "plenoptic")


def gantry(light_field: LightField) -> LightField:
    """Return the views of a gantry: twice as far apart, each displaced by up to one pixel."""
    views = light_field.views[::2, ::2].copy()
    shifts = np.random.default_rng(0).integers(-1, 2, (*views.shape[:2], 2))
    shifts[centre_index(views.shape[:2])] = 0
    for index in np.ndindex(*views.shape[:2]):
        views[index] = np.roll(views[index], tuple(shifts[index]), axis=(0, 1))
    moved = _with_views(light_field, to_unit_float(views), "gantry")
    return dataclasses.replace(moved, ground_truth=2.0 * light_field.ground_truth)


CAMERAS = {"hci": lambda light_field: light_field, "plenoptic": plenoptic, "gantry": gantry}
"""The sample as each camera would record it."""


def gallery(
    output: Annotated[Path, arg(aliases=["-o"], help="Folder of the pictures.")],
) -> None:
    """Write the pictures of all cameras."""
    output.mkdir(parents=True, exist_ok=True)
    for name, camera in CAMERAS.items():
        light_field = camera(sample())
        tiles = Image.fromarray(join_tiles(light_field.views))
        tiles.reduce(SHRINK).save(output / f"{name}_views.jpg", quality=85)
        estimate = occjax.estimate(light_field)
        print(f"{name}:", *estimate.notes, sep="\n  ")
        with TemporaryDirectory() as folder:
            estimate.save(folder, what=("figures",))
            picture = Image.open(Path(folder) / "comparison.png").convert("RGB")
        picture.save(output / f"{name}.jpg", quality=88)


def _with_views(light_field: LightField, views: np.ndarray, name: str) -> LightField:
    """Replace the views; the disparity range has to be measured, as for a real camera."""
    return LightField(
        np.round(255.0 * views).astype(np.uint8),
        name=name,
        ground_truth=light_field.ground_truth,
    )


if __name__ == "__main__":
    main(gallery, __doc__)
