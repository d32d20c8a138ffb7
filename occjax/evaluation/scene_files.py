"""Files of an HCI 4D benchmark scene that the evaluation reads.

``gt_disp_lowres.pfm`` is the ground truth and ``parameters.cfg`` the calibration. The mask of a
region NAME is the first of these images that exists; pixels that are not black belong to it:

* ``mask_NAME_lowres.png`` or ``mask_NAME.png`` of the benchmark;
* ``masks/NAME.png`` of a rendered scene;
* ``mask_NAME_highres.png`` of the benchmark, sampled at the middle of each pixel.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from occjax.errors import InputError
from occjax.io.files import decoding
from occjax.io.hci_config import GROUND_TRUTH, PARAMETERS, read_hci_config
from occjax.io.images import read_image
from occjax.io.maps import SUMMARY
from occjax.lightfield import Calibration

MASK_FILES = ("mask_{}_lowres.png", "mask_{}.png", "masks/{}.png", "mask_{}_highres.png")


class MissingFileError(InputError):
    """A scene does not have a file, or content of a file, that a measure needs.

    Attributes:
        missing: Name of the file, or description of the missing content.
    """

    def __init__(self, message: str, missing: str) -> None:
        super().__init__(message)
        self.missing = missing


def is_scene(path: Path | str) -> bool:
    """Return whether a path is the folder of a scene with ground truth.

    Args:
        path: File or folder; need not exist.

    Returns:
        True if it is a folder with a ``gt_disp_lowres.pfm``.

    Example:
        >>> is_scene("estimate.pfm")
        False
    """
    return (Path(path) / GROUND_TRUTH).is_file()


def read_mask(folder: Path | str, name: str, size: tuple[int, int]) -> np.ndarray:
    """Read the mask of a region of a scene.

    Args:
        folder: Folder of the scene.
        name: Name of the region, such as ``planes``.
        size: ``(H, W)`` of the scene's disparity map.

    Returns:
        ``[H, W]`` boolean, True inside the region.

    Raises:
        MissingFileError: If the scene has no such mask.
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
        expected = MASK_FILES[0].format(name)
        raise MissingFileError(
            f"{folder / expected}: there is no such mask and no {MASK_FILES[2].format(name)}; "
            "copy it from the benchmark's scene",
            expected,
        )
    mask = read_image(path).any(axis=-1)
    factor = max(1, mask.shape[0] // size[0])
    if mask.shape != (factor * size[0], factor * size[1]):
        raise InputError(
            f"{path}: is {list(mask.shape)}, but the disparity is {list(size)}; "
            "a mask must have the same size or a whole multiple of it"
        )
    return mask[factor // 2 :: factor, factor // 2 :: factor]


def read_calibration(folder: Path | str) -> Calibration:
    """Read the camera parameters of a scene.

    Raises:
        MissingFileError: If the folder has no ``parameters.cfg``.
        InputError: If that file is damaged.
    """
    path = Path(folder) / PARAMETERS
    if not path.is_file():
        raise MissingFileError(
            f"{path}: there is no such file, but normals need the camera's calibration; "
            "copy it from the benchmark's scene",
            PARAMETERS,
        )
    return read_hci_config(path).calibration


def read_seconds(estimate: Path | str) -> float:
    """Read the run time of an estimate, in seconds.

    For a map ``disp_maps/NAME.pfm`` of a benchmark submission, it is the number in
    ``runtimes/NAME.txt`` next to ``disp_maps``; for other maps, that of the phase ``run`` in the
    ``summary.json`` in the folder of the map.

    Args:
        estimate: Disparity map or folder of results.

    Raises:
        MissingFileError: If the time is not recorded.
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
    submitted = folder.name == "disp_maps"
    if submitted:
        path = folder.parent / "runtimes" / f"{estimate.stem}.txt"
        advice = "write the seconds of the scene to it"
    else:
        path, advice = folder / SUMMARY, "pass the folder that occjax estimate wrote"
    if not path.is_file():
        raise MissingFileError(
            f"{path}: there is no such file, so the run time is unknown; {advice}", path.name
        )
    with decoding(path, "a record of run times", remedy="remove the file", max_bytes=2**24) as file:
        text = file.read()
        seconds = float(text if submitted else json.loads(text)["seconds"]["run"])
    if not 0.0 <= seconds < float("inf"):
        raise InputError(f"{path}: {seconds:g} is not a run time in seconds; remove the file")
    return seconds
