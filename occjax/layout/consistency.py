"""Photo-consistency of the views under each of the eight view orders.

The views of the cross around the centre view are compared, in grey, reduced in size and without
slow brightness changes (vignetting). The cross has four arms. Each arm gives two cost volumes: one
for motion along image columns, one for motion along image rows. The cost of each of the eight
view orders is a combination of these volumes:

* correct order: views on the grid row move along x, views on the grid column along y;
* swapped order: the other way round;
* flipped axis: its disparity has the opposite sign.

Of two opposite arms the lower cost counts at each pixel, because an occluded point is usually
visible from one side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import reduce

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from occjax.errors import InputError
from occjax.kernels.bilinear import displaced_plane
from occjax.kernels.padding import pad_borders
from occjax.layout.brightness import ViewBrightness
from occjax.layout.config import ViewOrderConfig
from occjax.layout.filters import box_mean, high_pass, reduce_image
from occjax.layout.orientation import Orientation
from occjax.lightfield import LightField, centre_index
from occjax.programs import kept


@dataclass(frozen=True)
class Arm:
    """Views on one side of the centre view.

    Attributes:
        on_row: Whether the views are on the grid row of the centre view, else on its grid column.
        offsets: ``[n]`` distances from the centre view in view steps, all of one sign.
        images: ``[n, h, w]`` grey views, the outermost view last.
    """

    on_row: bool
    offsets: np.ndarray
    images: np.ndarray


@dataclass(frozen=True)
class Cross:
    """The centre view and the arms around it, reduced in size.

    Attributes:
        centre: ``[h, w]`` grey centre view.
        arms: Up to four arms; fewer in small grids.
        scale: Pixels of the light field per pixel of the reduced images.
        brightness: Grey value that all grey values are divided by.
        config: Settings of the measurement.
    """

    centre: np.ndarray
    arms: tuple[Arm, ...]
    scale: int
    brightness: float
    config: ViewOrderConfig

    @property
    def reach(self) -> float:
        """Return the largest distance from the centre view, in view steps."""
        return max(float(np.abs(arm.offsets).max()) for arm in self.arms)


def view_cross(
    light_field: LightField, brightness: ViewBrightness, size_px: int, config: ViewOrderConfig
) -> Cross:
    """Return the cross of views, reduced so that the shorter image side is at most ``size_px``.

    Args:
        light_field: At least two views.
        brightness: Usable views and their gains.
        size_px: Maximum length of the shorter image side, in pixels.
        config: Settings of the measurement.

    Returns:
        Grey views relative to the brightness of the centre view.

    Raises:
        InputError: If no view in the row and the column of the centre view is usable.
    """
    scale = max(1, math.ceil(min(light_field.image_size) / size_px))
    rows, columns = light_field.grid
    v0, u0 = centre_index(light_field.grid)
    offsets = light_field.offsets

    def image(v: int, u: int) -> np.ndarray:
        return reduce_image(brightness.grey(light_field, v, u), scale)

    centre = image(v0, u0)
    white = np.float32(np.percentile(centre, config.brightness_percentile)) or np.float32(1)
    arms = []
    for on_row, sign in ((True, -1), (True, 1), (False, -1), (False, 1)):
        steps = [sign * step for step in config.view_steps]
        indices = [(v0, u0 + step) if on_row else (v0 + step, u0) for step in steps]
        indices = [(v, u) for v, u in indices if 0 <= v < rows and 0 <= u < columns]
        indices = [index for index in indices if brightness.usable[index]]
        if indices:
            distances = np.array([offsets[v, u, int(on_row)] for v, u in indices])
            images = np.stack([image(v, u) / white for v, u in indices])
            arms.append(Arm(on_row, distances, images))
    if not arms:
        raise InputError(
            f"{light_field.name}: the views above, below, left and right of the centre view are "
            "missing or dark, so nothing can be measured; pass disparity_range "
            "(--disparity-range) and check_orientation=False"
        )
    return Cross(centre / white, tuple(arms), scale, float(white), config)


class CostVolumes:
    """Cost of each disparity candidate at each pixel, for every view order.

    Attributes:
        config: Settings of the measurement.
        candidates: ``[d]`` disparities in pixels of the light field per view step, symmetric
            around zero: reversing a volume negates its disparity.
        step: Distance of neighbouring candidates.
        scale: Pixels of the light field per pixel of the compared images.
        images: Number of grey differences in the cost of a pixel.
        window: Side of the square, in pixels, over which the cost is averaged.
    """

    def __init__(self, cross: Cross, max_disparity: float) -> None:
        """Compare all arms of the cross with its centre view.

        Args:
            cross: Views to compare.
            max_disparity: Largest disparity to search, in pixels of the light field per view step.
        """
        config = self.config = cross.config
        self.scale = cross.scale
        spacing = max(
            config.candidate_motion_px * cross.scale / cross.reach,
            2 * max_disparity / (config.max_candidates - 1),
        )
        count = math.ceil(max_disparity / spacing)
        self.candidates = np.arange(-count, count + 1) * spacing
        self.step = float(self.candidates[1] - self.candidates[0])
        # At each pixel one arm on the row and one arm on the column count.
        lengths = {arm.on_row: len(arm.images) for arm in cross.arms}
        self.images = sum(lengths.values())
        self.window = min(2 * config.cost_radii_px[n - 1] + 1 for n in lengths.values())
        centre = high_pass(cross.centre, config.high_pass_radius_px)
        # JAX computes in the background: all arms are started before the first one is used.
        running = {}
        for index, arm in enumerate(cross.arms):
            images = np.stack([high_pass(i, config.high_pass_radius_px) for i in arm.images])
            for axis in (0, 1):
                offsets = np.zeros((len(images), 2), np.float32)
                offsets[:, axis] = arm.offsets / cross.scale
                radius = config.cost_radii_px[len(images) - 1]
                running[index, axis] = _start_comparison(
                    centre, images, offsets, self.candidates, radius
                )
        self._on_row = [arm.on_row for arm in cross.arms]
        self._volumes = {
            key: np.concatenate(parts)[: len(self.candidates)] for key, parts in running.items()
        }

    def along(
        self, on_row: bool, orientation: Orientation, without: int | None = None
    ) -> np.ndarray | None:
        """Return the ``[d, h, w]`` cost of the views on the grid row or column of the centre view.

        Args:
            on_row: Whether to use the views on the grid row, else those on the grid column.
            orientation: The view order that is assumed.
            without: Index of an arm that is left out; see :attr:`removable_arms`.

        Returns:
            Mean absolute grey difference, at each pixel that of the better arm; None if there are
            no such views.
        """
        axis, sign = motion(on_row, orientation)
        volumes = [
            self._volumes[index, axis][::sign]
            for index, value in enumerate(self._on_row)
            if value == on_row and index != without
        ]
        return reduce(np.minimum, volumes) if volumes else None

    @property
    def removable_arms(self) -> list[int]:
        """Return the indices of the arms that have an opposite arm."""
        return [i for i, on_row in enumerate(self._on_row) if self._on_row.count(on_row) > 1]

    def of(self, orientation: Orientation, without: int | None = None) -> np.ndarray:
        """Return the ``[d, h, w]`` mean absolute grey difference under a view order."""
        along = (self.along(on_row, orientation, without) for on_row in (True, False))
        parts = [part for part in along if part is not None]
        return parts[0] if len(parts) == 1 else (parts[0] + parts[1]) / np.float32(2)

    def score(self, orientation: Orientation, without: int | None = None) -> float:
        """Return the mean over all pixels of the lowest cost under a view order."""
        return float(self.of(orientation, without).min(0).mean())


def motion(on_row: bool, orientation: Orientation) -> tuple[int, int]:
    """Return the image axis along which the views of an arm move, and the sign of disparity."""
    axis = int(on_row != orientation.swap)
    flipped = orientation.flip_columns if axis == 1 else orientation.flip_rows
    return axis, -1 if flipped else 1


def lowest_cost(
    centre: np.ndarray,
    images: np.ndarray,
    offsets: np.ndarray,
    candidates: np.ndarray,
    config: ViewOrderConfig,
) -> np.ndarray:
    """Return the ``[h, w]`` lowest cost over all candidates, of all images together.

    Args:
        centre: ``[h, w]`` grey centre view.
        images: ``[n, h, w]`` grey views.
        offsets: ``[n, 2]`` motion of each view per pixel of disparity.
        candidates: ``[d]`` disparities.
        config: Settings. The cost is averaged as for arms of most views, with the last of the
            ``cost_radii_px``.
    """
    radius = config.high_pass_radius_px
    centre = high_pass(centre, radius)
    images = np.stack([high_pass(image, radius) for image in images])
    offsets = offsets.astype(np.float32)
    parts = _start_comparison(centre, images, offsets, candidates, config.cost_radii_px[-1])
    return np.min([np.asarray(part).min(0) for part in parts], axis=0)


def _start_comparison(
    centre: np.ndarray,
    images: np.ndarray,
    offsets: np.ndarray,
    candidates: np.ndarray,
    radius: int,
) -> list[Array]:
    """Start the comparison of images with the centre view at all candidates.

    Returns:
        ``[13, h, w]`` parts of the cost volume; the last candidate is repeated to fill the last
        part. One program serves all disparity ranges, because the size of a part is fixed.
    """
    part_size = 13
    padded = np.pad(candidates, (0, -len(candidates) % part_size), mode="edge")
    return [
        arm_volume(centre, images, offsets, np.float32(part), radius=radius)
        for part in padded.reshape(-1, part_size)
    ]


@kept
def arm_volume(
    centre: Float[Array, "h w"],
    images: Float[Array, "n h w"],
    offsets: Float[Array, "n 2"],
    candidates: Float[Array, " d"],
    *,
    radius: int,
) -> Float[Array, "d h w"]:
    """Return the local mean of the absolute difference of shifted views from the centre view."""
    # A larger displacement reads only the replicated border.
    margin = max(centre.shape)
    padded = pad_borders(images, (margin, margin + 1), (margin, margin + 1))

    def plane(candidate: Float[Array, ""]) -> Float[Array, "h w"]:
        differences = [
            jnp.abs(displaced_plane(padded, (view,), -candidate * offset, margin) - centre)
            for view, offset in enumerate(offsets)
        ]
        return box_mean(sum(differences, jnp.zeros_like(centre)) / len(differences), radius)

    return jax.lax.map(plane, candidates)
