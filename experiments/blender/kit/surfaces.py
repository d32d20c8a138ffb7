"""Random materials; :mod:`.shading` turns their descriptions into shader nodes."""

from __future__ import annotations

import colorsys
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

Colour = tuple[float, float, float]
"""Linear red, green and blue in [0, 1]."""

GLOSSY_ROUGHNESS = 0.3
"""Roughness below which a surface shows reflections, whose disparity is not the surface's."""


@dataclass(frozen=True)
class Surface:
    """A material.

    Attributes:
        pattern: Name in ``shading.PATTERNS``, which places the colours and the fine relief.
        colours: Linear RGB colours of the pattern, the main one first.
        scale: Size of the pattern's features, in metres.
        finish: Name in ``shading.FINISHES``, which decides how light is scattered.
        roughness: 0 for a mirror to 1 for a matt surface.
        bump: Depth of the fine relief, in metres. The relief changes only the shading normal, so
            the depth of the surface remains that of its mesh.
        seed: Seed of the pattern's random offset.
    """

    pattern: str
    colours: tuple[Colour, ...]
    scale: float = 0.05
    finish: str = "matt"
    roughness: float = 0.6
    bump: float = 0.0
    seed: int = 0

    @property
    def plain(self) -> bool:
        """Whether the surface has no texture."""
        return self.pattern == "plain" and self.bump == 0.0

    @property
    def glossy(self) -> bool:
        """Whether its appearance changes with the view."""
        reflective = self.finish in ("metal", "coated", "plastic")
        return self.finish == "glass" or (reflective and self.roughness < GLOSSY_ROUGHNESS)


def hsv(hue: float, saturation: float, value: float) -> Colour:
    """Return the linear colour of a hue, saturation and value in display space."""
    shown = colorsys.hsv_to_rgb(hue % 1.0, min(saturation, 1.0), min(value, 1.0))
    red, green, blue = (channel**2.2 for channel in shown)
    return red, green, blue


