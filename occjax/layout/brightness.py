"""Brightness of each view relative to the centre view.

The outer views of a plenoptic camera fade to black, since its main lens and its microlenses are
round. Cameras of an array differ in exposure. Bright enough views are divided by their gain, so
that a grey difference means the same in all views. Views that are too dark are not used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occjax.layout.config import BrightnessConfig
from occjax.layout.filters import box_mean
from occjax.lightfield import LightField, centre_index, grid_around, to_grey
from occjax.programs import kept


@dataclass(frozen=True, eq=False)
class ViewBrightness:
    """Brightness of the views relative to the centre view.

    Attributes:
        gain: ``[V, U]`` float32 factor by which a view is brighter than the centre view; 1 for all
            views if they are about equally bright, and for views that are not used.
        usable: ``[V, U]`` bool, False for views that are missing or too dark to be compared.
        dark: Number of views that are present but too dark.
        fall_off: ``[V, U, 6]`` logarithm of the gain at each pixel relative to ``gain``, as a
            polynomial of the image coordinates (:func:`_terms`); None if all views are uniform.
    """

    gain: np.ndarray
    usable: np.ndarray
    dark: int
    fall_off: np.ndarray | None = None

    def grey(self, light_field: LightField, v: int, u: int) -> np.ndarray:
        """Return the ``[H, W]`` float32 grey view ``(v, u)`` at the brightness of the centre view.

        A view of gain 1 without fall-off is exactly that of :func:`occjax.lightfield.to_grey`.
        """
        return self.equalised(to_grey(light_field.views[v, u])[..., None], v, u)[..., 0]

    def equalised(self, image: np.ndarray, v: int, u: int) -> np.ndarray:
        """Return an image ``[H, W, C]`` of view ``(v, u)`` at the brightness of the centre view.

        Args:
            image: ``[H, W, C]`` float32.
            v: Row of the view.
            u: Column of the view.
        """
        gain = self.gain[v, u]
        if self.fall_off is not None:
            gain = gain * np.exp(_terms(image.shape[:2]) @ self.fall_off[v, u])[..., None]
        return image if np.all(gain == 1) else (image / gain).astype(np.float32)

    def around(self, view: tuple[int, int]) -> ViewBrightness:
        """Return the brightness relative to another view, which becomes the centre view.

        Args:
            view: ``(v, u)``, index of that view; it must be usable.
        """
        usable = grid_around(self.usable, view)
        gain = np.where(usable, grid_around(self.gain / self.gain[view], view), np.float32(1.0))
        fall_off = self.fall_off
        if fall_off is not None:
            relative = grid_around(fall_off - fall_off[view], view)
            fall_off = np.where(usable[..., None], relative, 0.0)
        return ViewBrightness(gain, usable, self.dark, fall_off)

    @property
    def is_equal(self) -> bool:
        """Whether all views count as equally bright."""
        return self.fall_off is None and bool(np.all(self.gain == 1))

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
        if self.fall_off is not None:
            notes.append(
                "the views darken towards the borders of the image and were equalised (vignetting)"
            )
        elif np.ptp(gain) > 0:
            notes.append(
                f"the views have {gain.min():.0%} to {gain.max():.0%} of the brightness of the "
                "centre view and were equalised"
            )
        return tuple(notes)


def view_brightness(
    light_field: LightField,
    config: BrightnessConfig | None = None,
    *,
    disparity: np.ndarray | None = None,
) -> ViewBrightness:
    """Measure how bright each view is relative to the centre view.

    The gain of a view is the median, over the pixels, of the ratio of low-pass filtered images. If
    the ratio changes over the image, as that of a vignetted view, a polynomial describes it. A view
    is dark if much of it is black where the centre view is not. A light field that carries a report
    (:func:`occjax.layout.check`) is not measured again.

    Args:
        light_field: Any grid.
        config: Settings of a new measurement; None for the stored measurement, or the default
            settings if there is none.
        disparity: ``[h, w]`` disparity of the centre view, reduced to any size, in pixels of the
            light field per view step. With it the views are compared where they see the same
            points. Without it parallax changes gains by up to 3 %.

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
    fall_off = np.zeros((*light_field.grid, 6))
    terms = _terms(centre.shape)[lit]
    largest_fall_off = 0.0
    others = [index for index in map(tuple, np.argwhere(present)) if index != centre_view]
    low_passed = np.zeros((*light_field.grid, *centre.shape), centre.dtype)
    for index in others:
        low_passed[index] = _low_pass(light_field.views[index], config)
    if disparity is not None:
        low_passed = _seen_from_centre(low_passed, light_field, disparity)
    for index in others:
        ratio = low_passed[index][lit] / centre[lit]
        usable[index] = np.quantile(ratio, config.dark_fraction) > config.min_gain
        if usable[index]:
            gain[index] = np.median(ratio)
            relative = np.log(np.maximum(ratio / gain[index], config.min_gain))
            coefficients = _robust_fit(terms, relative, config)
            fitted = terms @ coefficients
            # A polynomial does not describe the black crescent of a clipped pupil: fitted to it, it
            # would falsify the rest of the view.
            if np.abs(relative - fitted).mean() < 0.5 * np.abs(relative).mean():
                fall_off[index] = coefficients
                largest_fall_off = max(largest_fall_off, float(np.abs(fitted).mean()))
    dark = int((present & ~usable).sum())
    if largest_fall_off > config.equal_gain:
        return ViewBrightness(gain, usable, dark, fall_off)
    if np.abs(gain - 1).max() <= config.equal_gain:
        gain = np.ones_like(gain)
    return ViewBrightness(gain, usable, dark)


