"""Small objects for tables and shelves; each function makes a random one."""

from __future__ import annotations

import numpy as np

from .mesh import (
    box,
    curve,
    displace,
    ellipsoid,
    grid,
    join,
    lathe,
    move,
    pose,
    sheet,
    transform,
    tube,
)
from .parts import Part, Thing, place, stand, top
from .surfaces import Palette

TURN = 2.0 * np.pi


def vase(palette: Palette) -> Thing:
    """Make a turned vessel with a wall and an opening."""
    rng = palette.rng
    height, widest = rng.uniform(0.1, 0.26), rng.uniform(0.03, 0.065)
    levels = np.linspace(0.0, 1.0, 6)
    radii = widest * rng.uniform(0.45, 1.0, 6)
    radii[rng.integers(1, 4)] = widest
    outside = np.stack([radii, levels * height], 1)
    inside = outside[::-1] * [0.9, 1.0]
    profile = np.concatenate([[[0.0, 0.0]], outside, inside[:-1], [[0.0, 0.1 * height]]])
    mesh = lathe(profile)
    if rng.uniform() < 0.3:  # fluted
        angle = np.arctan2(mesh.vertices[:, 1], mesh.vertices[:, 0])
        flutes = 1.0 + 0.05 * np.cos(rng.integers(6, 16) * angle)
        mesh = mesh._replace(vertices=mesh.vertices * np.stack([flutes, flutes, flutes**0], 1))
    material = palette.pick("ceramic", "ceramic", "ceramic", "stone", "metal", "glass", size=0.15)
    return [Part(mesh, material)]


def cup(palette: Palette) -> Thing:
    """Make a mug with a handle, with or without a saucer, full or empty."""
    rng = palette.rng
    height, radius = rng.uniform(0.06, 0.1), rng.uniform(0.03, 0.045)
    belly = radius * rng.uniform(0.8, 1.1)
    radii = (0.0, 0.7 * radius, belly, radius, radius - 0.004, belly - 0.005, 0.0)
    profile = np.stack([radii, (0, 0, 0.4 * height, height, height, 0.4 * height, 0.008)], 1)
    material = palette.pick("ceramic", "ceramic", "metal", "plastic", size=0.1)
    across = (radius - 0.004, radius + 0.028, radius + 0.024, belly - 0.006)
    handle = curve(
        np.stack([across, np.zeros(4), height * np.array([0.8, 0.75, 0.35, 0.22])], 1), 8
    )
    parts = [Part(lathe(profile), material), Part(tube(handle, 0.005, 10), material)]
    if rng.uniform() < 0.6:
        disc = lathe(
            np.array([[0.0, 0.75 * height], [radius * 0.93, 0.751 * height]]), smooth=False
        )
        parts.append(Part(disc, palette.pick("soil" if rng.uniform() < 0.5 else "plastic")))
    if rng.uniform() < 0.5:
        saucer = plate(palette, 2.0 * radius)
        parts = [*saucer, *place(parts, (0.0, 0.0, 0.008))]
    return parts


def plate(palette: Palette, radius: float | None = None) -> Thing:
    """Make a plate with a rim."""
    radius = radius or palette.rng.uniform(0.07, 0.13)
    profile = radius * np.array(
        [[0, 0], [0.6, 0], [0.95, 0.13], [1, 0.16], [0.93, 0.15], [0.62, 0.05], [0, 0.05]]
    )
    return [Part(lathe(profile), palette.pick("ceramic", "ceramic", "wood", "metal", size=radius))]


