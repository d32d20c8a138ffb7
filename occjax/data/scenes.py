"""Light fields with ground truth, read from folders and held in memory."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from occjax.data.samples import LightFieldSample, numpy_sample
from occjax.errors import InputError
from occjax.io import load, read_image
from occjax.io.files import read_errors
from occjax.io.hci_config import GROUND_TRUTH
from occjax.lightfield import to_unit_float
from occjax.view_selection import ViewSelection, select_from_grid

MASK = "mask.png"
"""Optional image in a scene's folder: ground truth is ignored where the image is not black."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A light field to draw patches from.

    Attributes:
        name: Name of its folder.
        views: ``[v, u, h, w, c]`` uint8.
        offsets: ``[v, u, 2]`` float32 offset (row, column) of each view from the centre view.
        disparity: ``[h, w]`` float32 ground truth of the centre view; 0 where it is unknown.
        valid: ``[h, w]`` pixels whose ground truth is known and not masked.
        masked: Whether the folder has a mask.
    """

    name: str
    views: np.ndarray
    offsets: np.ndarray
    disparity: np.ndarray
    valid: np.ndarray
    masked: bool

    def grey(self, patch: tuple[slice, slice], weights: np.ndarray) -> np.ndarray:
        """Return a patch of all views in grey.

        Args:
            patch: Rows and columns.
            weights: ``[3]`` positive weights of red, green and blue, of any sum; ignored if the
                views are grey.

        Returns:
            ``[v, u, rows, columns]`` float32 in [0, 1].
        """
        cut = self.views[(slice(None), slice(None), *patch)].astype(np.float32)
        if cut.shape[-1] == 1:
            return cut[..., 0] / np.float32(255.0)
        return cut @ (weights / (255.0 * weights.sum())).astype(np.float32)

    def sample(
        self, window: tuple[slice, slice] = (slice(None), slice(None)), *, weights: np.ndarray
    ) -> LightFieldSample:
        """Return a window as a training example of NumPy arrays.

        Args:
            window: Rows and columns; all by default.
            weights: ``[3]`` weights of red, green and blue, see :meth:`grey`.
        """
        return numpy_sample(
            views=self.grey(window, weights=weights),
            offsets=self.offsets,
            disparity=self.disparity[window],
            valid=self.valid[window],
        )

    def checksum(self) -> int:
        """Return a number that changes with the views or the ground truth."""
        checksum = 0
        for array in (self.views, self.disparity, self.valid):
            checksum = zlib.crc32(np.ascontiguousarray(array).data, checksum)
        return checksum


def load_scenes(folders: Sequence[str | Path], *, views: ViewSelection = "all") -> list[Scene]:
    """Read scenes with ground truth, as :func:`occjax.load` reads light fields.

    Args:
        folders: Folders of scenes (views, ``gt_disp_lowres.pfm`` and optionally ``mask.png``), or
            folders that contain such folders.
        views: The views to keep.

    Returns:
        The scenes, ordered by path.

    Raises:
        InputError: If there is no scene, or if a scene cannot be read or has no ground truth.
    """
    found = [scene for folder in folders for scene in _find_scenes(Path(folder))]
    bar = tqdm(found, desc="scenes", unit="scene", disable=None)
    return [_read_scene(folder, views) for folder in bar]


def _find_scenes(folder: Path) -> list[Path]:
    """Return the folder itself if it is a scene, else the scenes that it contains."""
    if (folder / GROUND_TRUTH).is_file():
        return [folder]
    with read_errors(folder):
        inner = sorted(path.parent for path in folder.glob(f"*/{GROUND_TRUTH}"))
        folder.stat()  # an error if the folder is missing, in which glob finds nothing
    if not inner:
        raise InputError(
            f"{folder}: neither it nor a folder in it has {GROUND_TRUTH}, which training needs"
        )
    return inner


def _read_scene(folder: Path, views: ViewSelection) -> Scene:
    """Read one scene and convert its views to 8 bits."""
    light_field = load(folder, check_orientation=False)
    truth = light_field.ground_truth
    if truth is None:
        raise InputError(
            f"{folder}: {GROUND_TRUTH} was not read; name the view files as in the HCI benchmark"
        )
    valid = np.isfinite(truth)
    masked = (folder / MASK).is_file()
    if masked:
        mask = read_image(folder / MASK).any(axis=-1)
        if mask.shape != truth.shape:
            raise InputError(
                f"{folder / MASK}: is {list(mask.shape)} but the views are {list(truth.shape)}"
            )
        valid &= ~mask
    offsets = light_field.offsets
    indices = select_from_grid(offsets, views)
    images = light_field.views[indices]
    if images.dtype != np.uint8:
        images = np.rint(255.0 * np.clip(to_unit_float(images), 0.0, 1.0)).astype(np.uint8)
    return Scene(
        name=light_field.name,
        views=images,
        offsets=offsets[indices].astype(np.float32),
        disparity=np.where(valid, truth, 0.0).astype(np.float32),
        valid=valid,
        masked=masked,
    )
