"""Furniture and parts of a room in real size; fronts face ``-y``, towards the camera."""

from __future__ import annotations

import numpy as np

from .mesh import box, curve, displace, ellipsoid, grid, join, lathe, move, pose, sheet, tube
from .parts import Part, Thing, choose, footprint, place, top
from .plants import potted
from .props import LARGE, SMALL, book, frame
from .surfaces import Palette

QUARTER = np.pi / 2.0


def table(palette: Palette, width: float, depth: float, height: float) -> Thing:
    """Make a table with four legs."""
    rng = palette.rng
    thick, leg = rng.uniform(0.025, 0.045), rng.uniform(0.025, 0.05)
    wood = palette.pick("wood", "wood", "lacquer", size=1.0)
    board = move(box(width, depth, thick, 0.005), (0, 0, height - thick))
    x, y = width / 2 - leg, depth / 2 - leg
    legs = [
        Part(box(leg, leg, height - thick, 0.004), wood, pose((a * x, b * y, 0)))
        for a in (-1, 1)
        for b in (-1, 1)
    ]
    return [Part(board, palette.pick("table", size=0.8)), *legs]


def laid_table(palette: Palette) -> Thing:
    """Make a table with objects on it."""
    rng = palette.rng
    width, depth, height = rng.uniform(0.7, 1.3), rng.uniform(0.5, 0.8), rng.uniform(0.45, 0.75)
    spots: Thing = []
    taken: list[tuple[float, float, float]] = []
    for _ in range(rng.integers(14, 26)):
        thing = potted(palette) if rng.uniform() < 0.25 else choose(rng, LARGE + SMALL)(palette)
        radius = footprint(thing)
        x, y = rng.uniform(-0.42, 0.42, 2) * (width, depth)
        if all(np.hypot(x - a, y - b) > radius + other for a, b, other in taken):
            taken.append((x, y, radius))
            spots += place(thing, (x, y, height), rng.uniform(0, 6))
    return [*table(palette, width, depth, height), *spots]


def chair(palette: Palette) -> Thing:
    """Make a chair with a slatted back."""
    rng = palette.rng
    wood = palette.pick("wood", "wood", "lacquer", "metal", size=0.8)
    seat, height = 0.45, 0.92
    legs = [
        Part(tube(np.array([[x, y, 0], [0.93 * x, 0.93 * y, h]]), 0.017, 10), wood)
        for x in (-0.2, 0.2)
        for y, h in ((-0.2, seat), (0.2, height))
    ]
    slats = [
        Part(box(0.36, 0.014, 0.05, 0.005), wood, pose((0, 0.187, level)))
        for level in np.linspace(seat + 0.12, height - 0.06, rng.integers(2, 6))
    ]
    board = Part(box(0.44, 0.43, 0.03, 0.012), wood, pose((0, 0, seat)))
    pad = ellipsoid((0.4, 0.4, 0.06), 0.45)
    cushion = Part(pad, palette.pick("fabric", size=0.4), pose((0, 0, seat + 0.025)))
    return [*legs, *slats, board, cushion]


def sofa(palette: Palette) -> Thing:
    """Make a sofa with cushions."""
    rng = palette.rng
    width = rng.uniform(1.3, 1.9)
    cloth = palette.pick("fabric", "fabric", "rubber", size=0.5)
    seat = box(width, 0.8, 0.38, 0.06, 6)
    back = box(width, 0.22, 0.45, 0.08, 6)
    arm = box(0.2, 0.82, 0.55, 0.07, 6)
    parts = [
        Part(seat, cloth, pose((0, 0, 0.06))),
        Part(back, cloth, pose((0, 0.33, 0.4), roll=-0.12)),
        Part(arm, cloth, pose((-width / 2, 0, 0.06))),
        Part(arm, cloth, pose((width / 2, 0, 0.06))),
    ]
    for x in np.linspace(-0.36, 0.36, rng.integers(2, 5)) * width:
        size = rng.uniform(0.36, 0.48)
        pillow = displace(ellipsoid((size, size, 0.18), 0.5), rng, 0.02, 0.25)
        leaning = pose((x, 0.1, 0.62 + 0.05), roll=1.2, tilt=rng.uniform(-0.3, 0.3))
        parts.append(Part(pillow, palette.pick("fabric", size=0.3), leaning))
    return parts


def shelf(
    palette: Palette, columns: int, rows: int, width: float = 0.42, height: float = 0.32
) -> Thing:
    """Make a shelf whose compartments hold books, plants and other objects."""
    rng = palette.rng
    depth, board = rng.uniform(0.24, 0.32), rng.uniform(0.016, 0.03)
    wood = palette.pick("wood", "wood", "lacquer", size=0.8)
    total_width, total_height = columns * width + board, rows * height + board
    # No two faces may be coplanar: rounding would decide which of them is visible.
    level_board = box(total_width + 0.004, depth, board)
    side = box(board, depth - 0.006, total_height - 0.004)
    parts = [Part(level_board, wood, pose((0, 0, k * height))) for k in range(rows + 1)]
    parts += [
        Part(side, wood, pose((-total_width / 2 + board / 2 + k * width, 0, 0.002)))
        for k in range(columns + 1)
    ]
    if rng.uniform() < 0.8:
        back = sheet(total_width, total_height)
        parts.append(
            Part(back, palette.pick("wall"), pose((0, depth / 2, total_height / 2), roll=QUARTER))
        )
    for column, row in np.ndindex(columns, rows):
        x = (column + 0.5) * width - total_width / 2 + board / 2
        inside = _compartment(palette, width - board, height - board, depth)
        parts += place(inside, (x, 0.0, row * height + board))
    return parts


