"""Brightness of each view, which says what a view can be used for.

The outer views of a plenoptic camera fade to black, since its main lens and its microlenses are
round. Cameras of an array differ in exposure. Views with signal left are divided by their gain, so
that one grey difference means the same in all views; views without are not used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter

from occjax.layout.config import BrightnessConfig
from occjax.lightfield import LightField, centre_index, to_grey


@dataclass(frozen=True, eq=False)
class ViewBrightness:
    """Brightness of the views relative to the centre view.

    Attributes:
        gain: ``[V, U]`` float32 factor by which a view is brighter than the centre view; 1 for all
            views if they are about equally bright, and for views that are not used.
        usable: ``[V, U]`` bool, False for views that are missing or too dark to be compared.
        dark: Number of views that exist and are too dark.
    """

    gain: np.ndarray
    usable: np.ndarray
    dark: int

    def grey(self, light_field: LightField, v: int, u: int) -> np.ndarray:
        """Return the ``[H, W]`` float32 grey view ``(v, u)`` at the brightness of the centre view.

        It is exactly :func:`occjax.lightfield.to_grey` of a view of gain 1.
        """
        image, gain = to_grey(light_field.views[v, u]), self.gain[v, u]
        return image if gain == 1 else image / gain

    @property
    def notes(self) -> tuple[str, ...]:
        """Messages for the user on views that are not used or equalised; empty if there are none.

        Example:
            >>> views = np.full((1, 3, 16, 16, 1), 200, np.uint8)
            >>> views[0, 2] = 100
            >>> view_brightness(LightField(views)).notes
            ('the views have 50% to 100% of the brightness of the centre view and were equalised',)
        """
        notes = []
        if self.dark:
            notes.append(
                f"{self.dark} of {self.usable.size} views are too dark to be compared with the "
                "centre view and were not used"
            )
        gain = self.gain[self.usable]
        if np.ptp(gain) > 0:
            notes.append(
                f"the views have {gain.min():.0%} to {gain.max():.0%} of the brightness of the "
                "centre view and were equalised"
            )
        return tuple(notes)


def view_brightness(
    light_field: LightField, config: BrightnessConfig | None = None
) -> ViewBrightness:
    """Measure how bright each view is relative to the centre view.

    The gain of a view is the median, over the pixels, of the ratio of low-pass filtered images. A
    view is dark if much of it is black where the centre view is not. A light field that carries a
    report (:func:`occjax.layout.check`) is not measured again.

    Args:
        light_field: Any grid.
        config: Settings of a new measurement; None for the stored measurement, or the default
            settings if there is none.

    Returns:
        Gains and usable views.

    Example:
        >>> views = np.full((1, 5, 16, 16, 1), 200, np.uint8)
        >>> views[0, 0], views[0, 3] = 0, 150
        >>> brightness = view_brightness(LightField(views))
        >>> brightness.usable.tolist(), brightness.gain.tolist()
        ([[False, True, True, True, True]], [[1.0, 1.0, 1.0, 0.75, 1.0]])
    """
    if config is None and light_field.view_order_report is not None:
        return light_field.view_order_report.brightness
    config = BrightnessConfig() if config is None else config
    present = light_field.usable
    present = np.ones(light_field.grid, bool) if present is None else present
    centre_view = centre_index(light_field.grid)
    centre = _low_pass(light_field.centre, config)
    lit = centre > config.min_grey * np.percentile(centre, config.brightness_percentile)
    gain = np.ones(light_field.grid, np.float32)
    if not lit.any():  # a black centre view: there is nothing to compare with
        return ViewBrightness(gain, present, dark=0)
    usable = present.copy()
    for index in map(tuple, np.argwhere(present)):
        if index != centre_view:
            ratio = _low_pass(light_field.views[index], config)[lit] / centre[lit]
            gain[index] = np.median(ratio)
            usable[index] = np.quantile(ratio, config.dark_fraction) > config.min_gain
    gain[~usable] = 1.0
    if np.abs(gain - 1).max() <= config.equal_gain:
        gain = np.ones_like(gain)
    return ViewBrightness(gain, usable, dark=int((present & ~usable).sum()))


def _low_pass(image: np.ndarray, config: BrightnessConfig) -> np.ndarray:
    """Return the local mean of grey, reduced to about ``config.size_px`` by leaving out pixels."""
    step = max(1, min(image.shape[:2]) // config.size_px)
    grey = to_grey(image[::step, ::step])
    radius = min(grey.shape) // config.windows_per_side
    return uniform_filter(grey, 2 * radius + 1, mode="nearest")
