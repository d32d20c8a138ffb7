"""Where the scenes of the HCI 4D benchmark are, in a folder that has been filled from its archives.

The archives unpack to ``training/cotton`` and the like; scenes may also lie in the folder itself.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from occjax.errors import InputError
from occjax.io import read_image
from occjax.io.submission import SCENES, SIZE

VIEWS = 81
CENTRE = 40

MASKS = "additional_invalid_area"
"""Folder that published trainings keep beside the scenes: masks of some, in folders of their names.
"""


def check_names(scenes: Iterable[str]) -> None:
    """Refuse what is no scene of the benchmark, or named twice.

    Raises:
        InputError: With the names that there are.
    """
    seen: set[str] = set()
    for scene in scenes:
        if scene not in SCENES:
            raise InputError(
                f"{scene!r} is no scene of the benchmark; they are {', '.join(SCENES)}"
            )
        if scene in seen:
            raise InputError(f"scene {scene} is named twice; name each once")
        seen.add(scene)


def find_scene(folder: Path, scene: str) -> Path | None:
    """Folder of one scene: ``folder/scene`` or ``folder/*/scene``.

    Args:
        folder: Where the benchmark's archives were unpacked.
        scene: Name of the scene.

    Returns:
        Its folder, or None if there is none.

    Raises:
        InputError: If there is no such folder, or the scene is in it more than once.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: there is no such folder; check the path")
    below = (path for path in sorted(folder.glob(f"*/{scene}")) if path.parent.name != MASKS)
    places = [path for path in (folder / scene, *below) if path.is_dir()]
    if len(places) > 1:
        listed = " and ".join(str(path) for path in places)
        raise InputError(f"{folder}: has the scene {scene} as {listed}; remove one of them")
    return places[0] if places else None


def every_scene(folder: Path, scenes: Iterable[str], advice: str) -> dict[str, Path]:
    """Folders of scenes, all of which are there.

    Args:
        folder: Where the benchmark's archives were unpacked.
        scenes: Names of the scenes.
        advice: What to do if some are missing.

    Returns:
        By scene.

    Raises:
        InputError: Naming all scenes that are missing, or one that is there twice.
    """
    found = {scene: find_scene(folder, scene) for scene in scenes}
    missing = [scene for scene, place in found.items() if place is None]
    if missing:
        raise InputError(
            f"{folder}: has no folder of {', '.join(missing)}, here or one level below; {advice}"
        )
    return {scene: place for scene, place in found.items() if place is not None}


def scene_folders(folder: Path, scenes: Iterable[str]) -> dict[str, Path]:
    """Folders of scenes, all of which are there with all of their views.

    Of the images only the centre view is read.

    Args:
        folder: Where the benchmark's archives were unpacked.
        scenes: Names of the scenes.

    Returns:
        By scene.

    Raises:
        InputError: If a scene or a view is missing, or the centre view is not 512x512.
    """
    places = every_scene(
        folder, scenes, "get them from the benchmark, or choose others with --scenes"
    )
    for place in places.values():
        _check_views(place)
    return places


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