def _seen_from_centre(
    images: np.ndarray, light_field: LightField, disparity: np.ndarray
) -> np.ndarray:
    """Warp ``[V, U, h, w]`` reduced views to the centre view, by a disparity map of any size."""
    size = images.shape[2:]
    rows, columns = (np.arange(n) * m // n for n, m in zip(size, disparity.shape, strict=True))
    reduced = disparity[np.ix_(rows, columns)] * (size[0] / light_field.image_size[0])
    return np.asarray(_warped(images, reduced.astype(np.float32), light_field.offsets))


@kept
def _warped(images, disparity, offsets):
    from occjax.ops import warp_views  # a cached program does not need it

    return warp_views(images[..., None], disparity, offsets=offsets)[..., 0]


def _terms(shape: tuple[int, ...]) -> np.ndarray:
    """Return ``[h, w, 6]`` monomials up to the second degree of coordinates from -1 to 1."""
    y, x = (np.linspace(-1, 1, size) for size in shape)
    y, x = np.meshgrid(y, x, indexing="ij")
    return np.stack([np.ones_like(x), y, x, y * y, x * y, x * x], axis=-1)


def _robust_fit(terms: np.ndarray, values: np.ndarray, config: BrightnessConfig) -> np.ndarray:
    """Return the ``[6]`` coefficients of the ``[n, 6]`` terms that fit most of ``[n]`` values.

    Iteratively reweighted least squares with Cauchy weights, because parallax makes outliers near
    depth edges.
    """
    weights = np.ones_like(values)
    for _ in range(config.fit_steps):
        weighted = terms.T * weights
        coefficients = np.linalg.lstsq(weighted @ terms, weighted @ values)[0]
        residual = values - terms @ coefficients
        weights = 1 / (1 + np.square(residual / config.equal_gain))
    return coefficients


def _low_pass(image: np.ndarray, config: BrightnessConfig) -> np.ndarray:
    """Return the local mean of the reduced grey image.

    Windows larger than 3x3 give a mean so smooth that every second pixel is enough.
    """
    step = max(1, min(image.shape[:2]) // config.size_px)
    grey = to_grey(image[::step, ::step])
    radius = min(grey.shape) // config.windows_per_side
    mean = box_mean(grey, radius)
    return mean[::2, ::2] if radius > 1 else mean
