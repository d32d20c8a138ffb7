"""How well the views of a light field agree under each layout of its grid.

Measured on the cross of views around the centre, in grey, reduced in size and freed of slow
brightness changes (vignetting). A cross has four arms; each arm is compared with the centre view at
every disparity, once moving along image columns and once along image rows. From these volumes the
cost of each of the eight orientations is put together without touching the images again:

* right order: the views of the grid row move along x, those of the grid column along y;
* swapped order: the other way round;
* one axis flipped: its disparity has the opposite sign.

The better arm of two opposite ones counts, since an occluded point is usually seen from one side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from occjax.io.orientation import Orientation
from occjax.lightfield import LightField, to_grey

STEPS = (1, 2, 4)
"""Views of an arm that are compared: near ones for large disparities, far ones for precision."""

MEAN_RADIUS = {1: 3, 2: 2, 3: 1}
"""Half width in pixels of the mean of the cost, by views in an arm: few views need more pixels."""

HIGH_PASS_RADIUS = 4
"""Half width in pixels of the local mean that is taken off."""

BRIGHT = 98
"""Percentile of the grey values of the centre view that counts as its brightness."""


@dataclass(frozen=True)
class Arm:
    """Views on one side of the centre, on its grid row or its grid column.

    Attributes:
        along_row: On the grid row of the centre view, else on its grid column.
        offsets: Distances from the centre view in view steps, all of one sign.
        images: ``[h, w]`` grey view at each of them.
    """

    along_row: bool
    offsets: tuple[float, ...]
    images: tuple[np.ndarray, ...]


@dataclass(frozen=True)
class Cross:
    """The centre view and the arms around it, at one scale.

    Attributes:
        centre: ``[h, w]`` grey centre view.
        arms: Up to four; fewer at the border of small grids.
        scale: Pixels of the light field per pixel here.
        brightness: What the grey values were divided by, so that no threshold depends on the
            exposure or on how many bits of its type the light field uses.
    """

    centre: np.ndarray
    arms: tuple[Arm, ...]
    scale: int
    brightness: float = 1.0

    @property
    def reach(self) -> float:
        """Largest distance from the centre view, in view steps."""
        return max(abs(offset) for arm in self.arms for offset in arm.offsets)

    def without_mean(self) -> Cross:
        """The cross with the local mean taken off every view, against vignetting."""

        def sharpen(image: np.ndarray) -> np.ndarray:
            return image - box_mean(image, HIGH_PASS_RADIUS)

        arms = tuple(
            Arm(arm.along_row, arm.offsets, tuple(map(sharpen, arm.images))) for arm in self.arms
        )
        return Cross(sharpen(self.centre), arms, self.scale, self.brightness)


def cross(light_field: LightField, size: int) -> Cross:
    """The cross of views, reduced so that the shorter image side is at most ``size`` pixels.

    Grey values are divided by the brightness of the centre view.
    """
    scale = max(1, math.ceil(min(light_field.image_size) / size))
    rows, columns = light_field.grid
    v0, u0 = rows // 2, columns // 2
    centre = _reduce(to_grey(light_field.centre), scale)
    brightness = float(np.percentile(centre, BRIGHT)) or 1.0

    def image(v: int, u: int) -> np.ndarray:
        return _reduce(to_grey(light_field.views[v, u]), scale) / np.float32(brightness)

    arms = []
    for along_row, sign in ((True, -1), (True, 1), (False, -1), (False, 1)):
        places = [(v0, u0 + sign * k) if along_row else (v0 + sign * k, u0) for k in STEPS]
        places = [(v, u) for v, u in places if 0 <= v < rows and 0 <= u < columns]
        if places:
            offsets = tuple(_offset(light_field, v, u, along_row) for v, u in places)
            arms.append(Arm(along_row, offsets, tuple(image(v, u) for v, u in places)))
    return Cross(image(v0, u0), tuple(arms), scale, brightness)


class CostVolumes:
    """Cost of each disparity at each pixel, for every orientation.

    Attributes:
        candidates: ``[D]`` disparities in pixels of the light field per view step, symmetric
            around zero so that negating them is reversing the volume.
        step: Distance of neighbouring candidates.
        images: How many grey differences are averaged at each pixel.
        window: Side in pixels of the square over which they are averaged in addition.
    """

    def __init__(self, cross: Cross, candidates: np.ndarray) -> None:
        self.candidates = candidates
        self.step = float(candidates[1] - candidates[0])
        lengths = {arm.along_row: len(arm.images) for arm in cross.arms}
        self.images = sum(lengths.values())
        self.window = min(2 * MEAN_RADIUS[length] + 1 for length in lengths.values())
        cross = cross.without_mean()
        self._along = {
            (along_row, axis): self._both_arms(cross, along_row, axis)
            for along_row in (True, False)
            for axis in (0, 1)
        }

    def of(self, orientation: Orientation) -> np.ndarray:
        """``[D, h, w]`` mean absolute grey difference under an orientation."""
        parts = []
        for along_row in (True, False):
            axis, sign = motion(along_row, orientation)
            volume = self._along[along_row, axis]
            if volume is not None:
                parts.append(volume[::sign])
        return parts[0] if len(parts) == 1 else (parts[0] + parts[1]) / np.float32(2)

    def _both_arms(self, cross: Cross, along_row: bool, axis: int) -> np.ndarray | None:
        """``[D, h, w]`` cost of the better of two opposite arms, moving along an image axis."""
        arms = [self._arm(cross, arm, axis) for arm in cross.arms if arm.along_row == along_row]
        return np.minimum.reduce(arms) if arms else None

    def _arm(self, cross: Cross, arm: Arm, axis: int) -> np.ndarray:
        """``[D, h, w]`` difference between the views of an arm and the centre, local mean."""
        volume = np.empty((len(self.candidates), *cross.centre.shape), np.float32)
        for slice_, disparity in zip(volume, self.candidates, strict=True):
            differences = [
                np.abs(_shift(image, disparity * offset / cross.scale, axis) - cross.centre)
                for image, offset in zip(arm.images, arm.offsets, strict=True)
            ]
            slice_[...] = box_mean(np.mean(differences, axis=0), MEAN_RADIUS[len(differences)])
        return volume


def motion(along_row: bool, orientation: Orientation) -> tuple[int, int]:
    """Image axis along which the views of an arm move, and with which sign of disparity."""
    axis = 1 if along_row != orientation.swap else 0
    flipped = orientation.flip_columns if axis == 1 else orientation.flip_rows
    return axis, -1 if flipped else 1


def box_mean(image: np.ndarray, radius: int) -> np.ndarray:
    """``[h, w]`` mean over a square of side ``2 * radius + 1``; the border is replicated."""
    h, w = image.shape
    side = 2 * radius + 1
    padded = np.pad(image, radius, mode="edge")
    rows = padded[:h].copy()
    for start in range(1, side):
        rows += padded[start : start + h]
    mean = rows[:, :w].copy()
    for start in range(1, side):
        mean += rows[:, start : start + w]
    mean /= np.float32(side**2)
    return mean


def _offset(light_field: LightField, v: int, u: int, along_row: bool) -> float:
    """Distance of a view on the cross from the centre view, measured if positions are known."""
    if light_field.positions is not None:
        return float(light_field.positions[v, u, 1 if along_row else 0])
    rows, columns = light_field.grid
    return float(u - columns // 2 if along_row else v - rows // 2)


def _reduce(image: np.ndarray, scale: int) -> np.ndarray:
    """Mean of ``scale`` x ``scale`` blocks; what does not fill a block is left out."""
    h, w = image.shape[0] // scale, image.shape[1] // scale
    blocks = image[: h * scale, : w * scale].reshape(h, scale, w, scale)
    return blocks.mean((1, 3), dtype=np.float32)


def _shift(image: np.ndarray, displacement: float, axis: int) -> np.ndarray:
    """``image(position - displacement)`` along one axis, linear, border replicated."""
    base = math.floor(-displacement)
    fraction = np.float32(-displacement - base)
    index = np.arange(image.shape[axis]) + base
    last = image.shape[axis] - 1
    lower = image.take(np.clip(index, 0, last), axis)
    upper = image.take(np.clip(index + 1, 0, last), axis)
    return lower + fraction * (upper - lower)