def _compartment(palette: Palette, width: float, height: float, depth: float) -> Thing:
    """Make the contents of one compartment of a shelf."""
    rng = palette.rng
    parts: Thing = []
    x, end = -width / 2 + 0.004, width / 2 - 0.004
    if rng.uniform() < 0.55:  # a row of books from the left, the last one leaning
        end_of_books = x + rng.uniform(0.25, 0.9) * width
        while x < end_of_books:
            thick, tall = rng.uniform(0.012, 0.045), height * rng.uniform(0.6, 0.93)
            deep = depth * rng.uniform(0.6, 0.85)
            if x + thick > end:
                break
            front = rng.uniform(-0.35, -0.15) * depth
            one = place(book(palette, deep, tall, thick), (0, 0, 0), turn=QUARTER)
            # Spine to the front, standing on its lower edge.
            upright = place(one, (0, 0, tall / 2), tilt=QUARTER)
            parts += place(upright, (x, front + deep / 2, 0.0))
            x += thick + 0.001
    while end - x > 0.04:
        thing = potted(palette, 0.8) if rng.uniform() < 0.2 else choose(rng, SMALL + LARGE)(palette)
        radius, tall = footprint(thing), top(thing)
        scale = min(1.5, 0.5 * (end - x) / radius, 0.92 * height / tall, 0.45 * depth / radius)
        if scale > 0.3:
            y = rng.uniform(-0.25, 0.1) * depth
            parts += place(thing, (x + scale * radius, y, 0.0), rng.uniform(0, 6), scale=scale)
        x += 2.0 * scale * radius + rng.uniform(0.005, 0.06)
    return parts


def floor_lamp(palette: Palette) -> Thing:
    """Make a lamp with a cloth shade on a thin pole."""
    rng = palette.rng
    height, radius = rng.uniform(1.2, 1.7), rng.uniform(0.16, 0.24)
    metal = palette.pick("metal", size=0.3)
    pole = tube([[0, 0, 0.02], [0, 0, height]], 0.012, 12)
    foot = lathe([[0, 0], [0.15, 0], [0.15, 0.015], [0.02, 0.03], [0, 0.03]], smooth=False)
    shade = lathe(np.array([[radius, height - 0.28], [0.7 * radius, height + 0.04]]), smooth=False)
    cloth = palette.pick("fabric", size=0.2)
    return [Part(join(pole, foot), metal), Part(shade, cloth)]


def hanging_lamp(palette: Palette, drop: float) -> Thing:
    """Make a lamp that hangs on a cable from the origin."""
    rng = palette.rng
    radius = rng.uniform(0.09, 0.2)
    shade = radius * np.array([[1.0, 0.0], [0.85, 0.5], [0.4, 0.95], [0.1, 1.05], [0.0, 1.05]])
    bulb = ellipsoid((0.06, 0.06, 0.08), steps=16)
    return [
        Part(tube([[0, 0, 0], [0, 0, -drop + radius]], 0.004, 8), palette.pick("rubber")),
        Part(
            lathe(shade), palette.pick("metal", "ceramic", "plastic", size=0.3), pose((0, 0, -drop))
        ),
        Part(bulb, palette.pick("wax"), pose((0, 0, -drop + 0.02))),
    ]


def hanging_cable(palette: Palette, start, end, sag: float) -> Thing:
    """Make a cable that hangs between two points."""
    t = np.linspace(0.0, 1.0, 40)[:, None]
    path = (1.0 - t) * np.asarray(start) + t * np.asarray(end)
    path[:, 2] -= 4.0 * sag * (t * (1.0 - t))[:, 0]
    radius = palette.rng.uniform(0.002, 0.006)
    return [Part(tube(path, radius, 8), palette.pick("rubber", "plastic", "metal", size=0.03))]


def curtain(palette: Palette, width: float, height: float) -> Thing:
    """Make a curtain in folds, from the floor up."""
    rng = palette.rng
    x = np.linspace(-width / 2, width / 2, 160)
    z = np.linspace(0.0, height, 24)
    folds = FOLDS_RAD_PER_METRE * rng.uniform(0.8, 1.4) * x + 0.6 * np.sin(
        3.0 * x + rng.uniform(0, 6)
    )
    depth = (0.035 + 0.015 * np.linspace(1.0, 0.0, 24))[:, None] * np.sin(
        folds + 0.3 * np.sin(2.0 * z)[:, None]
    )
    points = np.stack(np.broadcast_arrays(x[None], depth, z[:, None]), -1)
    rail = tube([[-width / 2 - 0.1, 0, height], [width / 2 + 0.1, 0, height]], 0.012, 10)
    return [
        Part(grid(points), palette.pick("fabric", size=0.6)),
        Part(rail, palette.pick("metal", "wood", size=0.2)),
    ]


