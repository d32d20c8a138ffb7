"""Masks of the reflective regions of the HCI 4D benchmark's scenes, which training leaves out.

A scene's own ``mask.png`` is read with the scene and is not black where it is masked. The images
that published trainings share, ``additional_invalid_area/<scene>/*.png``, are opaque where it is
masked.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from experiments.hci_scenes import MASKS
from occjax.data.scenes import MASK, Scene
from occjax.errors import InputError
from occjax.io import read_image

REFLECTIVE = ("kitchen", "museum", "vinyl")
"""Scenes with regions whose ground truth is of a surface that shows something else."""


def shared_masks(
    hci: Path, places: Mapping[str, Path], masks: Path | None, *, needed: bool = True
) -> dict[str, Path]:
    """Files that mask the reflective regions of scenes without a ``mask.png`` of their own.

    Args:
        hci: Where the benchmark's archives were unpacked; where masks are found by default.
        places: Folders of the scenes.
        masks: Folder of folders of the scenes, each with one image.
        needed: Whether every reflective scene must have a mask.

    Returns:
        By scene.

    Raises:
        InputError: If a needed mask is missing, or might be any of several.
    """
    if masks is not None and not masks.is_dir():
        raise InputError(f"{masks}: there is no such folder of masks; check the path")
    found, missing = {}, []
    for name in REFLECTIVE:
        if name not in places or (places[name] / MASK).is_file():
            continue
        images = sorted(((masks or hci / MASKS) / name).glob("*.png"))
        if len(images) > 1:
            raise InputError(f"{images[0].parent}: has {len(images)} images; leave only the mask")
        if images:
            found[name] = images[0]
        else:
            missing.append(name)
    if missing and needed:
        raise InputError(
            f"{hci}: {', '.join(missing)} should have masks of reflective regions and have none; "
            "pass --masks FOLDER with FOLDER/<scene>/*.png, or --without-masks to train on these "
            "regions too"
        )
    return found


def with_mask(scene: Scene, path: Path | None) -> Scene:
    """A scene of which the masked part is not learnt from.

    Args:
        scene: As it was read.
        path: Image whose opaque pixels are masked, or without opacity those that are not black;
            None for no other mask than the scene came with.

    Raises:
        InputError: If it cannot be read, has another size, or masks everything.
    """
    if path is None:
        return scene
    read_image(path)  # whatever is no image is refused, in words for people
    with Image.open(path) as image:
        opacity = image.getchannel("A") if "A" in image.getbands() else image.convert("L")
        masked = np.asarray(opacity) > 0
    if masked.shape != scene.disparity.shape:
        raise InputError(
            f"{path}: is {list(masked.shape)} but the views are {list(scene.disparity.shape)}"
        )
    if masked.all():
        raise InputError(f"{path}: masks every pixel; make it transparent where there is no mask")
    return replace(scene, valid=scene.valid & ~masked, masked=True)
