"""The scene of the bundled sample light field: a still life on a table.

Things are placed in table coordinates: ``x`` to the right, ``y`` to the back, ``z`` up, from the
middle of the table, in pixels at zero disparity.
"""

from __future__ import annotations

import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from occjax.data.lighting import Lighting
from occjax.data.poses import compose, rotation, translation
from occjax.data.procedural import Camera, Scene
from occjax.data.surfaces import Surfaces, bowl, box, disc, ellipsoid, join, leaf, plane, tube
from occjax.data.textures import Materials, material

Point = tuple[float, float, float]

RELIEF = 58.0
PERSPECTIVE = 0.145
"""The camera (see :class:`occjax.data.procedural.Camera`): a focal length of 400 pixels."""

TILT = math.radians(19.0)
"""How far the camera looks down on the table."""

TABLE = np.array(
    [
        [1.0, 0.0, 0.0, 0.0],
        [0.0, -math.sin(TILT), -math.cos(TILT), 52.0],
        [0.0, -math.cos(TILT), math.sin(TILT), 0.0],
    ],
    np.float32,
)
"""Affine map from table to scene coordinates."""


def still_life() -> Scene:
    """A table before a brick wall: leaves in a vase, a trellis, books, fruit, pencils."""
    direction = jnp.array([-0.55, -0.80, 0.62])
    return Scene(
        surfaces=join(
            _room(), _trellis(), _vase(), _books(), _fruit_bowl(), _pencil_pot(), _foreground()
        ),
        camera=Camera(relief=jnp.float32(RELIEF), perspective=jnp.float32(PERSPECTIVE)),
        lighting=Lighting(
            direction=direction / jnp.linalg.norm(direction),
            softness=jnp.float32(0.16),
            lamp=jnp.array([1.06, 0.96, 0.81]),
            sky=jnp.array([0.44, 0.48, 0.56]),
            bounce=jnp.array([0.20, 0.16, 0.12]),
            reach=jnp.float32(70.0),
        ),
    )


def _at(x: float, back: float, up: float = 0.0, *turns: Array) -> Float[Array, "3 4"]:
    """Pose of something at a place of the table, turned."""
    return compose(jnp.asarray(TABLE), translation(x, back, up), *turns)


def _rod(start: Point, end: Point, radius: float, materials: Materials) -> Surfaces:
    """A round rod between two points."""
    frame, length = _frame(np.asarray(start), np.asarray(end))
    return tube(
        compose(jnp.asarray(TABLE), frame), materials, bottom=0.0, top=length, radius=radius
    )


def _frame(start: np.ndarray, end: np.ndarray) -> tuple[Float[Array, "3 4"], float]:
    """Pose whose z axis runs from start towards end, and their distance."""
    length = float(np.linalg.norm(end - start))
    axis = (end - start) / length
    side = np.cross(np.eye(3)[np.argmin(np.abs(axis))], axis)
    side /= np.linalg.norm(side)
    frame = np.stack([side, np.cross(axis, side), axis, start], axis=1)
    return jnp.asarray(frame, jnp.float32), length


def _pencil(start: Point, end: Point, radius: float, paint: Materials) -> Surfaces:
    """A pencil between two points, sharpened at its end."""
    bare = material(
        "wood", ground=(0.90, 0.75, 0.54), figure=(0.80, 0.62, 0.40), frequency=0.2, grain=0.2
    )
    frame, length = _frame(np.asarray(start), np.asarray(end))
    point = 3.5 * radius
    pose = compose(jnp.asarray(TABLE), frame)
    barrel = tube(pose, paint, bottom=0.0, top=length - point, radius=radius)
    apex = compose(pose, translation(0.0, 0.0, length))
    tip = tube(apex, bare, bottom=-point, top=0.0, radius=0.0, flare=(radius / point) ** 2)
    return join(barrel, tip)


def _room() -> Surfaces:
    """The table top and the wall behind it."""
    top = material(
        "planks",
        ground=(0.72, 0.53, 0.36),
        figure=(0.50, 0.33, 0.20),
        accent=(0.22, 0.14, 0.09),
        frequency=(0.005, 0.036, 0.036),
        grain=0.35,
        gloss=0.06,
        seed=3.0,
    )
    wall = material(
        "bricks",
        ground=(0.66, 0.43, 0.35),
        figure=(0.50, 0.29, 0.24),
        accent=(0.74, 0.70, 0.64),
        frequency=(1 / 34.0, 1 / 13.0, 0.05),
        grain=0.55,
        seed=1.0,
    )
    facing_the_viewer = rotation("x", 90.0)
    return join(plane(_at(0.0, 0.0), top), plane(_at(7.0, 128.0, 0.0, facing_the_viewer), wall))


