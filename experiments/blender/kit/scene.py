"""Random scenes: objects, lights and camera."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from . import furniture, plants, props
from .mesh import box, displace, pose, sheet
from .parts import Part, Thing, choose, place, scatter
from .surfaces import Colour, Palette, hsv

QUARTER = np.pi / 2.0


class Light(NamedTuple):
    """A lamp.

    Attributes:
        kind: ``"AREA"`` (a square that shines towards its target) or ``"SUN"``.
        location: Position in metres; for a sun only the direction to the target matters.
        target: Point that it shines at, in metres.
        size: Side of the square in metres, or angular diameter of the sun in radians.
        power: Watts for an area light, watts per square metre for a sun.
        colour: Linear RGB.
    """

    kind: str
    location: tuple[float, float, float]
    target: tuple[float, float, float]
    size: float
    power: float
    colour: Colour


class Sky(NamedTuple):
    """Environment light: a gradient from horizon to zenith, visible in reflections."""

    zenith: Colour
    horizon: Colour
    strength: float
    seed: int


@dataclass(frozen=True)
class SceneDescription:
    """Description of a scene and its centre camera.

    Attributes:
        style: Name in :data:`STYLES`.
        parts: Objects; an object's number is its index here plus 1.
        lights: Lamps.
        sky: Environment light.
        eye: Position of the centre camera, in metres.
        target: Point that the centre camera looks at, in metres.
        lens_mm: Focal length on a sensor 36 mm wide.
        disparity_range: Minimum and maximum disparity of the centre view, pixels per view step;
            baseline and focus distance are fitted to it.
    """

    style: str
    parts: tuple[Part, ...]
    lights: tuple[Light, ...]
    sky: Sky
    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    lens_mm: float
    disparity_range: tuple[float, float]


def make_scene(seed: int, style: str = "mixed") -> SceneDescription:
    """Return the random scene of a seed.

    Args:
        seed: Seed of all random choices.
        style: Name in :data:`STYLES`, or ``"mixed"`` to choose one of them by the seed.
    """
    if style == "mixed":
        style = list(STYLES)[seed % len(STYLES)]
    rng = np.random.default_rng([seed, list(STYLES).index(style)])
    parts, lights, sky, eye, target, lens_mm = STYLES[style](Palette(rng))
    wide = 3.5 if rng.uniform() < 0.25 else 2.0
    low, high = rng.uniform(0.5, 1.0, 2) * wide
    return SceneDescription(
        style, tuple(parts), tuple(lights), sky, eye, target, lens_mm, (-low, high)
    )


Ingredients = tuple[
    Thing, list[Light], Sky, tuple[float, float, float], tuple[float, float, float], float
]
"""Parts, lights, sky, eye, target and focal length."""


def still_life(palette: Palette) -> Ingredients:
    """Make a close view of objects on a table in front of a wall."""
    rng = palette.rng
    if rng.uniform() < 0.25:
        parts = furniture.backdrop(palette, 2.4, 1.6, 1.6)
    else:
        top = Part(box(2.2, 1.3, 0.03, 0.006), palette.pick("table", size=0.6), pose((0, 0, -0.03)))
        behind = pose((0, rng.uniform(0.7, 1.3), 0.5), roll=QUARTER)
        back = Part(sheet(5, 4), palette.pick("wall"), behind)
        parts = [top, back]
        if rng.uniform() < 0.3:
            cloth = furniture.drape(palette, 1.1, 0.7)
            parts += place(cloth, (0, 0, 0.0), rng.uniform(-0.4, 0.4))
    things = [choose(rng, props.LARGE)(palette) for _ in range(rng.integers(4, 7))]
    things += [choose(rng, props.SMALL)(palette) for _ in range(rng.integers(20, 32))]
    things += [plants.potted(palette) for _ in range(rng.integers(1, 4))]
    back_row = [thing for thing in things if _tall(thing)]
    taken: list[tuple[float, float, float]] = []
    parts += scatter(rng, back_row, (-0.4, 0.4, 0.02, 0.35), taken=taken)
    low = [thing for thing in things if not _tall(thing)]
    parts += scatter(rng, low, (-0.33, 0.33, -0.28, 0.25), taken=taken)
    height, distance = rng.uniform(0.3, 0.7), rng.uniform(0.85, 1.05)
    eye = (rng.uniform(-0.3, 0.3), -distance, height)
    return parts, _lamps(rng, 1.0), _sky(rng, 0.6), eye, (0.0, 0.0, 0.06), rng.uniform(50, 62)


def _tall(thing: Thing) -> bool:
    return bool(max(part.mesh.vertices[:, 2].max() + part.matrix[2, 3] for part in thing) > 0.13)


def room(palette: Palette) -> Ingredients:
    """Make the corner or the end of a furnished room."""
    rng = palette.rng
    width, depth, height = rng.uniform(3.8, 4.6), rng.uniform(1.6, 2.4), rng.uniform(3.2, 3.6)
    wall = palette.pick("wall")
    side_wall = wall if rng.uniform() < 0.6 else palette.pick("wall")
    parts: Thing = [
        Part(sheet(width + 4, 8), palette.pick("floor"), pose((0, depth - 4, 0))),
        Part(sheet(width + 4, height), wall, pose((0, depth, height / 2), roll=QUARTER)),
        Part(
            box(width, 0.02, 0.1),
            palette.pick("lacquer", "wood", size=1.0),
            pose((0, depth - 0.01, 0)),
        ),
    ]
    side = rng.choice([-1.0, 1.0])
    sides = (side,) if rng.uniform() < 0.5 else (-1.0, 1.0)
    for s in sides:
        turned = pose((s * width / 2, depth - 2, height / 2), turn=-s * QUARTER)
        upright = turned @ pose(roll=QUARTER)
        parts.append(Part(sheet(4, height), side_wall, upright))
    parts += _back_wall(palette, width, depth, height)
    if rng.uniform() < 0.7:
        rug = furniture.rug(palette, 1.8, 1.2)
        parts += place(rug, (rng.uniform(-0.5, 0.5), 0, 0), rng.uniform(-0.3, 0.3))
    make_middle = (
        furniture.laid_table,
        furniture.laid_table,
        furniture.chair,
        furniture.floor_lamp,
    )
    middle = [make(palette) for make in make_middle]
    middle += [furniture.chair(palette)] * int(rng.integers(0, 2))
    middle += [plants.potted(palette, rng.uniform(3.0, 5.0)) for _ in range(rng.integers(1, 4))]
    middle += [place(props.vase(palette), scale=rng.uniform(2.0, 3.0)) for _ in range(2)]
    middle += [place(props.basket(palette), scale=rng.uniform(1.5, 3.0))]
    edge = width / 2 - 0.4
    parts += scatter(rng, middle, (-edge, edge, -0.7, depth - 0.9), gap=0.03)
    for _ in range(rng.integers(0, 3)):
        lamp = furniture.hanging_lamp(palette, rng.uniform(1.0, 1.7))
        parts += place(lamp, (rng.uniform(-1, 1), rng.uniform(-0.5, depth - 0.6), height))
    eye = (-side * rng.uniform(0.0, 0.7), -rng.uniform(2.2, 2.9), rng.uniform(1.0, 1.6))
    target = (side * rng.uniform(0.0, 0.4), 0.4 * depth, rng.uniform(0.7, 1.0))
    return parts, _lamps(rng, 1.7, 0.8), _sky(rng, 1.0), eye, target, rng.uniform(35, 43)


def _back_wall(palette: Palette, width: float, depth: float, height: float) -> Thing:
    """Make the furniture along the far wall and the objects that hang above it."""
    rng = palette.rng
    parts: Thing = []
    x = -width / 2 + 0.1
    while x < width / 2 - 0.5:
        kind = rng.choice(["shelf", "sofa", "window", "pictures", "radiator"])
        space = width / 2 - x
        if kind == "shelf":
            columns = min(int(rng.integers(1, 4)), int(space / 0.42))
            unit = furniture.shelf(palette, columns, int(rng.integers(2, 7)))
            parts += place(unit, (x + 0.21 * columns, depth - 0.18, 0.0))
            x += 0.42 * columns + 0.1
            continue
        extent = min(space - 0.1, rng.uniform(1.2, 2.0))
        middle = x + extent / 2
        if kind == "sofa" and extent > 1.1:
            unit = place(furniture.sofa(palette), scale=extent / 2.2)
            parts += place(unit, (middle, depth - 0.5, 0.0))
        if kind in ("sofa", "pictures"):
            hung = furniture.wall_pictures(palette, extent, 1.1, 1.5)
            parts += place(hung, (middle, depth, 0.0))
        if kind == "radiator":
            parts += place(furniture.radiator(palette, 0.7 * extent), (middle, depth - 0.08, 0.0))
        if kind in ("radiator", "window"):
            parts += place(
                furniture.window(palette, 0.6 * extent, 1.2), (middle, depth - 0.03, 0.95)
            )
            parts += _garden(palette, middle, depth, 0.6 * extent)
        if kind == "window":
            for edge in (-0.42, 0.42):
                cloth = furniture.curtain(palette, 0.3 * extent, 2.4)
                parts += place(cloth, (middle + edge * extent, depth - 0.1, 0.0))
        x += extent + rng.uniform(0.0, 0.2)
    return parts


def _garden(palette: Palette, middle: float, depth: float, width: float) -> Thing:
    """Make the view through a window: a picture just in front of the wall, which has no hole."""
    upright = pose((middle, depth - 0.008, 1.55), roll=QUARTER)
    return [Part(sheet(width, 1.2), palette.pick("picture", size=1.5), upright)]


def shelf(palette: Palette) -> Ingredients:
    """Make a front view of a full shelf with plants and cables before it."""
    rng = palette.rng
    columns, rows = int(rng.integers(4, 6)), int(rng.integers(4, 6))
    unit = furniture.shelf(palette, columns, rows, rng.uniform(0.34, 0.46), rng.uniform(0.27, 0.34))
    behind = Part(sheet(6, 5), palette.pick("wall"), pose((0, 0.3, 1), roll=QUARTER))
    ground = Part(sheet(6, 5), palette.pick("floor"), pose((0, -2.2, 0.0)))
    parts = [behind, ground, *unit]
    middle = 0.15 * rows
    for x in (-0.45, 0.45):
        if rng.uniform() < 0.6:
            plant = plants.potted(palette, rng.uniform(1.3, 2.2))
            spot = (x + rng.uniform(-0.1, 0.1), rng.uniform(-0.5, -0.35), middle - 0.45)
            parts += place(plant, spot)
    for _ in range(rng.integers(0, 4)):
        ends = rng.uniform(-1.2, 1.2, 2)
        start, end = (ends[0], -0.3, 2 * middle + 0.5), (ends[1], -0.5, 2 * middle + 0.6)
        parts += furniture.hanging_cable(palette, start, end, rng.uniform(0.3, 0.9))
    eye = (rng.uniform(-0.5, 0.5), -rng.uniform(1.25, 1.6), middle + rng.uniform(-0.1, 0.4))
    lamps, sky = _lamps(rng, 2.0, middle - 0.5), _sky(rng, 1.0)
    return parts, lamps, sky, eye, (0.0, 0.0, middle), rng.uniform(42, 52)


def garden(palette: Palette) -> Ingredients:
    """Make plants, stones and pots before a wall, with branches at the sides."""
    rng = palette.rng
    ground = displace(sheet(3, 3, 150, 150), rng, 0.05, 0.5)
    soil = palette.pick("soil", "moss", "moss", "gravel", size=0.3)
    parts: Thing = [Part(ground, soil, pose((0, 0.2, -0.03)))]
    wall = palette.pick("wall")
    parts.append(Part(sheet(6, 4), wall, pose((0, rng.uniform(0.7, 1.3), 0.8), roll=QUARTER)))
    if rng.uniform() < 0.5:
        fence = furniture.lattice(palette, 3.0, rng.uniform(0.5, 1.2))
        parts += place(fence, (0.0, rng.uniform(0.4, 0.65), 0.0))
    kinds = (plants.bush, plants.broad, plants.grass, plants.grass, plants.fern, plants.flower)
    green = [place(choose(rng, kinds)(palette), scale=rng.uniform(0.8, 2.2)) for _ in range(34)]
    pots = [plants.potted(palette, rng.uniform(1.2, 1.8)) for _ in range(rng.integers(2, 5))]
    rocks = [place(props.stone(palette), scale=rng.uniform(0.5, 1.8)) for _ in range(14)]
    rocks += [props.monument(palette), props.basket(palette), props.ball(palette)]
    taken: list[tuple[float, float, float]] = []
    parts += scatter(rng, pots, (-0.5, 0.5, -0.2, 0.4), taken=taken)
    parts += scatter(rng, rocks, (-0.6, 0.6, -0.45, 0.4), taken=taken, height=-0.012)
    parts += scatter(rng, green, (-0.65, 0.65, -0.45, 0.5), taken=taken, gap=-0.2, height=-0.02)
    for side in (-1.0, 1.0):
        if rng.uniform() < 0.7:
            reach = plants.branch(palette, rng.uniform(0.35, 0.6), leafy=rng.uniform() < 0.7)
            foot = (side * 0.62, rng.uniform(-0.5, 0.2), rng.uniform(0.25, 0.5))
            parts += place(reach, foot, turn=(np.pi if side > 0 else 0.0) + rng.normal(0, 0.3))
    eye = (rng.uniform(-0.3, 0.3), -rng.uniform(1.1, 1.3), rng.uniform(0.3, 0.65))
    return parts, _lamps(rng, 1.4), _sky(rng, 1.0), eye, (0.0, 0.0, 0.17), rng.uniform(40, 50)


def wires(palette: Palette) -> Ingredients:
    """Make a workshop: cables, springs and lattices in the air above a bench."""
    rng = palette.rng
    bench = Part(box(2.4, 1.2, 0.05, 0.005), palette.pick("table", size=0.7), pose((0, 0.1, -0.05)))
    wall = Part(sheet(5, 4), palette.pick("wall"), pose((0, 0.7, 0.6), roll=QUARTER))
    parts: Thing = [bench, wall]
    things = [choose(rng, props.SMALL + props.LARGE)(palette) for _ in range(22)]
    things += [make(palette) for make in (props.cable, props.spring, props.jack, props.knot)]
    parts += scatter(rng, things, (-0.45, 0.45, -0.35, 0.45))
    parts += place(
        furniture.lattice(palette, 2.6, 1.3), (0, 0.6, -0.1), roll=rng.uniform(-0.1, 0.1)
    )
    for _ in range(rng.integers(3, 8)):
        x, y = rng.uniform(-0.6, 0.6, 2), rng.uniform(-0.3, 0.5, 2)
        start, end = (x[0], y[0], 0.75), (x[1], y[1], rng.uniform(0.3, 0.75))
        parts += furniture.hanging_cable(palette, start, end, rng.uniform(0.0, 0.35))
    for _ in range(rng.integers(4, 9)):  # objects on strings
        kinds = (props.ring, props.knot, props.ball, props.jack, props.figure, props.apple)
        thing = choose(rng, kinds)
        spot = (rng.uniform(-0.4, 0.4), rng.uniform(-0.3, 0.4), rng.uniform(0.12, 0.42))
        parts += place(thing(palette), spot, *rng.uniform(0, 6, 3), scale=rng.uniform(0.8, 1.5))
        parts += furniture.hanging_cable(palette, spot, (spot[0], spot[1], 1.0), 0.0)
    if rng.uniform() < 0.25:
        near = furniture.lattice(palette, 1.6, 1.2)
        parts += place(near, (0, -0.5, -0.1), turn=rng.uniform(-0.3, 0.3))
    eye = (rng.uniform(-0.3, 0.3), -rng.uniform(0.95, 1.2), rng.uniform(0.25, 0.5))
    return parts, _lamps(rng, 1.2), _sky(rng, 0.7), eye, (0.0, 0.0, 0.18), rng.uniform(44, 54)


STYLES: dict[str, Callable[[Palette], Ingredients]] = {
    make.__name__: make for make in (still_life, room, garden, shelf, wires)
}


def _lamps(rng: np.random.Generator, reach: float, level: float = 0.0) -> list[Light]:
    """Make a key light, usually a weaker fill light from the other side, and sometimes a sun.

    Args:
        rng: Random generator.
        reach: Distance of the lamps, in metres.
        level: Height of the lit objects, in metres.
    """
    side = rng.choice([-1.0, 1.0])
    warm, cool = hsv(0.09, rng.uniform(0.05, 0.4), 1.0), hsv(0.6, rng.uniform(0.0, 0.3), 1.0)
    aim = (0.0, 0.0, 0.1 + level)
    x, y = side * rng.uniform(0.5, 1.1) * reach, -rng.uniform(0.3, 1.0) * reach
    key = (x, y, 1.1 * reach + level)
    power = 40.0 * reach**2
    lights = [Light("AREA", key, aim, reach * rng.uniform(0.15, 0.8), power, warm)]
    if rng.uniform() < 0.7:
        fill = (-side * reach, -rng.uniform(0.0, 0.7) * reach, rng.uniform(0.4, 1.0) * reach)
        share = rng.uniform(0.15, 0.5)
        lights.append(Light("AREA", fill, aim, reach, share * power, cool))
    if rng.uniform() < 0.3:
        above = (-side * rng.uniform(0.3, 1.0), -rng.uniform(0.3, 1.0), 1.0)
        lights.append(Light("SUN", above, (0, 0, 0), rng.uniform(0.01, 0.06), 3.0, warm))
    return lights


def _sky(rng: np.random.Generator, strength: float) -> Sky:
    """Make a random environment light, from dim to bright."""
    hue = rng.choice([0.58, 0.6, 0.1])
    zenith, horizon = hsv(hue, rng.uniform(0.0, 0.4), 0.9), hsv(0.1, rng.uniform(0.0, 0.2), 1.0)
    return Sky(zenith, horizon, strength * rng.uniform(0.4, 1.2), int(rng.integers(1 << 16)))
