"""Settings of the random scenes: which elements they have, and with which probability."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import get_args

import numpy as np

from occjax.errors import InputError
from occjax.lightfield import view_offsets
from occjax.view_selection import Arrangement, select_from_grid


@dataclass(frozen=True)
class Textures:
    """Relative frequency of each kind of texture."""

    noise: float = 4.0
    stripes: float = 1.0
    checks: float = 0.7
    dots: float = 0.7
    bricks: float = 0.7
    mosaics: float = 1.0
    gradients: float = 1.0


@dataclass(frozen=True)
class Outlines:
    """Relative frequency of each kind of outline of a sheet.

    Attributes:
        plain: Rectangles and ellipses.
        polygons: Convex polygons, some with a hole.
        noise: Blobs with a ragged edge.
        holes: Sheets full of holes.
        grids: Straight rods: fences, grids, bars.
        wires: A few bent wires.
        leaves: Leaves on a twig.
    """

    plain: float = 1.5
    polygons: float = 1.5
    noise: float = 1.0
    holes: float = 0.6
    grids: float = 0.7
    wires: float = 0.7
    leaves: float = 1.0


@dataclass(frozen=True)
class Solids:
    """Relative frequency of each kind of solid; rods are long and thin."""

    boxes: float = 1.0
    ellipsoids: float = 1.2
    cylinders: float = 0.8
    rods: float = 0.6


@dataclass(frozen=True)
class Defects:
    """Probability of each camera defect."""

    noise: float = 0.5
    vignetting: float = 0.25
    blur: float = 0.3
    gamma: float = 0.5
    quantisation: float = 0.8


@dataclass(frozen=True)
class SceneConfig:
    """A distribution of random light fields.

    A probability of zero, or a relative frequency of zero, switches an element off.

    Attributes:
        image_size: ``(H, W)`` of each view, in pixels.
        grid: ``(V, U)`` number of views.
        views: The views of the grid that are rendered: ``"all"``; ``"cross"``, the middle row and
            column; ``"star"``, which adds both diagonals; ``"outer_star"``, the two outermost views
            of a star in each direction, which are the input of the proposal network.
        rays: Rays per pixel; a square number.
        disparity_range: Lowest and highest disparity of the centre view, in pixels per view step.
        disparity_width: Smallest and largest width of the disparity range of one scene, in pixels
            per view step; the width is drawn log-uniformly between them.
        walls: Largest number of unbounded background surfaces.
        sheets: Largest number of thin, bounded surfaces.
        solids: Largest number of solids.
        texture_count: Number of textures that the surfaces of one scene share.
        textures: Kinds of texture.
        outlines: Kinds of outline.
        solid_kinds: Kinds of solid.
        slanted: Probability that a wall is not fronto-parallel.
        curved: Probability that a wall or a sheet is curved.
        contacts: Probability that an object touches the wall behind it.
        clusters: Probability that consecutive solids form one object.
        low_contrast: Probability that the texture of a surface has low contrast.
        textureless: Probability that a surface has no texture.
        calm: Probability that all surfaces of a scene have low contrast.
        similar: Probability that an object has nearly the texture of the wall.
        shading: Probability that brightness depends on slant and on the distance to a lamp.
        shadows: Probability that objects cast shadows.
        creases: Probability of ambient occlusion: corners and gaps are darker.
        highlights: Probability that the surfaces of a scene have highlights, which move with the
            view.
        reflections: Probability that the surfaces of a scene faintly reflect their surroundings.
        defects: Camera defects.
    """

    image_size: tuple[int, int] = (128, 128)
    grid: tuple[int, int] = (9, 9)
    views: Arrangement = "star"
    rays: int = 4
    disparity_range: tuple[float, float] = (-4.0, 4.0)
    disparity_width: tuple[float, float] = (0.4, 8.0)
    walls: int = 3
    sheets: int = 8
    solids: int = 6
    texture_count: int = 12
    textures: Textures = Textures()
    outlines: Outlines = Outlines()
    solid_kinds: Solids = Solids()
    slanted: float = 0.8
    curved: float = 0.35
    contacts: float = 0.45
    clusters: float = 0.35
    low_contrast: float = 0.25
    textureless: float = 0.1
    calm: float = 0.25
    similar: float = 0.2
    shading: float = 0.85
    shadows: float = 0.6
    creases: float = 0.5
    highlights: float = 0.35
    reflections: float = 0.2
    defects: Defects = Defects()

    def __post_init__(self) -> None:
        """Raise an error for values that the generator cannot draw from."""
        if min(self.image_size) < 1:
            raise InputError(
                f"image_size: must be at least 1 pixel in height and width, not {self.image_size}"
            )
        low, high = self.disparity_range
        if not low < high:
            raise InputError(f"disparity_range: must be minimum < maximum, not {low} {high}")
        smallest, largest = self.disparity_width
        if not 0.0 < smallest <= largest <= high - low + 1e-6:
            raise InputError(
                f"disparity_width: must be 0 < smallest <= largest <= {high - low:g}, the width of "
                f"disparity_range, not {smallest} {largest}"
            )
        if self.views not in get_args(Arrangement):
            raise InputError(f'views: must be one of {get_args(Arrangement)}, not "{self.views}"')
        v, u = self.grid
        star = self.views not in ("all", "cross")
        if self.views != "all" and (v % 2 == 0 or u % 2 == 0 or (star and v != u)):
            raise InputError(
                f'grid: "{self.views}" needs an odd grid, square for a star: not {v}x{u}'
            )
        if self.rays < 1 or round(self.rays**0.5) ** 2 != self.rays:
            raise InputError(f"rays: must be a square number, not {self.rays}")
        if self.walls < 1 or min(self.sheets, self.solids) < 0 or self.texture_count < 1:
            raise InputError(
                "walls and texture_count must be at least 1, sheets and solids at least 0"
            )
        if sum(dataclasses.astuple(self.textures)) <= 0.0:
            raise InputError("textures: at least one kind must have a frequency above 0")

    @property
    def offsets(self) -> np.ndarray:
        """Offsets of the rendered views from the centre view, in view steps.

        ``[V, U, 2]`` float32 ``(row, column)`` for all views, ``[1, n, 2]`` for a cross or a star.
        The centre view is at ``centre_index`` of the leading axes.

        Example:
            >>> SceneConfig().offsets.shape
            (1, 33, 2)
        """
        offsets = view_offsets(*self.grid)
        return offsets[select_from_grid(offsets, self.views)]


TEXTURED = SceneConfig(
    image_size=(160, 160),
    views="outer_star",
    disparity_width=(1.0, 8.0),
    low_contrast=0.03,
    textureless=0.01,
    calm=0.0,
    highlights=0.2,
    reflections=0.1,
    defects=Defects(noise=0.1, vignetting=0.1, blur=0.2, gamma=0.3, quantisation=0.8),
)
"""Scenes with visible texture on nearly all surfaces, for the proposal network.

Depth edges without texture on either side cannot be located, so nothing is learned from them.
"""
