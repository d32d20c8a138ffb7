"""Reading of the folder of files that an estimate was written to."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from occjax.errors import InputError
from occjax.estimators.protocol import Estimate
from occjax.io.arrays import read_npy
from occjax.io.images import read_image
from occjax.io.maps import SUMMARY, map_of_results, read_map
from occjax.lightfield import LightField, centre_index, view_name
from occjax.results.outputs import cloud_mask, has_signal
from occjax.results.summary import read_summary, stored_calibration
from occjax.results.view_maps import read_view_maps


def read_estimate(folder: str | Path, light_field: LightField | None = None) -> Estimate:
    """Read an estimate; see :meth:`occjax.estimators.Estimate.load`.

    Args:
        folder: Folder that :func:`occjax.results.outputs.write_outputs` has written, with the group
            ``maps``.
        light_field: The light field that was estimated, if you have it.

    Returns:
        The estimate. What was not saved is None; an unknown standard deviation is NaN.

    Raises:
        InputError: If the folder has no disparity map or no summary, a file is damaged, or the
            light field has another size or is around another view.

    Example:
        >>> import tempfile
        >>> from occjax.results import write_outputs
        >>> flat, wall = np.ones((8, 8), np.float32), LightField(np.zeros((3, 3, 8, 8), np.uint8))
        >>> estimate = Estimate(flat, flat, flat, (0.0, 2.0), "mine")
        >>> outputs = write_outputs(estimate, wall, tempfile.mkdtemp())
        >>> read_estimate(outputs.folder).disparity_range
        (0.0, 2.0)
    """
    folder = Path(folder)
    disparity = read_map(map_of_results(folder)).values
    summary = read_summary(folder / SUMMARY)

    def optional(name: str) -> np.ndarray | None:
        path = folder / name
        if not path.is_file():
            return None
        array = read_npy(path)
        if array.shape[-2:] != disparity.shape:
            raise InputError(
                f"{path}: is {list(array.shape)} but disparity.pfm is {list(disparity.shape)}; "
                "estimate again"
            )
        return array.astype(np.float32)

    deviation, confidence = optional("standard_deviation.npy"), optional("confidence.npy")
    unknown = np.full_like(disparity, np.nan)
    stages = optional("stages.npy")
    file_notes = summary.get("file_notes", ())  # older folders have none
    if light_field is None:
        light_field = _stored_light_field(folder, summary, optional("ground_truth.npy"))
    elif light_field.image_size != disparity.shape:
        raise InputError(
            f"{folder}: has a map of {list(disparity.shape)} pixels, but the views of "
            f"{light_field.name} are {list(light_field.image_size)}; pass the light field that was "
            "estimated"
        )
    elif (own := view_name(summary.get("view"))) != (other := view_name(light_field.view)):
        raise InputError(
            f"{folder}: is of the {own}, but the light field {light_field.name} is around the "
            f"{other}; pass results of the {other}"
        )
    return Estimate(
        disparity=disparity,
        confidence=unknown if confidence is None else confidence,
        standard_deviation=unknown if deviation is None else deviation,
        disparity_range=tuple(summary["searched_disparity_range"]),
        model=summary["model"],
        weights=summary["weights"],
        coarse=None if stages is None else stages[0],
        stages=() if stages is None else tuple(stages),
        occlusion=optional("occlusion.npy"),
        notes=tuple(note for note in summary["notes"] if note not in file_notes),
        seconds=summary["seconds"],
        light_field=light_field,
        views=read_view_maps(folder),
    )


def stored_cloud(folder: Path) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Return the colours and the pixels of the point cloud that an estimate has written.

    Args:
        folder: As :func:`read_estimate`.

    Returns:
        ``[H, W, 3]`` centre view and ``[H, W]`` booleans; None and None for the colourless points
        of all pixels if the folder has no centre view.
    """
    estimate = read_estimate(folder) if (folder / SUMMARY).is_file() else None
    if estimate is None or estimate.light_field is None:
        return None, None
    options = (read_summary(folder / SUMMARY).get("settings") or {}).get("options", {})
    signal = has_signal(estimate.light_field, estimate.confidence)
    mask = cloud_mask(estimate, signal, options.get("min_confidence"))
    return estimate.light_field.centre, mask


def _stored_light_field(
    folder: Path, summary: dict[str, Any], ground_truth: np.ndarray | None
) -> LightField | None:
    """Return the stored part of the light field, which older folders do not have.

    Only the centre view is usable. The other views cost no memory, because their zeros are never
    read or written.
    """
    if not (folder / "centre.png").is_file():
        return None
    grid, image_size = tuple(summary["grid"]), tuple(summary["image_size"])
    views = np.zeros((*grid, *image_size, 3), np.uint8)
    views[centre_index(grid)] = read_image(folder / "centre.png")
    usable = np.zeros(grid, bool)
    usable[centre_index(grid)] = True
    return LightField(
        views,
        name=summary["scene"],
        calibration=stored_calibration(summary),
        ground_truth=ground_truth,
        usable=usable,
        source=None if summary["source"] is None else Path(summary["source"]),
        view=tuple(summary["view"]) if summary.get("view") else None,  # older folders have none
    )
