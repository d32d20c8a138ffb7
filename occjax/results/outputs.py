"""The folder of files that an estimate is written to.

==========================  ====================================================================
``disparity.pfm``           maps: disparity, pixels per view step, in the exchange format of this
                            field
``disparity.npy``           maps: the same, ``[H, W]`` float32
``confidence.npy``          maps: confidence in [0, 1], ``[H, W]`` float32
``standard_deviation.npy``  maps: standard deviation, ``[H, W]`` float32, pixels per view step
``depth.npy``               maps: ``[H, W]`` float32 metres, if the light field is calibrated
``ground_truth.npy``        maps: ``[H, W]`` float32 true disparity, if the light field has it
``centre.png``              maps: the view that was estimated, usually the centre view, in 8 bits
``disparity_picture.png``   pictures: disparity in colours; pixels without signal are grey
``confidence.png``          pictures: confidence in colours
``error.png``               pictures: signed error, if there is ground truth
``points.ply``              cloud: coloured points, in metres if calibrated, else in pixels, of the
                            pixels with signal (:func:`has_signal`)
``comparison.png``          figures: centre view, ground truth, estimate and error next to each
                            other, with colour bars
``occlusion.npy``           occlusion: ``[V, U, H, W]`` float16 occlusion map of each view
``occlusion.png``           occlusion: the same as a figure
``stages.npy``              stages: ``[S, H, W]`` float32 disparity after each stage, if there are
                            several
``views.npz``, ``views/``   maps of all views, if they were estimated, see
                            :mod:`occjax.results.view_maps`
``views.ply``               points that several of these maps agree on
``summary.json``            settings, scores and timings, see :mod:`occjax.results.summary`
==========================  ====================================================================

The word before the colon is the group (:data:`occjax.results.groups.GROUPS`) by which
:class:`OutputOptions` chooses files.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from occjax.errors import InputError, nearest
from occjax.estimators.protocol import Estimate
from occjax.evaluation.metrics import BAD_PIXEL_THRESHOLD, Metrics, compare
from occjax.io.atomic import atomic_folder
from occjax.io.maps import SUMMARY, Map
from occjax.io.pfm import write_pfm
from occjax.lightfield import LightField, to_unit_float
from occjax.results.conversion import convert_map, flying_pixels, point_cloud, write_points
from occjax.results.groups import DEFAULT_GROUPS, GROUPS
from occjax.results.summary import summary
from occjax.results.view_maps import ARRAYS, CLOUD, FOLDER, write_view_maps
from occjax.viz.pictures import (
    confidence_picture,
    disparity_picture,
    error_picture,
    save_picture,
    view_picture,
)

FILES = tuple(
    sorted([*(name for names in GROUPS.values() for name in names), ARRAYS, CLOUD, SUMMARY])
)
"""All file names that an estimate may be written to."""

MIN_CONFIDENCE = 1e-3
"""Confidence that is zero up to rounding, below which all candidates are equally probable. It is no
setting: :class:`OutputOptions` has the one that chooses among usable pixels."""


@dataclass(frozen=True)
class OutputOptions:
    """What is written.

    Attributes:
        save: Groups of files, some of :data:`occjax.results.groups.GROUPS`.
        min_confidence: Confidence in [0, 1] below which a pixel has no point in the cloud; flying
            pixels then have none either. None for the points of all pixels with signal.
    """

    save: tuple[str, ...] = DEFAULT_GROUPS
    min_confidence: float | None = None

    def __post_init__(self) -> None:
        """Check the names and the confidence."""
        if not self.save:
            raise InputError(f"nothing to save; pass all or some of {', '.join(GROUPS)}")
        for name in self.save:
            if name not in GROUPS:
                raise InputError(f"{name!r} is no group of files; {nearest(name, GROUPS)}")
        if self.min_confidence is not None and not 0.0 <= self.min_confidence <= 1.0:
            raise InputError(f"min_confidence is {self.min_confidence:g}; pass 0 to 1")


def output_options(save: str | tuple[str, ...], min_confidence: float | None) -> OutputOptions:
    """Return the options of the command line and of :meth:`Estimate.save`.

    Args:
        save: Names of groups, or ``"all"``, as a tuple or separated by commas.
        min_confidence: See :class:`OutputOptions`.

    Raises:
        InputError: If there is no name or an unknown one, or the confidence is outside [0, 1].

    Example:
        >>> output_options("maps, cloud", None).save
        ('maps', 'cloud')
    """
    listed = save.split(",") if isinstance(save, str) else save
    names = tuple(name.strip() for name in listed if name.strip())
    return OutputOptions(tuple(GROUPS) if "all" in names else names, min_confidence)


@dataclass(frozen=True)
class Outputs:
    """The files that were written.

    Attributes:
        folder: The folder of the scene.
        paths: The files that were written now, in alphabetical order.
        notes: Notes of the estimate, and assumptions of the files, in sentences for the user.
        metrics: Comparison with the ground truth, if there is one.
    """

    folder: Path
    paths: tuple[Path, ...]
    notes: tuple[str, ...]
    metrics: Metrics | None


def write_outputs(
    estimate: Estimate,
    light_field: LightField,
    folder: str | Path,
    options: OutputOptions | None = None,
    *,
    command: str | None = None,
    settings: Mapping[str, Any] | None = None,
) -> Outputs:
    """Write an estimate as files, all of them or none.

    Args:
        estimate: Result of an estimator.
        light_field: The light field that was estimated.
        folder: Folder to write. In an existing folder the files of the table at the top of this
            module are replaced, or removed if they are not written now; other files are kept.
        options: What is written; None for the default.
        command: The command line, for ``summary.json``.
        settings: What the estimate was made from, for ``summary.json``.

    Returns:
        The files that were written, with notes and scores.

    Raises:
        InputError: If the folder cannot be written.

    Example:
        >>> import tempfile
        >>> flat, wall = np.ones((8, 8), np.float32), LightField(np.zeros((3, 3, 8, 8), np.uint8))
        >>> estimate = Estimate(flat, flat, flat, (0.0, 2.0), "mine")
        >>> outputs = write_outputs(estimate, wall, tempfile.mkdtemp(), OutputOptions(("cloud",)))
        >>> [path.name for path in outputs.paths]
        ['points.ply', 'summary.json']
    """
    folder, options = Path(folder), options or OutputOptions()
    metrics = compare(estimate.disparity, light_field.ground_truth)
    signal = has_signal(light_field, estimate.confidence)
    in_cloud = cloud_mask(estimate, signal, options.min_confidence)
    file_notes = _notes(light_field, metrics, signal, in_cloud, options)
    notes = (*estimate.notes, *file_notes)
    maps_of_views = (path.relative_to(folder).as_posix() for path in folder.glob(f"{FOLDER}/*.pfm"))
    with atomic_folder(folder, owned=(*FILES, *maps_of_views), marker=SUMMARY) as temporary:
        if "maps" in options.save:
            _write_maps(estimate, light_field, temporary)
        if "pictures" in options.save:
            _write_pictures(estimate, light_field, metrics, signal, temporary)
        if "cloud" in options.save:
            cloud = point_cloud(Map(estimate.disparity, "disparity"), light_field.calibration)
            path = temporary / "points.ply"
            write_points(path, cloud, centre=light_field.centre, mask=in_cloud)
        if "figures" in options.save:
            _write_comparison(estimate, light_field, metrics, signal, temporary)
        if "occlusion" in options.save and estimate.occlusion is not None:
            from occjax.viz.canvas import save  # drawing imports most of Matplotlib
            from occjax.viz.figures import occlusion_figure

            np.save(temporary / "occlusion.npy", estimate.occlusion.astype(np.float16))
            save(occlusion_figure(estimate.occlusion), temporary / "occlusion.png")
        if "stages" in options.save and len(estimate.stages) > 1:
            np.save(temporary / "stages.npy", np.asarray(estimate.stages, np.float32))
        if estimate.views is not None:
            write_view_maps(estimate.views, light_field, temporary)
        content = summary(estimate, light_field, metrics, notes, command)
        content["file_notes"] = file_notes
        files = (path for path in temporary.rglob("*") if path.is_file())
        content["files"] = sorted(path.relative_to(temporary).as_posix() for path in files)
        content["settings"] = settings
        text = json.dumps(content, indent=2)
        (temporary / SUMMARY).write_text(text + "\n", encoding="utf-8")
    if estimate.views is None:  # An earlier estimate may have left the folder of all views.
        shutil.rmtree(folder / FOLDER, ignore_errors=True)
    names = sorted([*content["files"], SUMMARY])
    return Outputs(folder, tuple(folder / name for name in names), notes, metrics)


def has_signal(light_field: LightField, confidence: np.ndarray) -> np.ndarray:
    """Find the pixels at which disparity can be measured at all.

    A pixel has no signal if the centre view is black there (below half a step of 8 bits in every
    channel), as in the corners of a camera's vignetted views, or if its confidence is below
    :data:`MIN_CONFIDENCE`.

    Args:
        light_field: The light field that was estimated.
        confidence: ``[H, W]`` in [0, 1].

    Returns:
        ``[H, W]`` booleans.
    """
    lit = to_unit_float(light_field.centre).max(axis=-1) >= 0.5 / 255.0
    return lit & ~(confidence < MIN_CONFIDENCE)


def cloud_mask(estimate: Estimate, signal: np.ndarray, min_confidence: float | None) -> np.ndarray:
    """Find the pixels that have a point in the cloud.

    Args:
        estimate: The estimate.
        signal: ``[H, W]`` pixels with signal (:func:`has_signal`).
        min_confidence: See :class:`OutputOptions`.

    Returns:
        ``[H, W]`` booleans.
    """
    if min_confidence is None:
        return signal
    certain = estimate.confidence >= min_confidence
    return signal & certain & ~flying_pixels(estimate.disparity)


def _notes(
    light_field: LightField,
    metrics: Metrics | None,
    signal: np.ndarray,
    in_cloud: np.ndarray,
    options: OutputOptions,
) -> list[str]:
    """Return the assumptions of the files, as sentences for the user."""
    notes = []
    if light_field.calibration is None and "cloud" in options.save:
        notes.append(
            "no calibration: the points in points.ply are in pixels and their depth has no true "
            "scale; depth.npy is not written (--focal-length-mm, --sensor-mm, --baseline-mm and "
            "--focus-m describe the camera)"
        )
    if not signal.all() and "cloud" in options.save:
        notes.append(
            f"points.ply leaves out {np.sum(~signal)} of {signal.size} pixels without signal "
            f"(centre view black, or confidence below {MIN_CONFIDENCE:g})"
        )
    if options.min_confidence is not None and "cloud" in options.save:
        notes.append(
            f"points.ply leaves out {np.sum(signal & ~in_cloud)} of {signal.size} pixels of "
            f"confidence below {options.min_confidence:g} or between two surfaces"
        )
    if light_field.ground_truth is not None and metrics is None:
        notes.append("the ground truth has no finite value to compare with")
    return notes


def _write_maps(estimate: Estimate, light_field: LightField, folder: Path) -> None:
    """Write disparity, confidence, and depth if it is known, of all pixels."""
    disparity = np.asarray(estimate.disparity, np.float32)
    write_pfm(folder / "disparity.pfm", disparity)
    np.save(folder / "disparity.npy", disparity)
    np.save(folder / "confidence.npy", np.asarray(estimate.confidence, np.float32))
    deviation = np.asarray(estimate.standard_deviation, np.float32)
    np.save(folder / "standard_deviation.npy", deviation)
    save_picture(view_picture(light_field.centre), folder / "centre.png")
    if light_field.ground_truth is not None:
        np.save(folder / "ground_truth.npy", np.asarray(light_field.ground_truth, np.float32))
    if light_field.calibration is not None:
        content = Map(estimate.disparity, "disparity")
        depth = convert_map(content, "depth", light_field.calibration).values
        np.save(folder / "depth.npy", depth.astype(np.float32))


def _write_pictures(
    estimate: Estimate,
    light_field: LightField,
    metrics: Metrics | None,
    signal: np.ndarray,
    folder: Path,
) -> None:
    """Write the maps in colours, without axes."""
    disparity, confidence, truth = estimate.disparity, estimate.confidence, light_field.ground_truth
    shown, certain = (np.where(signal, values, np.nan) for values in (disparity, confidence))
    picture = disparity_picture(shown, confidence=confidence, ground_truth=truth)
    save_picture(picture, folder / "disparity_picture.png")
    save_picture(confidence_picture(certain), folder / "confidence.png")
    if metrics is not None and truth is not None:
        save_picture(error_picture(disparity, truth), folder / "error.png")


def _write_comparison(
    estimate: Estimate,
    light_field: LightField,
    metrics: Metrics | None,
    signal: np.ndarray,
    folder: Path,
) -> None:
    """Write the estimate next to the centre view and, if there is one, the ground truth."""
    from occjax.viz.canvas import save
    from occjax.viz.figures import comparison_figure

    truth, score, border = None, "", 0
    if metrics is not None and light_field.ground_truth is not None:
        truth, border = light_field.ground_truth, metrics.border
        score = f"BadPix {BAD_PIXEL_THRESHOLD:g}: {metrics.badpix[BAD_PIXEL_THRESHOLD]:.2f} %"
    figure = comparison_figure(
        light_field.centre,
        estimate.disparity,
        truth,
        confidence=estimate.confidence,
        hidden=~signal,
        score=score,
        border=border,
    )
    save(figure, folder / "comparison.png")
