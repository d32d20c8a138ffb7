"""Folders of the HCI 4D benchmark's scenes, and masks of their reflective regions.

The archives unpack to ``training/cotton`` and so on; the scenes may also lie in the folder itself.
Training leaves out reflective regions. A scene's own ``mask.png`` is read with the scene; its
masked pixels are not black. In the images that published trainings share,
``additional_invalid_area/<scene>/*.png``, masked pixels are opaque.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from experiments.submission import SCENES, SIZE
from occjax.data.scenes import MASK, Scene
from occjax.errors import InputError
from occjax.io import read_image

VIEWS = 81
CENTRE = 40

MASKS = "additional_invalid_area"
"""Folder of published masks next to the scenes, with one subfolder for each masked scene."""


REFLECTIVE = ("kitchen", "museum", "vinyl")
"""Scenes with reflective regions, whose ground truth is that of the reflecting surface."""


def check_names(scenes: Iterable[str]) -> None:
    """Check that names are scenes of the benchmark and not repeated.

    Raises:
        InputError: If a name is unknown or repeated.
    """
    seen: set[str] = set()
    for scene in scenes:
        if scene not in SCENES:
            raise InputError(f"{scene!r} is not a benchmark scene; they are {', '.join(SCENES)}")
        if scene in seen:
            raise InputError(f"scene {scene} is named twice; name each scene once")
        seen.add(scene)


def find_scene(folder: Path, scene: str) -> Path | None:
    """Return the folder of a scene: ``folder/scene`` or ``folder/*/scene``.

    Args:
        folder: Folder with the unpacked archives of the benchmark.
        scene: Name of the scene.

    Returns:
        Folder of the scene; None if it is missing.

    Raises:
        InputError: If the folder does not exist, or contains the scene more than once.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: is not a folder; check the path")
    below = (path for path in sorted(folder.glob(f"*/{scene}")) if path.parent.name != MASKS)
    places = [path for path in (folder / scene, *below) if path.is_dir()]
    if len(places) > 1:
        listed = " and ".join(str(path) for path in places)
        raise InputError(f"{folder}: has the scene {scene} as {listed}; remove one of them")
    return places[0] if places else None


def every_scene(folder: Path, scenes: Iterable[str], advice: str) -> dict[str, Path]:
    """Return the folders of scenes, all of which must exist.

    Args:
        folder: Folder with the unpacked archives of the benchmark.
        scenes: Names of the scenes.
        advice: End of the error message about missing scenes.

    Returns:
        Folders by scene.

    Raises:
        InputError: If scenes are missing, with all their names, or a scene exists twice.
    """
    found = {scene: find_scene(folder, scene) for scene in scenes}
    missing = [scene for scene, place in found.items() if place is None]
    if missing:
        raise InputError(
            f"{folder}: has no folder {', '.join(missing)}, neither directly nor one level below; "
            f"{advice}"
        )
    return {scene: place for scene, place in found.items() if place is not None}


def scene_folders(folder: Path, scenes: Iterable[str]) -> dict[str, Path]:
    """Return the folders of scenes, which must have all views.

    Only the centre view is read.

    Args:
        folder: Folder with the unpacked archives of the benchmark.
        scenes: Names of the scenes.

    Returns:
        Folders by scene.

    Raises:
        InputError: If a scene or a view is missing, or the centre view is not 512x512.
    """
    places = every_scene(
        folder, scenes, "get them from the benchmark, or choose others with --scenes"
    )
    for place in places.values():
        _check_views(place)
    return places


def shared_masks(
    hci: Path, places: Mapping[str, Path], masks: Path | None, *, needed: bool = True
) -> dict[str, Path]:
    """Return the mask files of reflective scenes without a ``mask.png`` of their own.

    Args:
        hci: Folder with the unpacked archives of the benchmark, and by default with the masks.
        places: Folders of the scenes by name.
        masks: Folder with one subfolder for each scene, each with one image.
        needed: Whether every reflective scene must have a mask.

    Returns:
        Mask files by scene.

    Raises:
        InputError: If a needed mask is missing, or a subfolder has several images.
    """
    if masks is not None and not masks.is_dir():
        raise InputError(f"{masks}: is not a folder; check --masks")
    found, missing = {}, []
    for name in REFLECTIVE:
        if name not in places or (places[name] / MASK).is_file():
            continue
        images = sorted(((masks or hci / MASKS) / name).glob("*.png"))
        if len(images) > 1:
            raise InputError(f"{images[0].parent}: has {len(images)} images; keep only the mask")
        if images:
            found[name] = images[0]
        else:
            missing.append(name)
    if missing and needed:
        raise InputError(
            f"{hci}: {', '.join(missing)} need masks of their reflective regions; "
            "pass --masks FOLDER with FOLDER/<scene>/*.png, or --without-masks to train on these "
            "regions too"
        )
    return found


def with_mask(scene: Scene, path: Path | None) -> Scene:
    """Return a scene whose masked pixels are excluded from training.

    Args:
        scene: The scene.
        path: Image whose opaque pixels are masked; in an image without an alpha channel the pixels
            that are not black. None returns the scene unchanged.

    Raises:
        InputError: If the image cannot be read, has another size, or masks every pixel.
    """
    if path is None:
        return scene
    read_image(path)  # raises an InputError if the file is not an image
    with Image.open(path) as image:
        opacity = image.getchannel("A") if "A" in image.getbands() else image.convert("L")
        masked = np.asarray(opacity) > 0
    if masked.shape != scene.disparity.shape:
        raise InputError(
            f"{path}: is {list(masked.shape)} but the views are {list(scene.disparity.shape)}"
        )
    if masked.all():
        raise InputError(f"{path}: masks every pixel; make unmasked pixels transparent")
    return replace(scene, valid=scene.valid & ~masked, masked=True)


def _check_views(folder: Path) -> None:
    names = [f"input_Cam{number:03d}.png" for number in range(VIEWS)]
    missing = [name for name in names if not (folder / name).is_file()]
    if missing:
        raise InputError(
            f"{folder}: {missing[0]} is missing"
            + (f", and {len(missing) - 1} other views" if len(missing) > 1 else "")
            + "; unpack the scene again"
        )
    size = read_image(folder / names[CENTRE]).shape[:2]
    if size != SIZE:
        raise InputError(
            f"{folder / names[CENTRE]}: is {size[0]}x{size[1]} pixels, not {SIZE[0]}x{SIZE[1]} as "
            "the benchmark's views; unpack the scene again"
        )