def bowl_of_fruit(palette: Palette) -> Thing:
    """Make a bowl with fruit heaped in it."""
    rng = palette.rng
    radius = rng.uniform(0.08, 0.12)
    profile = radius * np.stack(
        [(0, 0.5, 0.85, 1, 0.96, 0.78, 0.4, 0), (0, 0, 0.3, 0.7, 0.71, 0.32, 0.08, 0.08)], 1
    )
    parts = [Part(lathe(profile), palette.pick("ceramic", "wood", "metal", "glass", size=radius))]
    kind = (apple, orange, lemon)[rng.choice(3)]
    layers = ((5, 0.5, 0.2), (4, 0.45, 0.75), (1, 0.0, 1.15))
    for count, distance, level in layers:
        for angle in TURN * (np.arange(count) + rng.uniform()) / count:
            fruit = kind(palette) if rng.uniform() < 0.7 else apple(palette)
            spot = radius * np.array([distance * np.cos(angle), distance * np.sin(angle), level])
            size = 0.36 * radius / 0.037
            parts += place(fruit, spot, *rng.uniform(0, 0.6, 2), scale=size)
    return parts


def apple(palette: Palette) -> Thing:
    """Make an apple with its stalk."""
    rng = palette.rng
    profile = 0.037 * np.array(
        [[0, 0.12], [0.35, 0.0], [0.8, 0.35], [1, 1], [0.75, 1.65], [0.35, 1.8], [0, 1.55]]
    )
    body = displace(lathe(profile), rng, 0.002, 0.05)
    stalk = tube([[0, 0, 0.055], [0.001, 0, 0.065], [0.006, 0.002, 0.077]], 0.0015, 6)
    return [Part(body, palette.pick("fruit", size=0.07)), Part(stalk, palette.pick("bark"))]


def orange(palette: Palette) -> Thing:
    """Make an orange."""
    size = 0.074
    mesh = displace(ellipsoid((size, size, 0.95 * size)), palette.rng, 0.001, 0.004)
    return [Part(mesh, palette.pick("fruit", size=size))]


def lemon(palette: Palette) -> Thing:
    """Make a lemon that lies on its side."""
    radii = (0, 0.006, 0.012, 0.026, 0.025, 0.01, 0)
    profile = np.stack([radii, (0, 0.003, 0.012, 0.035, 0.055, 0.076, 0.082)], 1)
    mesh = displace(lathe(profile), palette.rng, 0.0012, 0.012)
    return stand([Part(mesh, palette.pick("fruit", size=0.06), pose(tilt=1.5))])


def pear(palette: Palette) -> Thing:
    """Make a pear."""
    profile = 0.035 * np.array(
        [[0, 0.1], [0.5, 0], [1, 0.8], [0.75, 1.7], [0.42, 2.4], [0.25, 2.8], [0, 2.85]]
    )
    stalk = tube([[0, 0, 0.095], [0.003, 0, 0.11], [0.009, 0, 0.12]], 0.0018, 6)
    body = displace(lathe(profile), palette.rng, 0.0025, 0.05)
    return [Part(body, palette.pick("fruit", size=0.08)), Part(stalk, palette.pick("bark"))]


def book(palette: Palette, width=None, depth=None, height=None) -> Thing:
    """Make a closed book that lies flat."""
    rng = palette.rng
    width = width or rng.uniform(0.11, 0.17)
    depth = depth or width * rng.uniform(1.2, 1.5)
    height = height or rng.uniform(0.012, 0.045)
    board = 0.003
    material = palette.pick("cover", size=width)
    boards = [
        Part(move(box(width, depth, board, 0.001), (0, 0, level)), material)
        for level in (0.0, height - board)
    ]
    spine = move(box(board, depth, height, 0.001), (-width / 2, 0, 0))
    pages = box(width - 0.008, depth - 0.008, height - 2 * board)
    edges = palette.pick("paper", size=0.05)
    return [*boards, Part(spine, material), Part(move(pages, (-0.002, 0, board)), edges)]


def book_pile(palette: Palette) -> Thing:
    """Make a pile of books, sometimes with an object on top."""
    rng = palette.rng
    parts: Thing = []
    level, width = 0.0, rng.uniform(0.14, 0.18)
    for _ in range(rng.integers(2, 6)):
        width *= rng.uniform(0.9, 1.0)
        one = book(palette, width)
        parts += place(one, (*rng.uniform(-0.01, 0.01, 2), level), rng.normal(0.0, 0.15))
        level += top(one) + 0.0003
    if rng.uniform() < 0.6:
        small = [cup, apple, pear, stone, block_tower, candle, figure][rng.integers(7)]
        parts += place(small(palette), (0.0, 0.0, level))
    return parts