def _trellis() -> Surfaces:
    """A lattice of thin laths, leaning in front of the wall."""
    lath = material(
        "wood", ground=(0.90, 0.88, 0.82), figure=(0.74, 0.72, 0.66), frequency=0.08, grain=0.2
    )
    uprights = [
        _rod((x, 94.0, 0.0), (x, 114.0, 132.0), 1.9, lath) for x in (22.0, 46.0, 70.0, 94.0, 118.0)
    ]
    crossbars = [
        _rod((8.0, 91.0 + 0.1515 * up, up), (140.0, 91.0 + 0.1515 * up, up), 1.7, lath)
        for up in (24.0, 48.0, 72.0, 96.0, 120.0)
    ]
    return join(*uprights, *crossbars)


def _vase() -> Surfaces:
    """A glazed vase with twigs and leaves."""
    glaze = material(
        "stripes",
        ground=(0.13, 0.34, 0.42),
        figure=(0.20, 0.50, 0.55),
        accent=(0.88, 0.80, 0.62),
        frequency=(0.0, 0.058, 0.058),
        grain=0.35,
        gloss=0.5,
        around=True,
    )
    x, back = -66.0, 42.0
    body = bowl(_at(x, back, 27.0), glaze, (25.0, 25.0, 30.0), bottom=-27.0, top=26.8)
    neck = tube(_at(x, back, 57.0), glaze, bottom=-3.3, top=13.0, radius=11.0, flare=0.55)
    parts = [body, neck]
    twig = material("plain", ground=(0.36, 0.27, 0.17), frequency=0.2)
    shoots = [  # tip of each twig and the number of pairs of leaves along it
        ((-44.0, -6.0, 70.0), 4),
        ((-20.0, -22.0, 98.0), 4),
        ((4.0, 12.0, 108.0), 5),
        ((30.0, -14.0, 92.0), 4),
        ((47.0, 6.0, 62.0), 3),
    ]
    for number, (tip, pairs) in enumerate(shoots):
        start = np.array([x + 0.12 * tip[0], back + 0.12 * tip[1], 60.0])
        end = np.array([x + tip[0], back + tip[1], 50.0 + tip[2]])
        parts.append(_rod(tuple(start), tuple(end), 1.0, twig))
        heading = math.degrees(math.atan2(tip[1], tip[0]))
        for pair in range(pairs):
            place = start + (end - start) * (0.36 + 0.62 * pair / (pairs - 1))
            for side in (-1.0, 1.0):
                shade = 0.85 + 0.3 * ((number * 7 + pair * 3 + side) % 5) / 5
                green = material(
                    "stripes",
                    ground=(0.28 * shade, 0.47 * shade, 0.24 * shade),
                    figure=(0.36 * shade, 0.56 * shade, 0.28 * shade),
                    accent=(0.55 * shade, 0.68 * shade, 0.38 * shade),
                    frequency=(0.0, 0.12, 0.0),
                    grain=0.35,
                    gloss=0.10,
                    seed=number + 0.1 * pair,
                )
                turn = compose(
                    rotation("z", heading + side * (62.0 + 9.0 * pair) + 11.0 * number),
                    rotation("y", -28.0 + 9.0 * pair - 4.0 * number),
                    rotation("x", side * 24.0 + 55.0),
                )
                parts.append(
                    leaf(_at(*place, turn), green, length=25.0 - 2.0 * pair, width=10.0, bend=7.0)
                )
    return join(*parts)


def _books() -> Surfaces:
    """Three books, one across the other, with a small globe on top."""
    pages = material(
        "stripes",
        ground=(0.93, 0.89, 0.79),
        figure=(0.80, 0.75, 0.64),
        frequency=(0.0, 0.0, 0.4),
        grain=0.25,
    )
    covers = [
        ((0.55, 0.14, 0.13), (0.40, 0.09, 0.09)),
        ((0.80, 0.62, 0.22), (0.68, 0.49, 0.15)),
        ((0.16, 0.26, 0.42), (0.11, 0.18, 0.31)),
    ]
    sizes = [(46.0, 32.0, 8.0), (40.0, 28.0, 6.5), (35.0, 25.0, 7.0)]
    parts, up = [], 0.0
    for (ground, figure), size, turn in zip(covers, sizes, (-14.0, 8.0, -24.0), strict=True):
        cloth = material("weave", ground=ground, figure=figure, frequency=0.35, grain=0.3)
        band = material(
            "stripes",
            ground=ground,
            figure=figure,
            accent=(0.88, 0.76, 0.45),
            frequency=(0.05, 0.0, 0.0),
            grain=0.3,
        )
        pose = _at(70.0, 46.0, up + size[2], rotation("z", turn))
        # The spine faces the viewer; the pages show at the sides.
        parts.append(box(pose, (pages, band, cloth), size))
        up += 2.0 * size[2]
    ball = material(
        "checks",
        ground=(0.92, 0.88, 0.80),
        figure=(0.70, 0.24, 0.16),
        frequency=(8.0, 0.125, 0.0),
        grain=0.2,
        gloss=0.5,
        around=True,
    )
    tilted = compose(rotation("y", 24.0), rotation("x", -18.0))
    parts.append(ellipsoid(_at(66.0, 44.0, up + 16.0, tilted), ball, (16.0, 16.0, 16.0)))
    return join(*parts)