class Palette:
    """Generator of matching colours, and of materials in these colours.

    Args:
        rng: Random generator.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        hue, spread = rng.uniform(), rng.choice([0.06, 0.12, 0.3])
        self._hues = [*(hue + rng.uniform(-spread, spread, 3)), hue + rng.uniform(0.4, 0.6)]
        self._vivid = rng.uniform(0.35, 0.85)

    def colour(self, value: tuple[float, float] = (0.35, 0.9), vivid: float = 1.0) -> Colour:
        """Return a random colour of the palette.

        A quarter are off-white, grey or nearly black; a quarter of the others have any hue.
        """
        rng = self.rng
        if rng.uniform() < 0.25:
            return hsv(rng.uniform(0.05, 0.13), rng.uniform(0.02, 0.18), rng.uniform(0.2, 0.95))
        hue = self._hues[rng.integers(len(self._hues))] + rng.uniform(-0.02, 0.02)
        if rng.uniform() < 0.25:
            hue = rng.uniform()
        return hsv(hue, self._vivid * vivid * rng.uniform(0.6, 1.1), rng.uniform(*value))

    def colours(self, count: int) -> tuple[Colour, ...]:
        """Return several colours of the palette."""
        return tuple(self.colour() for _ in range(count))

    def pick(self, *materials: str, size: float = 0.1) -> Surface:
        """Return a surface of a random one of the materials.

        Args:
            materials: Names of methods of this class that make surfaces.
            size: Size of the object in metres, which scales the pattern.
        """
        surface = getattr(self, str(self.rng.choice(materials)))(size)
        return replace(surface, seed=int(self.rng.integers(1 << 16)))

    def anything(self, size: float) -> Surface:
        """Return a surface of any material that suits a small object."""
        return self.pick(
            *("ceramic", "ceramic", "plastic", "wood", "metal", "stone", "fabric", "painted"),
            *("wax", "rubber"),
            size=size,
        )

    def ceramic(self, size: float) -> Surface:
        """Return a glaze: speckled, banded, spotted or of one colour."""
        pattern = self._choose("plain", "speckle", "bands", "dots", "mottled", "cells")
        return Surface(
            pattern,
            self.colours(3),
            size * self.rng.uniform(0.08, 0.25),
            "coated",
            self.rng.uniform(0.12, 0.5),
        )

    def plastic(self, size: float) -> Surface:
        """Return plastic in bright colours."""
        pattern = self._choose("plain", "plain", "stripes", "dots")
        colours = tuple(self.colour((0.5, 0.95), 1.3) for _ in range(3))
        roughness = self.rng.uniform(0.15, 0.5)
        return Surface(pattern, colours, size * self.rng.uniform(0.1, 0.3), "plastic", roughness)

    def lacquer(self, size: float) -> Surface:
        """Return furniture paint of one muted colour."""
        roughness = self.rng.uniform(0.3, 0.6)
        return Surface("plain", (self.colour((0.3, 0.95), 0.4),), 1.0, "plastic", roughness)

    def rubber(self, size: float) -> Surface:
        """Return matt rubber with a fine grain."""
        return Surface("grainy", self.colours(2), 0.003, "matt", 0.8, 0.0002)

    def wood(self, size: float) -> Surface:
        """Return raw or coated wood, from pale to dark."""
        return Surface(
            "wood",
            self._wood_colours(),
            size * self.rng.uniform(0.12, 0.3),
            self._choose("matt", "coated"),
            self.rng.uniform(0.3, 0.6),
            0.0004,
        )

    def metal(self, size: float) -> Surface:
        """Return brass, copper, steel or worn paint on steel."""
        rng = self.rng
        hue, saturation = rng.choice([(0.11, 0.55), (0.06, 0.5), (0.6, 0.05), (0.1, 0.08)])
        base = hsv(hue, saturation, rng.uniform(0.6, 0.9))
        dark = hsv(hue + 0.02, saturation, rng.uniform(0.3, 0.5))
        pattern = self._choose("plain", "mottled", "brushed", "hammered")
        bump = 0.002 if pattern == "hammered" else 0.0002
        return Surface(
            pattern, (base, dark, base), size * 0.15, "metal", rng.uniform(0.15, 0.45), bump
        )

    def rust(self, size: float) -> Surface:
        """Return rusty iron."""
        colours = (hsv(0.05, 0.7, 0.45), hsv(0.08, 0.6, 0.6), hsv(0.6, 0.1, 0.35))
        return Surface("mottled", colours, size * 0.3, "matt", 0.8, 0.001)

    def stone(self, size: float) -> Surface:
        """Return marble, granite, terrazzo or sandstone."""
        pattern = self._choose("marble", "speckle", "terrazzo", "mottled")
        hue = self.rng.uniform(0.03, 0.15)
        colours = tuple(hsv(hue, self.rng.uniform(0, 0.25), v) for v in (0.85, 0.3, 0.6))
        finish, roughness = self._choose(("coated", 0.2), ("matt", 0.7))
        scale = size * self.rng.uniform(0.1, 0.35)
        return Surface(pattern, colours, scale, finish, roughness, 0.0003)

    def fabric(self, size: float) -> Surface:
        """Return a woven fabric: plain, striped, checked or printed."""
        pattern = self._choose("weave", "stripes", "plaid", "checks", "dots", "mottled")
        scale = 0.006 if pattern == "weave" else max(size * self.rng.uniform(0.04, 0.15), 0.01)
        return Surface(pattern, self.colours(3), scale, "cloth", 0.9, 0.0005)

    def painted(self, size: float) -> Surface:
        """Return a matt painted pattern."""
        pattern = self._choose("checks", "cells", "bands", "mottled", "stripes", "rings")
        return Surface(pattern, self.colours(3), size * self.rng.uniform(0.08, 0.25), "matt", 0.6)

    def paper(self, size: float) -> Surface:
        """Return paper printed with text."""
        paper = hsv(0.12, self.rng.uniform(0.0, 0.15), self.rng.uniform(0.8, 0.95))
        ink = self.colour((0.05, 0.3))
        return Surface("text", (paper, ink), size * self.rng.uniform(0.02, 0.04), "matt", 0.8)

    def picture(self, size: float) -> Surface:
        """Return an abstract painting or a map."""
        pattern = self._choose("abstract", "cells", "map", "terrazzo")
        return Surface(pattern, self.colours(5), size * self.rng.uniform(0.15, 0.4), "matt", 0.6)

    def cover(self, size: float) -> Surface:
        """Return a book cover."""
        pattern = self._choose("plain", "bands", "text", "grainy", "stripes", "abstract")
        colours = tuple(self.colour((0.15, 0.8)) for _ in range(3))
        return Surface(pattern, colours, size * self.rng.uniform(0.05, 0.2), "plastic", 0.5)

    def wax(self, size: float) -> Surface:
        """Return translucent wax."""
        return Surface("plain", (self.colour((0.6, 0.95), 0.8),), size * 0.2, "wax", 0.4)

    def glass(self, size: float) -> Surface:
        """Return clear or tinted glass."""
        tint = hsv(self.rng.uniform(), self.rng.uniform(0.0, 0.35), 0.95)
        return Surface("plain", (tint,), size, "glass", self.rng.choice([0.0, 0.0, 0.25]))

    def fruit(self, size: float) -> Surface:
        """Return the skin of a fruit."""
        hue = self.rng.choice([0.0, 0.03, 0.08, 0.13, 0.25])
        colours = (hsv(hue, 0.85, 0.8), hsv(hue + 0.06, 0.75, 0.85), hsv(hue, 0.9, 0.5))
        return Surface("mottled", colours, size * 0.35, "coated", 0.35, 0.0006)

    def foliage(self, size: float) -> Surface:
        """Return translucent leaves."""
        hue, value = self.rng.uniform(0.2, 0.38), self.rng.uniform(0.3, 0.65)
        saturation = self.rng.uniform(0.45, 0.8)
        light = hsv(hue - 0.05, saturation * 0.8, min(value * 1.5, 0.9))
        return Surface(
            "veins", (hsv(hue, saturation, value), light), size * 0.12, "leaf", 0.45, 0.0005
        )

    def petal(self, size: float) -> Surface:
        """Return the petals of a flower."""
        colour = self.colour((0.7, 0.95), 1.3)
        return Surface("veins", (colour, self.colour((0.7, 0.95))), size * 0.2, "leaf", 0.5)

    def bark(self, size: float) -> Surface:
        """Return bark of twigs and branches."""
        hue = self.rng.uniform(0.05, 0.1)
        return Surface(
            "mottled", tuple(hsv(hue, 0.4, v) for v in (0.35, 0.2, 0.5)), 0.02, "matt", 0.9, 0.003
        )

    def soil(self, size: float) -> Surface:
        """Return potting soil."""
        colours = (hsv(0.07, 0.5, 0.2), hsv(0.07, 0.4, 0.32))
        return Surface("speckle", colours, 0.006, "matt", 1.0, 0.003)

    def moss(self, size: float) -> Surface:
        """Return mossy ground."""
        hue = self.rng.uniform(0.2, 0.3)
        colours = (hsv(hue, 0.6, 0.35), hsv(0.08, 0.5, 0.25), hsv(hue, 0.5, 0.5))
        return Surface("mottled", colours, 0.12, "matt", 1.0, 0.006)

    def gravel(self, size: float) -> Surface:
        """Return ground of pebbles."""
        hue = self.rng.uniform(0.05, 0.12)
        colours = tuple(hsv(hue, self.rng.uniform(0.05, 0.25), v) for v in (0.4, 0.7, 0.55, 0.3))
        return Surface("cells", colours, 0.025, "matt", 0.9, 0.01)

    def terracotta(self, size: float) -> Surface:
        """Return terracotta of flower pots."""
        hue = self.rng.uniform(0.03, 0.07)
        colours = tuple(hsv(hue, s, v) for s, v in ((0.6, 0.7), (0.45, 0.8), (0.65, 0.55)))
        return Surface("mottled", colours, size * 0.3, "matt", 0.8, 0.0006)

    def wall(self, size: float) -> Surface:
        """Return a wall, often with little or no texture."""
        kind = self.rng.choice(["bare", "plaster", "bricks", "paper", "panels"], p=_WALL_SHARES)
        colour = self.colour((0.6, 0.92), 0.5)
        darker = (0.8 * colour[0], 0.8 * colour[1], 0.8 * colour[2])
        other = self.colour((0.5, 0.9), 0.6)
        if kind == "bare":
            return self.paint(size)
        if kind == "plaster":
            return Surface("mottled", (colour, darker, colour), 0.5, "matt", 0.9, 0.004)
        if kind == "bricks":
            brick = hsv(self.rng.uniform(0.01, 0.08), 0.55, 0.55)
            return Surface(
                "bricks", (brick, hsv(0.05, 0.4, 0.4), colour), 0.075, "matt", 0.9, 0.006
            )
        if kind == "panels":
            return Surface("planks", self._wood_colours(), 0.12, "matt", 0.5, 0.002)
        pattern = self._choose("stripes", "dots", "cells", "plaid")
        return Surface(
            pattern, (colour, darker, other), self.rng.uniform(0.04, 0.15), "matt", 0.8, 0.0
        )

    def paint(self, size: float) -> Surface:
        """Return paint without any texture."""
        return Surface("plain", (self.colour((0.6, 0.92), 0.5),), 1.0, "matt", 0.9)

    def floor(self, size: float) -> Surface:
        """Return a floor of boards, tiles, concrete or carpet."""
        kind = self._choose("planks", "planks", "tiles", "tiles", "concrete", "carpet")
        if kind == "planks":
            return Surface("planks", self._wood_colours(), 0.11, "coated", 0.35, 0.001)
        if kind == "tiles":
            glaze = (self.colour((0.5, 0.9), 0.6), self.colour((0.3, 0.9)), hsv(0.1, 0.1, 0.4))
            scale = self.rng.uniform(0.1, 0.25)
            return Surface(self._choose("tiles", "checks"), glaze, scale, "coated", 0.25, 0.001)
        if kind == "concrete":
            colours = tuple(hsv(0.1, 0.06, v) for v in (0.55, 0.4, 0.65))
            return Surface("mottled", colours, 0.6, "matt", 0.6, 0.001)
        return Surface("grainy", self.colours(2), 0.02, "cloth", 1.0, 0.006)

    def table(self, size: float) -> Surface:
        """Return a table top: usually wood, otherwise cloth, stone or paint."""
        return self.pick("wood", "planks", "planks", "fabric", "stone", "painted", size=size)

    def planks(self, size: float) -> Surface:
        """Return parallel boards."""
        return Surface("planks", self._wood_colours(), size * 0.1, "coated", 0.4, 0.0008)

    def _wood_colours(self) -> tuple[Colour, ...]:
        hue, value = self.rng.uniform(0.05, 0.11), self.rng.uniform(0.3, 0.85)
        saturation = self.rng.uniform(0.35, 0.65)
        shades = ((1.0, 1.0), (1.05, 0.65), (0.9, 1.15))
        return tuple(hsv(hue, min(saturation * s, 1.0), min(value * v, 0.95)) for s, v in shades)

    def _choose(self, *choices):
        return choices[self.rng.integers(len(choices))]


_WALL_SHARES: Sequence[float] = (0.4, 0.25, 0.13, 0.14, 0.08)
