"""What a scene's folder of the HCI 4D benchmark holds for the evaluation.

``gt_disp_lowres.pfm`` is the ground truth, ``parameters.cfg`` the calibration. A region called NAME
is the not black part of the first of these images that is there:

* ``mask_NAME_lowres.png`` or ``mask_NAME.png``, of the benchmark;
* ``masks/NAME.png``, of :mod:`occjax.render`;
* ``mask_NAME_highres.png``, of the benchmark, of which the middle of each pixel is taken.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from occjax.errors import InputError
from occjax.io.files import reading
from occjax.io.hci_config import read_hci_config
from occjax.io.images import read_image
from occjax.lightfield import Calibration

GROUND_TRUTH = "gt_disp_lowres.pfm"
PARAMETERS = "parameters.cfg"

MASK_FILES = (
    "mask_{}_lowres.png",
    "mask_{}.png",
    "masks/{}.png",
    "mask_{}_highres.png",
)


class MissingFile(InputError):
    """A scene lacks what a measure needs.

    Attributes:
        missing: What it lacks: the name of a file, or what is wrong with it.
    """

    def __init__(self, message: str, missing: str) -> None:
        super().__init__(message)
        self.missing = missing


def is_scene(path: Path | str) -> bool:
    """Whether a path is the folder of a scene with ground truth.

    Example:
        >>> is_scene("estimate.pfm")
        False
    """
    return (Path(path) / GROUND_TRUTH).is_file()


def read_mask(folder: Path | str, name: str, size: tuple[int, int]) -> np.ndarray:
    """One region of a scene.

    Args:
        folder: Of the scene.
        name: Of the region, such as ``planes``; see above for the files.
        size: ``(H, W)`` of the scene's disparity map.

    Returns:
        ``[H, W]`` of booleans.

    Raises:
        MissingFile: If the scene has no such region.
        InputError: If the file is damaged or its size does not fit.

    Example:
        >>> import tempfile
        >>> from PIL import Image
        >>> folder = Path(tempfile.mkdtemp())
        >>> Image.fromarray(np.uint8([[0, 255]])).save(folder / "mask_planes_lowres.png")
        >>> read_mask(folder, "planes", (1, 2)).tolist()
        [[False, True]]
    """
    folder = Path(folder)
    candidates = [folder / file.format(name) for file in MASK_FILES]
    path = next((candidate for candidate in candidates if candidate.is_file()), None)
    if path is None:
        wanted = MASK_FILES[0].format(name)
        raise MissingFile(
            f"{folder / wanted}: there is no such mask, nor {MASK_FILES[2].format(name)}; "
            "copy it from the benchmark's scene",
            wanted,
        )
    mask = read_image(path).any(axis=-1)
    factor = max(1, mask.shape[0] // size[0])
    if mask.shape != (factor * size[0], factor * size[1]):
        raise InputError(
            f"{path}: is {list(mask.shape)}, but the disparity is {list(size)}; "
            "a mask has the same size or a whole multiple of it"
        )
    return mask[factor // 2 :: factor, factor // 2 :: factor]


def read_calibration(folder: Path | str) -> Calibration:
    """The camera of a scene.

    Args:
        folder: Of the scene.

    Raises:
        MissingFile: If it has no ``parameters.cfg``.
        InputError: If that file is damaged.
    """
    path = Path(folder) / PARAMETERS
    if not path.is_file():
        raise MissingFile(
            f"{path}: there is no such file, and normals need the camera's calibration; "
            "copy it from the benchmark's scene",
            PARAMETERS,
        )
    return read_hci_config(path).calibration


def read_seconds(estimate: Path | str) -> float:
    """How long an estimate took.

    Args:
        estimate: Disparity map or folder of results. The time is that of the phase ``run`` in the
            ``summary.json`` beside the map, or the number in ``../runtimes/NAME.txt`` of a
            benchmark submission.

    Raises:
        MissingFile: If it is not recorded.
        InputError: If the record is damaged.

    Example:
        >>> import tempfile
        >>> folder = Path(tempfile.mkdtemp())
        >>> _ = (folder / "summary.json").write_text('{"seconds": {"run": 1.5}}')
        >>> read_seconds(folder)
        1.5
    """
    estimate = Path(estimate)
    folder = estimate if estimate.is_dir() else estimate.parent
    submitted = folder.parent / "runtimes" / f"{estimate.stem}.txt"
    summary = folder / "summary.json"
    path = submitted if folder.name == "disp_maps" else summary
    if not path.is_file():
        raise MissingFile(
            f"{path}: there is no such file, so the runtime is not known; "
            "pass the folder that occjax estimate wrote",
            path.name,
        )
    with reading(path):
        text = path.read_text(encoding="utf-8", errors="replace")
    try:
        seconds = float(json.loads(text)["seconds"]["run"] if path == summary else text)
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: does not say how many seconds it took; remove it") from error
    if not 0.0 <= seconds < float("inf"):
        raise InputError(f"{path}: {seconds:g} is no number of seconds; remove it")
    return seconds