def _fruit_bowl() -> Surfaces:
    """A bowl of oranges and a lime on a chequered mat."""
    x, back = 12.0, -22.0
    mat = material(
        "weave",
        ground=(0.86, 0.82, 0.72),
        figure=(0.36, 0.44, 0.50),
        frequency=(0.11, 0.11, 0.0),
        grain=0.3,
    )
    china = material(
        "marble",
        ground=(0.90, 0.89, 0.86),
        figure=(0.78, 0.80, 0.82),
        accent=(0.20, 0.32, 0.55),
        frequency=0.045,
        grain=0.12,
        gloss=0.45,
        seed=5.0,
    )
    orange = material(
        "spots",
        ground=(0.93, 0.53, 0.12),
        figure=(0.84, 0.42, 0.08),
        frequency=0.35,
        grain=0.35,
        gloss=0.3,
    )
    lime = material(
        "plain",
        ground=(0.62, 0.72, 0.20),
        figure=(0.38, 0.52, 0.14),
        frequency=0.12,
        grain=0.45,
        gloss=0.3,
        seed=8.0,
    )
    tilted = compose(rotation("z", 30.0), rotation("y", 20.0))
    return join(
        disc(_at(x, back, 0.4, rotation("z", 25.0)), mat, 52.0),
        bowl(_at(x, back, 27.0), china, (37.0, 37.0, 27.0), bottom=-26.5, top=-2.0),
        ellipsoid(_at(x - 15.0, back + 4.0, 24.0), orange, (15.0, 15.0, 14.4)),
        ellipsoid(_at(x + 14.0, back + 9.0, 24.0), orange, (14.6, 14.6, 14.0)),
        ellipsoid(_at(x + 7.0, back - 14.0, 23.0, tilted), lime, (14.0, 11.0, 11.0)),
        ellipsoid(_at(x + 1.0, back + 5.0, 42.0), orange, (13.5, 13.5, 13.0)),
    )


def _pencil_pot() -> Surfaces:
    """A wooden pot of pencils."""
    x, back = -20.0, 92.0
    wood = material(
        "wood",
        ground=(0.66, 0.47, 0.30),
        figure=(0.44, 0.28, 0.17),
        frequency=(0.2, 0.2, 0.05),
        grain=0.3,
    )
    parts = [tube(_at(x, back), wood, bottom=0.0, top=36.0, radius=13.0)]
    pencils = [
        ((-6.0, 3.0), (-15.0, 6.0, 74.0), (0.75, 0.22, 0.16)),
        ((4.0, 5.0), (3.0, 9.0, 82.0), (0.18, 0.40, 0.36)),
        ((2.0, -6.0), (13.0, -6.0, 70.0), (0.90, 0.70, 0.20)),
    ]
    for foot, tip, colour in pencils:
        paint = material("plain", ground=colour, frequency=0.15, grain=0.25, gloss=0.2)
        start = (x + foot[0], back + foot[1], 2.0)
        parts.append(_pencil(start, (x + tip[0], back + tip[1], tip[2]), 2.2, paint))
    return join(*parts)


def _foreground() -> Surfaces:
    """Toy blocks, marbles and a pencil near the viewer."""
    maple = material(
        "wood",
        ground=(0.86, 0.70, 0.48),
        figure=(0.66, 0.47, 0.27),
        frequency=(0.03, 0.10, 0.10),
        grain=0.25,
    )
    painted = material(
        "checks",
        ground=(0.30, 0.48, 0.44),
        figure=(0.86, 0.82, 0.70),
        frequency=(0.13, 0.13, 0.13),
        grain=0.25,
    )
    block = box(_at(-74.0, -36.0, 13.0, rotation("z", 33.0)), (maple, maple, maple), (13.0,) * 3)
    small = box(
        _at(-70.0, -34.0, 26.0 + 8.5, rotation("z", 12.0)), (painted, painted, painted), (8.5,) * 3
    )
    glass = [
        ((-36.0, -62.0), 8.5, (0.70, 0.16, 0.14), (0.92, 0.72, 0.40)),
        ((-52.0, -80.0), 7.0, (0.14, 0.36, 0.54), (0.80, 0.88, 0.90)),
        ((72.0, -50.0), 9.0, (0.24, 0.42, 0.22), (0.86, 0.86, 0.60)),
    ]
    marbles = [
        ellipsoid(
            _at(*place, radius, rotation("x", 40.0 + 50.0 * number)),
            material(
                "marble",
                ground=ground,
                figure=figure,
                accent=figure,
                frequency=0.09,
                grain=0.15,
                gloss=0.7,
                seed=float(number),
            ),
            (radius,) * 3,
        )
        for number, (place, radius, ground, figure) in enumerate(glass)
    ]
    yellow = material(
        "stripes",
        ground=(0.88, 0.66, 0.14),
        figure=(0.78, 0.54, 0.10),
        frequency=(0.0, 0.02, 0.0),
        grain=0.25,
        around=True,
    )
    pencil = _pencil((34.0, -78.0, 2.6), (100.0, -60.0, 2.6), 2.6, yellow)
    return join(block, small, *marbles, pencil)