FOLDS_RAD_PER_METRE = 2.0 * np.pi * 8.0
"""Phase of a curtain's folds per metre of width, in radians."""


def window(palette: Palette, width: float, height: float) -> Thing:
    """Make the frame, glazing bars and sill of a window in the plane ``y = 0``."""
    rng = palette.rng
    bar, thick = 0.06, 0.05
    wood = palette.pick("lacquer", "wood", size=0.8)
    columns, rows = rng.integers(1, 4), rng.integers(1, 4)
    parts = []
    for k in range(columns + 1):
        wide = bar if k in (0, columns) else 0.5 * bar
        upright = pose((width * (k / columns - 0.5), 0, 0))
        parts.append(Part(box(wide, thick, height), wood, upright))
    for k in range(rows + 1):
        wide = bar if k in (0, rows) else 0.5 * bar
        level = pose((0, 0, height * k / rows - wide / 2))
        parts.append(Part(box(width + bar, 0.9 * thick, wide), wood, level))
    sill = Part(box(width + 0.2, 0.2, 0.03, 0.005), wood, pose((0, -0.09, -0.06)))
    return [*parts, sill]


def wall_pictures(palette: Palette, width: float, low: float, high: float) -> Thing:
    """Make a row of framed pictures on a wall in the plane ``y = 0``."""
    rng = palette.rng
    parts: Thing = []
    x = -width / 2
    while True:
        size = rng.uniform(0.18, 0.5)
        x += size * 0.75
        if x + size / 2 > width / 2:
            return parts
        picture = frame(palette, size, size * rng.uniform(0.7, 1.3))
        parts += place(picture, (x, -0.03, rng.uniform(low, high)))
        x += size * 0.75 + rng.uniform(0.02, 0.3)


def rug(palette: Palette, width: float, depth: float) -> Thing:
    """Make a rug with a pile and a wavy border."""
    mesh = displace(sheet(width, depth, 60, 90), palette.rng, 0.006, 0.3)
    return [Part(mesh, palette.pick("fabric", "picture", size=0.8), pose((0, 0, 0.012)))]


def radiator(palette: Palette, width: float) -> Thing:
    """Make a radiator of parallel ribs."""
    rib = box(0.045, 0.1, 0.55, 0.02)
    paint = palette.pick("lacquer")
    count = int(width / 0.055)
    return [Part(rib, paint, pose(((k - count / 2) * 0.055, 0, 0.12))) for k in range(count)]


def lattice(palette: Palette, width: float, height: float) -> Thing:
    """Make a wire fence or trellis of crossing bars in the plane ``y = 0``."""
    rng = palette.rng
    step, radius = rng.uniform(0.06, 0.16), rng.uniform(0.002, 0.006)
    slope = rng.choice([0.0, 0.5, 1.0])
    bars = []
    for x in np.arange(-width / 2 - slope * height, width / 2 + slope * height, step):
        for sign in (-1.0, 1.0) if slope else (1.0,):
            z = np.linspace(0.0, height, 14)
            path = np.stack([x + sign * slope * z, 0 * z + sign * radius, z], 1)
            path = path[np.abs(path[:, 0]) <= width / 2]
            if len(path) > 2:
                bars.append(tube(path, radius, 6))
    if not slope:
        for level in np.arange(step / 2, height, step):
            ends = np.array([[-width / 2, -radius, level], [width / 2, -radius, level]])
            bars.append(tube(ends, radius, 6))
    return [Part(join(*bars), palette.pick("metal", "wood", "plastic", "rust", size=0.2))]


def drape(palette: Palette, width: float, depth: float) -> Thing:
    """Make a creased cloth that lies flat."""
    rng = palette.rng
    mesh = displace(
        sheet(width, depth, 90, 120), rng, rng.uniform(0.006, 0.02), rng.uniform(0.15, 0.4)
    )
    return [Part(mesh, palette.pick("fabric", size=0.4), pose((0, 0, 0.02)))]


def backdrop(palette: Palette, width: float, depth: float, height: float) -> Thing:
    """Make a studio backdrop: paper that curves from the table up to the wall."""
    forward = depth * np.array([-1, -0.3, 0.1, 0.3, 0.36, 0.36])
    path = curve(np.stack([forward, height * np.array([0, 0, 0, 0.06, 0.4, 1])], 1), 8)
    points = np.empty((2, len(path), 3))
    points[..., 1], points[..., 2] = path[:, 0], path[:, 1]
    points[0, :, 0], points[1, :, 0] = width / 2, -width / 2
    return [Part(grid(points), palette.pick("paint", "paint", "fabric", size=0.5))]
