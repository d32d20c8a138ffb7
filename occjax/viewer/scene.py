"""What the viewer shows: one scene with one or more estimates, as arrays."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from occjax.errors import InputError
from occjax.lightfield import Calibration, LightField, view_name
from occjax.viz.pictures import view_picture


@dataclass(frozen=True, eq=False)
class ViewedResult:
    """One estimate of the scene.

    Attributes:
        name: Name in the list of results.
        disparity: ``[H, W]``, pixels per view step; NaN is no value.
        confidence: ``[H, W]`` in [0, 1], if known.
        occlusion: ``[V, U, H, W]`` occlusion maps in [0, 1], if known.
        disparity_range: ``(minimum, maximum)`` that was searched, if known.
    """

    name: str
    disparity: np.ndarray
    confidence: np.ndarray | None = None
    occlusion: np.ndarray | None = None
    disparity_range: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class ViewedScene:
    """A scene and its estimates.

    Attributes:
        results: At least one estimate; all maps have the same size.
        light_field: The views, if they are available, with ground truth if there is one.
        name: Name of the scene.
        calibration: Camera parameters, if known; those of the light field by default.
    """

    results: tuple[ViewedResult, ...]
    light_field: LightField | None = None
    name: str = "light field"
    calibration: Calibration | None = None

    def __post_init__(self) -> None:
        """Check that the maps and the views belong together."""
        if not self.results:
            raise InputError("there is no result to show; pass at least one")
        for result in self.results[1:]:
            if result.disparity.shape != self.image_size:
                raise InputError(
                    f"{result.name} is {list(result.disparity.shape)} but {self.results[0].name} "
                    f"is {list(self.image_size)} (rows, columns); show results of one scene"
                )
        if self.light_field is not None:
            if self.light_field.image_size != self.image_size:
                raise InputError(
                    f"the views of {self.light_field.name} are {list(self.light_field.image_size)} "
                    f"but the map is {list(self.image_size)} (rows, columns); pass the scene that "
                    "was estimated"
                )
            if self.calibration is None:
                object.__setattr__(self, "calibration", self.light_field.calibration)

    @property
    def image_size(self) -> tuple[int, int]:
        """``(H, W)`` of the maps, in pixels."""
        height, width = self.results[0].disparity.shape
        return height, width

    @property
    def ground_truth(self) -> np.ndarray | None:
        """``[H, W]`` true disparity, if known."""
        return None if self.light_field is None else self.light_field.ground_truth

    @property
    def view_name(self) -> str:
        """Name of the view that the maps are of: ``"centre view"`` or ``"view (v, u)"``."""
        return view_name(None if self.light_field is None else self.light_field.view)

    @cached_property
    def centre(self) -> np.ndarray | None:
        """``[H, W, 3]`` uint8 centre view, if the views are available."""
        return None if self.light_field is None else view_picture(self.light_field.centre)

    @cached_property
    def disparity_range(self) -> tuple[float, float]:
        """``(minimum, maximum)`` over the searched ranges and the values of all results."""
        ends = [result.disparity_range for result in self.results if result.disparity_range]
        finite = [result.disparity[np.isfinite(result.disparity)] for result in self.results]
        ends += [(float(values.min()), float(values.max())) for values in finite if values.size]
        if not ends:
            return -1.0, 1.0
        low, high = min(low for low, _ in ends), max(high for _, high in ends)
        # Rounded outwards, so that sliders have short numbers at their ends.
        low, high = math.floor(100.0 * low) / 100.0, math.ceil(100.0 * high) / 100.0
        return (low, high) if high > low else (low - 0.5, high + 0.5)

    @property
    def typical_disparity(self) -> float:
        """Median disparity of the first result; the middle of the range if it has no value."""
        disparity = self.results[0].disparity
        known = disparity[np.isfinite(disparity)]
        return float(np.median(known) if known.size else np.mean(self.disparity_range))