def open_book(palette: Palette) -> Thing:
    """Make an open book with curved pages."""
    rng = palette.rng
    width, depth = rng.uniform(0.1, 0.13), rng.uniform(0.16, 0.2)
    x = np.linspace(-1.0, 1.0, 41)
    height = 0.012 + 0.02 * np.sqrt(np.abs(x)) * (1.0 - 0.7 * np.abs(x))
    points = np.empty((2, 41, 3))
    points[..., 0], points[..., 2] = x * width, height
    points[0, :, 1], points[1, :, 1] = -depth / 2, depth / 2
    cover = box(2.1 * width, depth * 1.04, 0.008, 0.001)
    return [
        Part(grid(points), palette.pick("paper", size=0.2)),
        Part(cover, palette.pick("cover", size=width)),
    ]


def block_tower(palette: Palette) -> Thing:
    """Make a stack of toy blocks."""
    rng = palette.rng
    parts: Thing = []
    level, size = 0.0, rng.uniform(0.028, 0.05)
    for _ in range(rng.integers(1, 5)):
        material = palette.pick("wood", "painted", "plastic", size=size)
        shape = box(size, size, size, 0.06 * size)
        if rng.uniform() < 0.2:
            shape = lathe(np.array([[0, 0], [0.5, 0], [0.5, 1], [0, 1]]) * size, smooth=False)
        parts += place(
            [Part(shape, material)], (*rng.normal(0, 0.003, 2), level), rng.uniform(0, 6)
        )
        level += size
        size *= rng.uniform(0.8, 1.0)
    return parts


def carton(palette: Palette) -> Thing:
    """Make a box of random proportions."""
    rng = palette.rng
    width, depth, height = rng.uniform(0.04, 0.13, 3)
    largest = max(width, depth, height)
    material = palette.pick("cover", "wood", "painted", "metal", "paper", size=largest)
    return [Part(box(width, depth, height, 0.002), material)]


def stone(palette: Palette) -> Thing:
    """Make a pebble or a lump of rock."""
    rng = palette.rng
    size = rng.uniform(0.03, 0.08) * rng.uniform(0.6, 1.0, 3)
    rough = rng.uniform(0.08, 0.3)
    mesh = displace(
        ellipsoid(tuple(size)), rng, rough * size.min(), rng.uniform(0.3, 0.8) * size.max()
    )
    return stand([Part(mesh, palette.pick("stone", "stone", "rust", "soil", size=0.08))])


def candle(palette: Palette) -> Thing:
    """Make a candle with a wick, sometimes in a holder."""
    rng = palette.rng
    height, radius = rng.uniform(0.05, 0.18), rng.uniform(0.01, 0.03)
    radii = (0, radius, radius, 0.7 * radius, 0)
    body = np.stack([radii, (0, 0, height, height + 0.002, height - 0.004)], 1)
    wick = tube(
        np.array([[0, 0, height - 0.005], [0, 0, height + 0.004], [0.004, 0, height + 0.01]]),
        0.001,
        6,
    )
    parts = [
        Part(displace(lathe(body, smooth=False), rng, 0.001, 0.03), palette.pick("wax")),
        Part(wick, palette.pick("soil")),
    ]
    if rng.uniform() < 0.5:
        foot = radius * np.array(
            [[0, 0], [2.6, 0], [2.5, 0.3], [0.7, 0.7], [0.5, 1.6], [1.2, 2.2], [1.3, 2.9], [0, 2.3]]
        )
        holder = Part(lathe(foot), palette.pick("metal", "wood", "ceramic", size=0.06))
        parts = [holder, *place(parts, (0, 0, 2.3 * radius))]
    return parts


