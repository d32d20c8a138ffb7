"""All measures of the HCI 4D benchmark, by name, for a scene's folder and an estimate.

===============================  ============================================================
``mse_x100``                     mean squared error, times 100
``badpix_0.07`` …                % of pixels whose error is above a threshold (any number)
``q25_x100``                     largest error of the best quarter of the pixels, times 100
``runtime``                      seconds

*photorealistic scenes*
``discontinuities``              BadPix 0.07 in ``discontinuities``, and mean squared error
``discontinuities_mse_x100``     there, times 100
``bumpiness_planes``             bumpiness of the error, times 100, in ``planes`` and in
``bumpiness_smooth``             ``smooth_surfaces``
``normals_planes_median``        angle between estimated and true normal in ``planes``, in
``normals_planes_mean``          degrees
``normals_smooth_median``        the same in ``smooth_surfaces``
``normals_smooth_mean``
``fine_fattening``               % estimated too near by 0.15 in ``fine_surrounding``
``fine_thinning``                % estimated too far by 0.15 in ``fine``

*stratified scenes*
``backgammon_fattening``         % closer to the foreground in ``foreground_fattening``
``backgammon_thinning``          % closer to the background in ``foreground_thinning``
``dots_missed``                  % of the dots in ``dots_by_size`` with BadPix 0.4 above 50 %
``dots_background_mse_x100``     mean squared error in ``background``, times 100
``pyramids_bumpiness_slanted``   bumpiness, times 100, in ``pyramids``, ``sphere_in`` and
``pyramids_bumpiness_parallel``  ``sphere_out``, and in ``plane``
``stripes_low_texture``          BadPix 0.07 in ``low_texture``,
``stripes_dark``                 in ``high_contrast``
``stripes_bright``               and in ``low_contrast``
===============================  ============================================================

Names such as ``planes`` are regions; :mod:`occjax.evaluation.scene_files` says in which files they
are. Lower is better everywhere. The benchmark evaluates some stratified scenes at ten times the
resolution; here everything is measured at the resolution of the estimate. Of the dots it counts
those that are numbered 1 to 8 in ``dots_by_size``, here all count.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import reduce
from pathlib import Path

import numpy as np

from occjax.errors import InputError
from occjax.evaluation.files import read_disparity
from occjax.evaluation.metrics import (
    BORDER,
    THRESHOLDS,
    bad_pix,
    compared_pixels,
    mean_squared_error,
    q25,
)
from occjax.evaluation.normals import angular_errors
from occjax.evaluation.regions import (
    bumpiness,
    fattening,
    foreground_fattening,
    foreground_thinning,
    missed_dots,
    thinning,
)
from occjax.evaluation.scene_files import (
    GROUND_TRUTH,
    MissingFile,
    read_calibration,
    read_mask,
    read_seconds,
)
from occjax.io.pfm import read_pfm

BADPIX = "badpix_"

BAD = 0.07
"""Threshold of BadPix in a region, in pixels per view step."""


@dataclass(frozen=True)
class SceneScores:
    """Measures of one estimate of one scene.

    Attributes:
        scene: Name of the scene's folder.
        values: By name of the measure, in the order of the table above; lower is better.
        missing: Why the other measures are not there: by name, the file that the scene lacks or
            what is wrong with it.
        border: Pixels left out at each side of the image.
    """

    scene: str
    values: dict[str, float]
    missing: dict[str, str]
    border: int

    def as_dict(self) -> dict[str, object]:
        """The same for JSON."""
        return {
            "scene": self.scene,
            "metrics": self.values,
            "not_measured": self.missing,
            "border": self.border,
        }

    def table(self) -> str:
        """A table for people: one measure a line, then what could not be measured, by file."""
        width = max(len(name) for name in ("", *self.values))
        lines = [
            f"{name:<{width}}  {value:9.3f} {_unit(name)}" for name, value in self.values.items()
        ]
        if self.missing:
            lines += ["", "not measured, for want of"]
            lacking: dict[str, list[str]] = {}
            for name, file in self.missing.items():
                lacking.setdefault(file, []).append(name)
            width = max(len(file) for file in lacking)
            lines += [f"  {file:<{width}}  {', '.join(names)}" for file, names in lacking.items()]
        return "\n".join(line.rstrip() for line in lines)


def evaluate_scene(
    scene: Path | str,
    estimate: Path | str,
    *,
    names: tuple[str, ...] | None = None,
    thresholds: tuple[float, ...] = THRESHOLDS,
    border: int = BORDER,
) -> SceneScores:
    """Measures of an estimate in the regions of its scene.

    Args:
        scene: Folder of the scene, with ``gt_disp_lowres.pfm`` and masks.
        estimate: Estimated disparity, pixels per view step: a PFM or NPY file, or a folder of
            results.
        names: Which measures; see the table above. None takes all that the scene has files for.
        thresholds: Thresholds of BadPix, in pixels per view step, where no names are given.
        border: Pixels left out at each side of the image.

    Returns:
        The measures. ``missing`` is empty where names are given.

    Raises:
        InputError: If there is no such measure, a file cannot be read, the maps cannot be compared,
            or what a measure needs is missing that was asked for by name.
    """
    folder = Path(scene)
    chosen = metric_names(thresholds) if names is None else names
    measures = {name: _measure(name) for name in chosen}
    comparison = _read(folder, Path(estimate), border)
    values: dict[str, float] = {}
    missing: dict[str, str] = {}
    for name, measure in measures.items():
        try:
            values[name] = measure(comparison)
        except MissingFile as error:
            if names is not None:
                raise InputError(f"{name} cannot be measured: {error}") from error
            missing[name] = error.missing
        except InputError as error:
            raise InputError(f"{name} of {estimate} cannot be measured: {error}") from error
    return SceneScores(folder.resolve().name, values, missing, border)


def metric_names(thresholds: tuple[float, ...] = THRESHOLDS) -> tuple[str, ...]:
    """Names of all measures, those of BadPix at some thresholds.

    Example:
        >>> metric_names((0.07,))[:4]
        ('mse_x100', 'badpix_0.07', 'q25_x100', 'runtime')
    """
    badpix = tuple(f"{BADPIX}{threshold:g}" for threshold in thresholds)
    first, *others = _MEASURES
    return (first, *badpix, *others)


@dataclass(frozen=True, eq=False)
class _Comparison:
    """An estimate of a scene, and what the scene's folder holds."""

    folder: Path
    path: Path
    estimate: np.ndarray
    truth: np.ndarray
    border: int
    masks: dict[str, np.ndarray] = field(default_factory=dict)

    def mask(self, *names: str) -> np.ndarray:
        """Union of regions, each of them there and with a pixel to compare."""
        return reduce(np.logical_or, [self._region(name) for name in names])

    def _region(self, name: str) -> np.ndarray:
        if name not in self.masks:
            mask = read_mask(self.folder, name, self.truth.shape)
            h, w = self.truth.shape
            inside = np.s_[self.border : h - self.border, self.border : w - self.border]
            if not (mask & np.isfinite(self.truth))[inside].any():
                lack = f"a pixel within the border in the mask of {name}"
                raise MissingFile(f"{self.folder}: has not {lack}; choose another measure", lack)
            self.masks[name] = mask
        return self.masks[name]

    def score(self, measure: Callable[..., float], *regions: str, **options: object) -> float:
        """A measure in the union of regions, everywhere if none is named."""
        mask = self.mask(*regions) if regions else None
        return measure(self.estimate, self.truth, border=self.border, mask=mask, **options)

    def angles(self, average: Callable[..., float], region: str) -> float:
        """An average of the angles between normals in a region."""
        calibration = read_calibration(self.folder)
        mask = self.mask(region)
        return float(
            average(
                angular_errors(
                    self.estimate, self.truth, calibration, border=self.border, mask=mask
                )
            )
        )

    def layers(self, measure: Callable[..., float], region: str) -> float:
        """A measure that tells the foreground from the background."""
        mask = self.mask(region)
        sides = {name: self.mask(name) for name in ("foreground", "background")}
        return measure(self.estimate, self.truth, border=self.border, mask=mask, **sides)

    def dots(self) -> float:
        """Percentage of missed dots."""
        dots = self.mask("dots_by_size")
        return missed_dots(self.estimate, self.truth, dots, border=self.border)

    def behind_dots(self) -> float:
        """Mean squared error behind the dots; other scenes have a background too."""
        self.mask("dots_by_size")
        return self.score(mean_squared_error, "background")


