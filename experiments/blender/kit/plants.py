"""Plants with thin stems, many leaves, and gaps that show what is behind."""

from __future__ import annotations

import numpy as np

from .mesh import Mesh, curve, displace, ellipsoid, join, lathe, leaf, pose, transform, tube
from .parts import Part, Thing, place
from .surfaces import Palette

TURN = 2.0 * np.pi
GOLDEN = 2.39996
"""Golden angle between successive leaves of a stem, in radians."""


def potted(palette: Palette, scale: float = 1.0) -> Thing:
    """Make a random plant in a pot."""
    rng = palette.rng
    radius, height = rng.uniform(0.035, 0.055), rng.uniform(0.05, 0.08)
    profile = np.array(
        [[0, 0], [0.7, 0], [0.95, 0.85], [1.08, 0.86], [1.1, 1], [0.95, 1], [0.9, 0.8], [0, 0.8]]
    )
    pot = lathe(profile * [radius, height], smooth=False)
    soil = displace(
        lathe(np.array([[0, 0.86], [0.45, 0.85], [0.92, 0.84]]) * [radius, height]),
        rng,
        0.002,
        0.01,
    )
    plant = [bush, broad, grass, fern, cactus, flower, flower][rng.integers(7)](palette)
    parts = [
        Part(pot, palette.pick("terracotta", "ceramic", "plastic", "stone", size=0.08)),
        Part(soil, palette.pick("soil")),
        *place(plant, (0.0, 0.0, 0.82 * height)),
    ]
    return place(parts, scale=scale)


def bush(palette: Palette) -> Thing:
    """Make a bush: stems with small leaves along their whole length."""
    rng = palette.rng
    leaves, stems = [], []
    length, width = rng.uniform(0.025, 0.045), rng.uniform(0.4, 0.7)
    for k in range(rng.integers(5, 10)):
        path = _stem(rng, rng.uniform(0.1, 0.2), GOLDEN * k, rng.uniform(0.1, 0.6))
        stems.append(tube(path, np.linspace(0.002, 0.0008, len(path)), 6))
        for j, at in enumerate(range(4, len(path), 2)):
            size = length * rng.uniform(0.6, 1.1)
            shape = leaf(size, width * size, bend=rng.uniform(0.2, 1.0), fold=0.3)
            leaves.append(
                (shape, pose(path[at], GOLDEN * j + rng.normal(0, 0.3), rng.uniform(-0.8, 0.2)))
            )
    return _leafy(palette, leaves, stems)


def broad(palette: Palette) -> Thing:
    """Make a plant of large single leaves on long stalks."""
    rng = palette.rng
    leaves, stems = [], []
    for k in range(rng.integers(7, 14)):
        path = _stem(rng, rng.uniform(0.07, 0.17), GOLDEN * k, rng.uniform(0.2, 0.8))
        stems.append(tube(path, 0.0017, 6))
        size = rng.uniform(0.06, 0.1)
        shape = leaf(size, rng.uniform(0.45, 0.75) * size, bend=rng.uniform(0.6, 1.5), fold=0.25)
        leaves.append((shape, pose(path[-1], GOLDEN * k, rng.uniform(-0.6, 0.1))))
    return _leafy(palette, leaves, stems)


def grass(palette: Palette) -> Thing:
    """Make a tuft of narrow blades."""
    rng = palette.rng
    blades = []
    for k in range(rng.integers(35, 70)):
        size = rng.uniform(0.1, 0.2)
        shape = leaf(
            size, rng.uniform(0.004, 0.008), bend=rng.uniform(0.3, 1.8), fold=0.3, steps=14
        )
        foot = (*rng.normal(0, 0.012, 2), 0.0)
        blades.append((shape, pose(foot, GOLDEN * k, rng.uniform(-1.45, -0.8))))
    return _leafy(palette, blades, [])


def fern(palette: Palette) -> Thing:
    """Make a fern: fronds with leaflets on both sides."""
    rng = palette.rng
    leaves, stems = [], []
    for k in range(rng.integers(7, 12)):
        turn = GOLDEN * k
        path = _stem(rng, rng.uniform(0.14, 0.22), turn, rng.uniform(0.7, 1.2), sag=1.3)
        stems.append(tube(path, np.linspace(0.0015, 0.0005, len(path)), 6))
        for at in range(5, len(path)):
            size = 0.032 * np.sin(np.pi * (at / len(path)) ** 0.7) + 0.004
            for side in (-1.3, 1.3):
                shape = leaf(size, 0.3 * size, bend=0.5, fold=0.2, steps=6)
                leaves.append((shape, pose(path[at], turn + side, rng.uniform(-0.1, 0.3))))
    return _leafy(palette, leaves, stems)