def figure(palette: Palette) -> Thing:
    """Make a turned piece, similar to a chess piece."""
    rng = palette.rng
    radii = np.array(
        [0.0, 1.0, 1.0, 0.55, *rng.uniform(0.25, 0.6, 3), *rng.uniform(0.3, 0.75, 2), 0.0]
    )
    levels = np.cumsum([0.0, 0.0, 0.25, 0.25, *rng.uniform(0.3, 0.9, 5), 0.3])
    scale = rng.uniform(0.014, 0.026)
    mesh = lathe(np.stack([radii, levels], 1) * scale)
    return [Part(mesh, palette.pick("wood", "plastic", "metal", "stone", "ceramic", size=0.06))]


def ball(palette: Palette) -> Thing:
    """Make a smooth or a rough ball."""
    rng = palette.rng
    size = rng.uniform(0.03, 0.11)
    mesh = ellipsoid((size, size, size))
    kind = rng.uniform()
    if kind < 0.4:
        mesh = displace(mesh, rng, rng.uniform(0.03, 0.12) * size, rng.uniform(0.1, 0.5) * size)
    return stand([Part(mesh, palette.anything(size))])


def ring(palette: Palette) -> Thing:
    """Make a ring, lying or leaning, smooth or twisted like a rope."""
    rng = palette.rng
    radius, thick = rng.uniform(0.025, 0.05), rng.uniform(0.006, 0.016)
    angle = np.linspace(0.0, TURN, 97)[:-1, None]
    around = np.linspace(0.0, TURN, 24, endpoint=False)[None]
    twist = rng.integers(0, 2) * 0.15 * np.cos(3 * around + rng.integers(5, 14) * angle)
    section = thick * (1.0 + twist)
    across = radius + section * np.cos(around)
    points = np.stack(
        [across * np.cos(angle), across * np.sin(angle), section * np.sin(around) + angle * 0], -1
    )
    mesh = grid(points, close_rows=True, close_columns=True)
    return stand([Part(mesh, palette.anything(radius), pose(roll=rng.choice([0.0, 1.45])))])


def knot(palette: Palette) -> Thing:
    """Make a torus knot."""
    rng = palette.rng
    p, q = [(2, 3), (3, 2), (2, 5), (3, 4)][rng.integers(4)]
    t = np.linspace(0.0, TURN, 240, endpoint=False)
    radius = 0.03 * (1.0 + 0.45 * np.cos(q * t))
    path = np.stack([radius * np.cos(p * t), radius * np.sin(p * t), 0.014 * np.sin(q * t)], 1)
    mesh = tube(np.concatenate([path, path[:2]]), rng.uniform(0.004, 0.007), 12)
    return stand([Part(mesh, palette.anything(0.05), pose(roll=rng.uniform(0, 1.5)))])


def spring(palette: Palette) -> Thing:
    """Make a coil of wire."""
    rng = palette.rng
    turns, radius = rng.integers(5, 11), rng.uniform(0.015, 0.03)
    height = turns * rng.uniform(0.007, 0.014)
    t = np.linspace(0.0, 1.0, 32 * turns)
    angle = TURN * turns * t
    path = np.stack([radius * np.cos(angle), radius * np.sin(angle), height * t], 1)
    coil = Part(tube(path, 0.0018, 8), palette.pick("metal", "plastic", size=0.05))
    return stand(place([coil], roll=rng.choice([0.0, 1.5708])))


