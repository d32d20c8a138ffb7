"""Light fields with ground truth, read from folders and held in memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from occjax.data.host import numpy_sample
from occjax.data.views import Selection, select_views
from occjax.errors import InputError
from occjax.io import load, read_image
from occjax.io.files import reading
from occjax.lightfield import LightField, to_unit_float

GROUND_TRUTH = "gt_disp_lowres.pfm"
MASK = "mask.png"
"""Optional image in a scene's folder: not black where its ground truth is not to be used."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A light field to draw patches from.

    Attributes:
        name: Name of its folder.
        views: ``[v, u, h, w, c]`` uint8.
        offsets: ``[v, u, 2]`` float32 offset (row, column) of each view from the centre view.
        disparity: ``[h, w]`` float32 of the centre view; 0 where it is not known.
        valid: ``[h, w]`` where it is known and not masked.
        masked: Whether the folder has a mask.
    """

    name: str
    views: np.ndarray
    offsets: np.ndarray
    disparity: np.ndarray
    valid: np.ndarray
    masked: bool

    def grey(self, patch: tuple[slice, slice], weights: np.ndarray) -> np.ndarray:
        """A patch of all views in grey.

        Args:
            patch: Rows and columns.
            weights: ``[3]`` positive weights of red, green and blue, of any sum; of no effect on
                grey views.

        Returns:
            ``[v, u, rows, columns]`` float32 in [0, 1].
        """
        cut = self.views[(slice(None), slice(None), *patch)].astype(np.float32)
        if cut.shape[-1] == 1:
            return cut[..., 0] / np.float32(255.0)
        return cut @ (weights / (255.0 * weights.sum())).astype(np.float32)


def load_scenes(
    folders: str | Path | Sequence[str | Path], *, views: Selection = "all", progress: bool = True
) -> list[Scene]:
    """Read scenes with ground truth, as :func:`occjax.load` reads them.

    Args:
        folders: Folders of scenes (views and ``gt_disp_lowres.pfm``, maybe ``mask.png``), or
            folders that have such folders in them.
        views: Which views are kept.
        progress: Whether to show how far it is.

    Returns:
        The scenes, ordered by path.

    Raises:
        InputError: If there is none, or one cannot be read or has no ground truth.
    """
    given = [folders] if isinstance(folders, str | Path) else list(folders)
    found = [scene for folder in given for scene in _scenes_in(Path(folder))]
    return [
        _read_scene(folder, views)
        for folder in tqdm(found, desc="scenes", unit="scene", disable=not progress)
    ]


def _scenes_in(folder: Path) -> list[Path]:
    """The folder itself, or the folders in it that are scenes."""
    if (folder / GROUND_TRUTH).is_file():
        return [folder]
    with reading(folder):
        inner = sorted(path.parent for path in folder.glob(f"*/{GROUND_TRUTH}"))
        folder.stat()
    if not inner:
        raise InputError(
            f"{folder}: neither it nor a folder in it has {GROUND_TRUTH}, which training needs"
        )
    return inner


def _read_scene(folder: Path, views: Selection) -> Scene:
    """One scene, its views in 8 bits."""
    light_field = load(folder, check_orientation=False)
    truth = light_field.ground_truth
    if truth is None:
        raise InputError(f"{folder}: its {GROUND_TRUTH} was not read; name its views as HCI does")
    valid = np.isfinite(truth)
    masked = (folder / MASK).is_file()
    if masked:
        mask = read_image(folder / MASK).any(axis=-1)
        if mask.shape != truth.shape:
            raise InputError(
                f"{folder / MASK}: is {list(mask.shape)} but the views are {list(truth.shape)}"
            )
        valid &= ~mask
    kept, offsets = _selected(light_field, views)
    return Scene(
        name=light_field.name,
        views=kept,
        offsets=offsets,
        disparity=np.where(valid, truth, 0.0).astype(np.float32),
        valid=valid,
        masked=masked,
    )


def _selected(light_field: LightField, views: Selection) -> tuple[np.ndarray, np.ndarray]:
    """``[v, u, h, w, c]`` uint8 views of a selection, and their ``[v, u, 2]`` offsets."""
    images = light_field.views
    if images.dtype != np.uint8:
        images = np.rint(255.0 * np.clip(to_unit_float(images), 0.0, 1.0)).astype(np.uint8)
    v, u, h, w, c = images.shape
    offsets = light_field.positions
    if offsets is None:
        rows, columns = np.meshgrid(np.arange(v) - v // 2, np.arange(u) - u // 2, indexing="ij")
        offsets = np.stack([rows, columns], axis=-1)
    # Colours are told apart like columns of pixels, which no selection of views looks at.
    flat = images.reshape(v, u, h, w * c)
    nothing = np.zeros((h, w), np.float32)
    selected = select_views(numpy_sample(flat, offsets.astype(np.float32), nothing), views)
    kept = np.asarray(selected.views)
    return kept.reshape(*kept.shape[:3], w, c), np.asarray(selected.offsets)