def cactus(palette: Palette) -> Thing:
    """Make a cactus with ribs and thorns."""
    rng = palette.rng
    ribs, width, height = rng.integers(8, 15), rng.uniform(0.05, 0.08), rng.uniform(0.06, 0.15)
    body = ellipsoid((width, width, height), 0.85, 64)
    angle = np.arctan2(body.vertices[:, 1], body.vertices[:, 0])
    swell = 1.0 + 0.1 * np.cos(ribs * angle)
    body = body._replace(vertices=body.vertices * np.stack([swell, swell, swell**0], 1))
    thorns, taper = [], np.array([0.0005, 0.0004, 0.0001])
    for turn in TURN * np.arange(ribs) / ribs:
        for level in np.linspace(-0.6, 0.8, 9):
            out = 0.55 * width * np.sqrt(1.0 - level**2)
            foot = np.array([out * np.cos(turn), out * np.sin(turn), (level + 1.0) * height / 2])
            for _ in range(3):
                tip = foot + 0.012 * (foot / (np.linalg.norm(foot) + 0.02) + rng.normal(0, 0.5, 3))
                thorns.append(tube(np.stack([foot, (foot + tip) / 2, tip]), taper, 4))
    skin = palette.pick("foliage", size=0.1)
    return [Part(body, skin), Part(join(*thorns), palette.pick("wax", size=0.01))]


def flower(palette: Palette) -> Thing:
    """Make flowers: blossoms on stems with a few leaves."""
    rng = palette.rng
    leaves, stems, petals, hearts = [], [], [], []
    count = rng.integers(5, 14)
    size = rng.uniform(0.018, 0.035)
    for k in range(rng.integers(4, 9)):
        path = _stem(rng, rng.uniform(0.12, 0.22), GOLDEN * k, rng.uniform(0.05, 0.5))
        stems.append(tube(path, 0.0015, 6))
        for at in (5, 8):
            shape = leaf(0.05, 0.016, bend=1.0, fold=0.3)
            leaves.append((shape, pose(path[at], rng.uniform(0, TURN), -0.7)))
        lean = pose(path[-1], rng.uniform(0, TURN), rng.uniform(0.0, 0.8))
        for turn in TURN * np.arange(count) / count:
            shape = leaf(size, rng.uniform(0.3, 0.5) * size, bend=rng.uniform(-0.3, 0.6), fold=0.2)
            petals.append((shape, lean @ pose(turn=turn, tilt=rng.uniform(-0.5, -0.2))))
        hearts.append(transform(ellipsoid((0.3 * size, 0.3 * size, 0.2 * size), steps=12), lean))
    return [
        *_leafy(palette, leaves, stems),
        Part(join(*(transform(*petal) for petal in petals)), palette.pick("petal", size=size)),
        Part(join(*hearts), palette.pick("fruit", size=0.01)),
    ]


def branch(palette: Palette, length: float = 0.5, leafy: bool = True) -> Thing:
    """Make a branch with twigs along ``+x``, bare or with leaves."""
    rng = palette.rng
    twigs: list[Mesh] = []
    leaves: list[tuple[Mesh, np.ndarray]] = []

    def grow(
        foot: np.ndarray, direction: np.ndarray, size: float, radius: float, depth: int
    ) -> None:
        bends = np.cumsum(rng.normal(0.0, 0.12, (6, 3)), axis=0) + direction
        steps = bends / np.linalg.norm(bends, axis=1, keepdims=True) * size / 6
        path = curve(np.concatenate([foot[None], foot + np.cumsum(steps, axis=0)]), 4)
        twigs.append(tube(path, np.linspace(radius, 0.5 * radius, len(path)), 8 if depth else 5))
        if depth:
            for at in rng.choice(np.arange(4, len(path)), 5, replace=False):
                way = direction + rng.normal(0.0, 0.6, 3)
                grow(path[at], way / np.linalg.norm(way), 0.5 * size, 0.5 * radius, depth - 1)
        elif leafy:
            for at in rng.choice(np.arange(4, len(path)), 6):
                extent = 0.09 * length * rng.uniform(0.6, 1.2)
                shape = leaf(extent, 0.5 * extent, bend=rng.uniform(0.2, 1.2), fold=0.3, steps=7)
                leaves.append((shape, pose(path[at], rng.uniform(0, TURN), rng.uniform(-0.8, 0.8))))

    grow(np.zeros(3), np.array([1.0, 0.0, 0.1]), length, 0.014 * length, 2)
    bark = Part(join(*twigs), palette.pick("bark"))
    return [bark, *(_leafy(palette, leaves, []) if leaves else [])]


def _stem(rng, length: float, turn: float, lean: float, sag: float = 0.6) -> np.ndarray:
    """Return ``[16, 3]`` points of a stalk from the origin that sags towards its end."""
    angle = lean + sag * np.linspace(0.0, 1.0, 15) ** 2 * rng.uniform(0.3, 1.0)
    heading = turn + np.cumsum(rng.normal(0.0, 0.06, 15))
    steps = np.stack(
        [np.sin(angle) * np.cos(heading), np.sin(angle) * np.sin(heading), np.cos(angle)], 1
    )
    return np.concatenate([np.zeros((1, 3)), np.cumsum(steps * length / 15, axis=0)])


def _leafy(palette: Palette, leaves: list[tuple[Mesh, np.ndarray]], stems: list[Mesh]) -> Thing:
    """Join leaves into parts of two alternating shades, and the stems into one part."""
    shades = [palette.pick("foliage", size=0.05)] * 2
    shades[1] = palette.pick("foliage", size=0.05) if palette.rng.uniform() < 0.3 else shades[0]
    parts = [
        Part(join(*(transform(*one) for one in leaves[k::2])), shade)
        for k, shade in enumerate(shades)
        if leaves[k::2]
    ]
    if stems:
        parts.append(Part(join(*stems), palette.pick("foliage", size=0.2)))
    return parts