def pencil_pot(palette: Palette) -> Thing:
    """Make a pot with pencils, brushes and sticks in it."""
    rng = palette.rng
    radius, height = rng.uniform(0.03, 0.04), rng.uniform(0.08, 0.11)
    wall = np.array([[0, 0], [1, 0], [1, 1], [0.93, 1], [0.93, 0.05], [0, 0.05]]) * [radius, height]
    parts = [Part(lathe(wall, smooth=False), palette.pick("metal", "wood", "ceramic", size=0.1))]
    for angle in TURN * (np.arange(7) + rng.uniform(0, 0.5, 7)) / 7:
        length, lean = rng.uniform(0.14, 0.2), rng.uniform(0.05, 0.2)
        stick = tube(
            np.array([[0, 0, 0], [0, 0, 0.9 * length], [0, 0, 0.91 * length], [0, 0, length]]),
            np.array([0.0035, 0.0035, 0.0033, 0.0004]),
            6,
        )
        foot = 0.4 * radius * np.array([np.cos(angle), np.sin(angle), 0]) + [0, 0, 0.006]
        parts += place([Part(stick, palette.pick("plastic", "wood", size=0.03))], foot, angle, lean)
    return parts


def wire_basket(palette: Palette) -> Thing:
    """Make a wire basket with an apple; most of its area is holes."""
    rng = palette.rng
    radius, height = rng.uniform(0.06, 0.09), rng.uniform(0.06, 0.1)
    angle = np.linspace(0.0, TURN, 61)
    hoops = [(radius * (0.75 + 0.25 * level), height * level) for level in np.linspace(0.0, 1.0, 5)]
    wires = [
        tube(np.stack([r * np.cos(angle), r * np.sin(angle), 0 * angle + z], 1), 0.0015, 6)
        for r, z in hoops
    ]
    for a in np.linspace(0.0, TURN, rng.integers(14, 22), endpoint=False):
        stave = [[r * np.cos(a), r * np.sin(a), z] for r, z in [(0.0, 0.0), *hoops]]
        wires.append(tube(np.array(stave), 0.0012, 6))
    parts = [Part(move(join(*wires), (0, 0, 0.002)), palette.pick("metal", "plastic", size=0.1))]
    spot = (*rng.uniform(-0.02, 0.02, 2), 0.004)
    return parts + place(apple(palette), spot, rng.uniform(0, 6), scale=rng.uniform(0.7, 1.1))


def basket(palette: Palette) -> Thing:
    """Make a woven basket."""
    rng = palette.rng
    radius, height, turns = rng.uniform(0.06, 0.1), rng.uniform(0.06, 0.12), 14
    angle = np.linspace(0.0, TURN, 145)
    strands = []
    for k, level in enumerate(np.linspace(0.0, 1.0, turns)):
        r = radius * (0.8 + 0.2 * level) + 0.004 * np.cos(12 * angle + np.pi * k)
        path = np.stack([r * np.cos(angle), r * np.sin(angle), 0 * angle + level * height], 1)
        strands.append(tube(path, 0.55 * height / turns, 6))
    bottom = lathe(
        np.array([[0, 0], [0.8 * radius, 0], [0.8 * radius, 0.003], [0, 0.004]]), smooth=False
    )
    return stand([Part(join(bottom, *strands), palette.pick("bark", "wood", "fabric", size=0.1))])


def cable(palette: Palette) -> Thing:
    """Make a cable lying in loops."""
    rng = palette.rng
    count = rng.integers(6, 12)
    turn = np.cumsum(rng.normal(0.8, 0.9, count))
    steps = 0.05 * np.stack([np.cos(turn), np.sin(turn)], 1)
    flat = np.cumsum(steps, axis=0)
    flat -= flat.mean(0)
    lift = np.abs(rng.normal(0.0, 0.012, (count, 1)))
    path = curve(np.concatenate([flat, lift], 1), 12)
    radius = rng.uniform(0.0015, 0.004)
    path[:, 2] = np.maximum(path[:, 2], 0.0) + radius
    return [Part(tube(path, radius, 8), palette.pick("plastic", "rubber", "fabric", size=0.03))]


def cushion(palette: Palette) -> Thing:
    """Make a small pillow."""
    rng = palette.rng
    size = rng.uniform(0.08, 0.16)
    shape = ellipsoid((size, size, 0.4 * size), rng.uniform(0.4, 0.6))
    mesh = displace(shape, rng, 0.03 * size, 0.4 * size)
    return stand([Part(mesh, palette.pick("fabric", size=size), pose(roll=rng.uniform(-0.2, 0.2)))])