_Measure = Callable[[_Comparison], float]

_MEASURES: dict[str, _Measure] = {
    "mse_x100": lambda c: 100.0 * c.score(mean_squared_error),
    "q25_x100": lambda c: 100.0 * c.score(q25),
    "runtime": lambda c: read_seconds(c.path),
    "discontinuities": lambda c: c.score(bad_pix, "discontinuities", threshold=BAD),
    "discontinuities_mse_x100": lambda c: 100.0 * c.score(mean_squared_error, "discontinuities"),
    "bumpiness_planes": lambda c: 100.0 * c.score(bumpiness, "planes"),
    "bumpiness_smooth": lambda c: 100.0 * c.score(bumpiness, "smooth_surfaces"),
    "normals_planes_median": lambda c: c.angles(np.median, "planes"),
    "normals_planes_mean": lambda c: c.angles(np.mean, "planes"),
    "normals_smooth_median": lambda c: c.angles(np.median, "smooth_surfaces"),
    "normals_smooth_mean": lambda c: c.angles(np.mean, "smooth_surfaces"),
    "fine_fattening": lambda c: c.score(fattening, "fine_surrounding"),
    "fine_thinning": lambda c: c.score(thinning, "fine"),
    "backgammon_fattening": lambda c: c.layers(foreground_fattening, "foreground_fattening"),
    "backgammon_thinning": lambda c: c.layers(foreground_thinning, "foreground_thinning"),
    "dots_missed": _Comparison.dots,
    "dots_background_mse_x100": lambda c: 100.0 * c.behind_dots(),
    "pyramids_bumpiness_slanted": lambda c: (
        100.0 * c.score(bumpiness, "pyramids", "sphere_in", "sphere_out")
    ),
    "pyramids_bumpiness_parallel": lambda c: 100.0 * c.score(bumpiness, "plane"),
    "stripes_low_texture": lambda c: c.score(bad_pix, "low_texture", threshold=BAD),
    "stripes_dark": lambda c: c.score(bad_pix, "high_contrast", threshold=BAD),
    "stripes_bright": lambda c: c.score(bad_pix, "low_contrast", threshold=BAD),
}


def _measure(name: str) -> _Measure:
    """What a name stands for."""
    if name in _MEASURES:
        return _MEASURES[name]
    try:
        threshold = float(name.removeprefix(BADPIX)) if name.startswith(BADPIX) else math.nan
    except ValueError:
        threshold = math.nan
    if math.isnan(threshold):
        raise InputError(f"there is no measure {name!r}; there are {', '.join(metric_names())}")
    return lambda comparison: comparison.score(bad_pix, threshold=threshold)


def _unit(name: str) -> str:
    """Unit of a measure, in the table."""
    if name == "runtime":
        return "s"
    if name.startswith("normals"):
        return "degrees"
    return "" if "mse" in name or "q25" in name or "bumpiness" in name else "%"


def _read(folder: Path, estimate: Path, border: int) -> _Comparison:
    """Both maps, which must fit each other."""
    truth_path = folder / GROUND_TRUTH
    truth = read_pfm(truth_path)
    estimated = read_disparity(estimate)
    try:
        compared_pixels(estimated, truth, border=border)
    except InputError as error:
        raise InputError(f"{estimate} against {truth_path}: {error}") from None
    return _Comparison(folder, estimate, estimated, truth, border)
