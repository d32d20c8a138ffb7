"""All error measures of the HCI 4D benchmark, by name.

===============================  ============================================================
``mse_x100``                     mean squared error, times 100
``badpix_0.07`` …                % of pixels whose error is above a threshold (any number)
``q25_x100``                     largest error of the best quarter of the pixels, times 100
``runtime``                      seconds

*photorealistic scenes*
``discontinuities``              BadPix 0.07 in ``discontinuities``
``discontinuities_mse_x100``     mean squared error, times 100, in ``discontinuities`` (not a
                                 measure of the benchmark)
``bumpiness_planes``             bumpiness of the error, times 100, in ``planes``
``bumpiness_smooth``             the same in ``smooth_surfaces``
``normals_planes_median``        angle between estimated and true normal in ``planes``, degrees
``normals_planes_mean``          mean of the same angle (not a measure of the benchmark)
``normals_smooth_median``        the same in ``smooth_surfaces``
``normals_smooth_mean``          the same in ``smooth_surfaces`` (not a measure of the benchmark)
``fine_fattening``               % too near by more than 0.15 in ``fine_surrounding``
``fine_thinning``                % too far by more than 0.15 in ``fine``

*stratified scenes*
``backgammon_fattening``         % closer to the foreground in ``foreground_fattening``
``backgammon_thinning``          % closer to the background in ``foreground_thinning``
``dots_missed``                  % of the dots in ``dots_by_size`` with BadPix 0.4 above 50 %
``dots_background_mse_x100``     mean squared error, times 100, in ``background``
``pyramids_bumpiness_slanted``   bumpiness, times 100, in ``pyramids``, ``sphere_in`` and
                                 ``sphere_out``
``pyramids_bumpiness_parallel``  the same in ``plane``
``stripes_low_texture``          BadPix 0.07 in ``low_texture``
``stripes_dark``                 BadPix 0.07 in ``high_contrast``
``stripes_bright``               BadPix 0.07 in ``low_contrast``
===============================  ============================================================

Names such as ``planes`` are regions; :mod:`occjax.evaluation.scene_files` lists their files. Lower
is better for every measure.

Some values differ from those of the benchmark's evaluation toolkit:

* The toolkit evaluates ``discontinuities``, fattening, thinning, dots and stripes at ten times the
  resolution. Here every measure uses the resolution of the estimate.
* It computes bumpiness and normals by Scharr filters. Here they are differences of neighbouring
  pixels.
* It leaves out pixels without an estimate, or does not count them as fattening or thinning. Here
  they are wrong.
* It counts the dots numbered 1 to 8 in ``dots_by_size``, and one is missed from a BadPix of 50 %
  on. Here all dots count, and one is missed above 50 %.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np

from occjax.errors import InputError, nearest
from occjax.evaluation.files import check_same_view, read_disparity
from occjax.evaluation.metrics import (
    BAD_PIXEL_THRESHOLD,
    BORDER,
    THRESHOLDS,
    Metrics,
    compared_pixels,
    evaluate,
)
from occjax.evaluation.normals import angular_errors
from occjax.evaluation.regions import bumpiness, fattening, missed_dots, wrong_layer
from occjax.evaluation.scene_files import (
    MissingFileError,
    read_calibration,
    read_mask,
    read_seconds,
)
from occjax.io.hci_config import GROUND_TRUTH
from occjax.io.pfm import read_pfm

BADPIX = "badpix_"


@dataclass(frozen=True)
class SceneScores:
    """Measures of one estimate of one scene.

    Attributes:
        scene: Name of the scene's folder.
        values: Measures by name, in the order in which they were asked for; lower is better.
        missing: For each measure that could not be computed, the missing file or content.
        border: Pixels left out on each side of the image.
    """

    scene: str
    values: dict[str, float]
    missing: dict[str, str]
    border: int

    def as_dict(self) -> dict[str, object]:
        """Return the scores as a dictionary for JSON."""
        return {
            "scene": self.scene,
            "metrics": self.values,
            "not_measured": self.missing,
            "border": self.border,
        }

    def table(self) -> str:
        """Return a text table: one measure per line, then the missing measures by file."""
        width = max(len(name) for name in ("", *self.values))
        lines = [
            f"{name:<{width}}  {value:9.3f} {_unit(name)}" for name, value in self.values.items()
        ]
        if self.missing:
            lines += ["", "not measured; missing:"]
            names_by_file: dict[str, list[str]] = {}
            for name, file in self.missing.items():
                names_by_file.setdefault(file, []).append(name)
            width = max(map(len, names_by_file))
            lines += [f"  {file:<{width}}  {', '.join(n)}" for file, n in names_by_file.items()]
        return "\n".join(line.rstrip() for line in lines)


def evaluate_scene(
    scene: Path | str,
    estimate: Path | str,
    *,
    names: tuple[str, ...] | None = None,
    thresholds: tuple[float, ...] = THRESHOLDS,
    border: int = BORDER,
) -> SceneScores:
    """Compute the benchmark's measures of an estimate in the regions of its scene.

    Args:
        scene: Folder of the scene, with ``gt_disp_lowres.pfm`` and masks.
        estimate: Estimated disparity, pixels per view step: a PFM or NPY file, or a folder of
            results.
        names: Names of the measures, see :func:`metric_names`; None for all that the scene has
            files for.
        thresholds: Thresholds of BadPix, pixels per view step, if no names are given.
        border: Pixels left out on each side of the image.

    Returns:
        The measures. ``missing`` is empty if names are given.

    Raises:
        InputError: If a measure does not exist, a file cannot be read, the maps cannot be compared,
            or a file is missing that a measure given by name needs.

    Example:
        >>> import tempfile
        >>> from occjax.io import write_pfm
        >>> folder = Path(tempfile.mkdtemp())
        >>> write_pfm(folder / "gt_disp_lowres.pfm", np.zeros((40, 40), np.float32))
        >>> np.save(folder / "estimate.npy", np.full((40, 40), 0.05))
        >>> names = ("badpix_0.07", "badpix_0.03")
        >>> evaluate_scene(folder, folder / "estimate.npy", names=names).values
        {'badpix_0.07': 0.0, 'badpix_0.03': 100.0}
    """
    folder = Path(scene)
    chosen = metric_names(thresholds) if names is None else names
    measures = {name: _measure(name) for name in chosen}
    comparison = _read_comparison(folder, Path(estimate), border)
    values: dict[str, float] = {}
    missing: dict[str, str] = {}
    for name, measure in measures.items():
        try:
            values[name] = measure(comparison)
        except MissingFileError as error:
            if names is not None:
                raise InputError(f"{name} cannot be measured: {error}") from error
            missing[name] = error.missing
        except InputError as error:
            raise InputError(f"{name} of {estimate} cannot be measured: {error}") from error
    return SceneScores(folder.resolve().name, values, missing, border)


def metric_names(thresholds: tuple[float, ...] = THRESHOLDS) -> tuple[str, ...]:
    """Return the names of all measures.

    Args:
        thresholds: Thresholds of BadPix, pixels per view step.

    Returns:
        Names: those of all scenes, of photorealistic scenes, of stratified scenes.

    Example:
        >>> metric_names((0.07,))[:4]
        ('mse_x100', 'badpix_0.07', 'q25_x100', 'runtime')
    """
    badpix = tuple(f"{BADPIX}{threshold:g}" for threshold in thresholds)
    first, *others = _MEASURES
    return (first, *badpix, *others)


@dataclass(frozen=True, eq=False)
class _Comparison:
    """An estimate of a scene, the ground truth, and the masks that have been read so far."""

    folder: Path
    path: Path
    estimate: np.ndarray
    truth: np.ndarray
    border: int
    masks: dict[str, np.ndarray] = field(default_factory=dict)

    def mask(self, *names: str) -> np.ndarray:
        """Return the union of regions; each must exist and have a pixel to compare."""
        return reduce(np.logical_or, [self._region(name) for name in names])

    def _region(self, name: str) -> np.ndarray:
        if name not in self.masks:
            mask = read_mask(self.folder, name, self.truth.shape)
            h, w = self.truth.shape
            inside = np.s_[self.border : h - self.border, self.border : w - self.border]
            if not (mask & np.isfinite(self.truth))[inside].any():
                missing = f"a valid pixel of {name} inside the border"
                message = f"{self.folder}: does not have {missing}; choose another measure"
                raise MissingFileError(message, missing)
            self.masks[name] = mask
        return self.masks[name]

    def score(self, measure: Callable[..., Any], *regions: str, **options: object) -> Any:
        """Return a measure in the union of regions; without regions, that of all pixels."""
        mask = self.mask(*regions) if regions else None
        return measure(self.estimate, self.truth, border=self.border, mask=mask, **options)

    def metrics(self, *regions: str, threshold: float = BAD_PIXEL_THRESHOLD) -> Metrics:
        """Return the measures of single pixels in the union of regions."""
        return self.score(evaluate, *regions, thresholds=(threshold,))

    def bad_pix(self, *regions: str, threshold: float = BAD_PIXEL_THRESHOLD) -> float:
        """Return the percentage of bad pixels in the union of regions."""
        return self.metrics(*regions, threshold=threshold).badpix[threshold]

    def angle(self, average: Callable[..., float], region: str) -> float:
        """Return the average angle between normals in a region."""
        calibration = read_calibration(self.folder)
        return float(average(self.score(angular_errors, region, calibration=calibration)))

    def layers(self, region: str, *, wrong: str, right: str) -> float:
        """Return the percentage of pixels in a region that are closer to the wrong layer."""
        # Read before the layers: if several files are missing, the error names that of the region.
        mask = self.mask(region)
        layers = {"wrong": self.mask(wrong), "right": self.mask(right)}
        return wrong_layer(self.estimate, self.truth, border=self.border, mask=mask, **layers)

    def dots(self) -> float:
        """Return the percentage of missed dots."""
        dots = self.mask("dots_by_size")
        return missed_dots(self.estimate, self.truth, dots, border=self.border)

    def dots_background(self) -> float:
        """Return the mean squared error of the background of the scene dots."""
        self.mask("dots_by_size")  # Other scenes have a background too, but no dots.
        return self.metrics("background").mse_x100


_Measure = Callable[[_Comparison], float]


def _thinning(estimate: np.ndarray, truth: np.ndarray, **options: Any) -> float:
    return fattening(-estimate, -truth, **options)


_MEASURES: dict[str, _Measure] = {
    "mse_x100": lambda c: c.metrics().mse_x100,
    "q25_x100": lambda c: c.metrics().q25_x100,
    "runtime": lambda c: read_seconds(c.path),
    "discontinuities": lambda c: c.bad_pix("discontinuities"),
    "discontinuities_mse_x100": lambda c: c.metrics("discontinuities").mse_x100,
    "bumpiness_planes": lambda c: 100.0 * c.score(bumpiness, "planes"),
    "bumpiness_smooth": lambda c: 100.0 * c.score(bumpiness, "smooth_surfaces"),
    "normals_planes_median": lambda c: c.angle(np.median, "planes"),
    "normals_planes_mean": lambda c: c.angle(np.mean, "planes"),
    "normals_smooth_median": lambda c: c.angle(np.median, "smooth_surfaces"),
    "normals_smooth_mean": lambda c: c.angle(np.mean, "smooth_surfaces"),
    "fine_fattening": lambda c: c.score(fattening, "fine_surrounding"),
    "fine_thinning": lambda c: c.score(_thinning, "fine"),
    "backgammon_fattening": lambda c: c.layers(
        "foreground_fattening", wrong="foreground", right="background"
    ),
    "backgammon_thinning": lambda c: c.layers(
        "foreground_thinning", wrong="background", right="foreground"
    ),
    "dots_missed": _Comparison.dots,
    "dots_background_mse_x100": _Comparison.dots_background,
    "pyramids_bumpiness_slanted": lambda c: (
        100.0 * c.score(bumpiness, "pyramids", "sphere_in", "sphere_out")
    ),
    "pyramids_bumpiness_parallel": lambda c: 100.0 * c.score(bumpiness, "plane"),
    "stripes_low_texture": lambda c: c.bad_pix("low_texture"),
    "stripes_dark": lambda c: c.bad_pix("high_contrast"),
    "stripes_bright": lambda c: c.bad_pix("low_contrast"),
}


def _measure(name: str) -> _Measure:
    """Return the function of a measure."""
    if name in _MEASURES:
        return _MEASURES[name]
    try:
        threshold = float(name.removeprefix(BADPIX)) if name.startswith(BADPIX) else math.nan
    except ValueError:
        threshold = math.nan
    if math.isnan(threshold):
        raise InputError(f"there is no measure {name!r}; {nearest(name, metric_names())}")
    return lambda comparison: comparison.bad_pix(threshold=threshold)


def _unit(name: str) -> str:
    """Return the unit of a measure, for the table."""
    if name == "runtime":
        return "s"
    if name.startswith("normals"):
        return "degrees"
    return "" if "mse" in name or "q25" in name or "bumpiness" in name else "%"


def _read_comparison(folder: Path, estimate: Path, border: int) -> _Comparison:
    """Read both maps and check that they fit each other."""
    truth_path = folder / GROUND_TRUTH
    truth = read_pfm(truth_path)
    estimated = read_disparity(estimate)
    check_same_view(estimate, truth_path)
    try:
        compared_pixels(estimated, truth, border=border)
    except InputError as error:
        raise InputError(f"{estimate} against {truth_path}: {error}") from None
    return _Comparison(folder, estimate, estimated, truth, border)