def bottle(palette: Palette) -> Thing:
    """Make a bottle with a stopper."""
    rng = palette.rng
    radius, height, neck = rng.uniform((0.025, 0.16, 0.009), (0.04, 0.26, 0.013))
    radii = (0, 0.9 * radius, radius, radius, neck, neck, 1.15 * neck, 0)
    outside = np.stack([radii, height * np.array([0, 0, 0.03, 0.5, 0.72, 0.95, 1, 1])], 1)
    label = np.array([[radius + 0.0006, 0.12 * height], [radius + 0.0006, 0.42 * height]])
    stopper = np.array([[0, 0], [1.2, 0], [1.2, 2], [0, 2]]) * neck + [0, height]
    body = palette.pick("glass", "ceramic", "plastic", size=0.1)
    return [
        Part(lathe(curve(outside, 2), smooth=False), body),
        Part(lathe(label, smooth=False), palette.pick("paper", "picture", size=0.1)),
        Part(lathe(stopper, smooth=False), palette.pick("wood", "metal", size=0.02)),
    ]


def frame(palette: Palette, width=None, height=None) -> Thing:
    """Make a framed picture that faces ``-y`` and leans back slightly."""
    rng = palette.rng
    width = width or rng.uniform(0.1, 0.16)
    height = height or width * rng.uniform(0.75, 1.35)
    bar = 0.1 * min(width, height)
    material = palette.pick("wood", "metal", "painted", size=width)
    upright, across = box(bar, height + 2 * bar, bar, 0.2 * bar), box(width, bar, bar, 0.2 * bar)
    offset_x, offset_y = (width + bar) / 2, (height + bar) / 2
    picture = palette.pick("picture", "paper", size=width)
    parts = [
        *(Part(upright, material, pose((x, 0, 0))) for x in (-offset_x, offset_x)),
        *(Part(across, material, pose((0, y, 0))) for y in (-offset_y, offset_y)),
        Part(sheet(width, height), picture, pose((0, 0, 0.4 * bar))),
    ]
    return stand(place(parts, roll=1.5708 - rng.uniform(0.0, 0.2)))


def monument(palette: Palette) -> Thing:
    """Make a stack of balanced boulders."""
    rng = palette.rng
    parts: Thing = []
    level, size = 0.0, rng.uniform(0.06, 0.09)
    for _ in range(rng.integers(2, 5)):
        mesh = displace(ellipsoid((size, 0.9 * size, 0.5 * size)), rng, 0.06 * size, 0.7 * size)
        parts += place(
            [Part(mesh, palette.pick("stone", size=0.06))], (0, 0, level), rng.uniform(0, 6)
        )
        level += 0.48 * size
        size *= rng.uniform(0.6, 0.85)
    return stand(parts)


def jack(palette: Palette) -> Thing:
    """Make rods that cross in a common centre."""
    rng = palette.rng
    length, radius = rng.uniform(0.03, 0.06), rng.uniform(0.002, 0.006)
    rods = []
    for _ in range(rng.integers(3, 9)):
        direction = rng.normal(size=3)
        tip = length * direction / np.linalg.norm(direction)
        rods.append(tube(np.stack([-tip, 0 * tip, tip]), radius, 10))
        rods.append(
            transform(ellipsoid((4 * radius,) * 3, steps=12), pose(tip - [0, 0, 2 * radius]))
        )
    return stand([Part(join(*rods), palette.anything(length))])


SMALL = (
    *(vase, vase, cup, cup, apple, orange, lemon, pear, book, block_tower, carton, stone, candle),
    *(figure, figure, ball, ring, knot, spring, cable, cushion, bottle, jack),
)
LARGE = (
    *(vase, bowl_of_fruit, book_pile, open_book, pencil_pot, wire_basket, basket, bottle, frame),
    *(monument, plate),
)
