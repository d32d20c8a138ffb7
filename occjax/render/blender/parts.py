"""Things put together from parts: a mesh, what it is made of, and where it is."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from .mesh import Mesh, pose
from .surfaces import Surface

IDENTITY = np.eye(4)


class Part(NamedTuple):
    """One object of the scene.

    Attributes:
        mesh: Its shape, in its own coordinates.
        surface: What it is made of; the texture is fixed to its own coordinates.
        matrix: ``[4, 4]`` where it is.
    """

    mesh: Mesh
    surface: Surface
    matrix: np.ndarray = IDENTITY


Thing = list[Part]
"""Parts that belong together, standing on ``z = 0`` around the origin until they are placed."""


def place(thing: Iterable[Part], *pose_arguments, **pose_options) -> Thing:
    """The thing mapped by :func:`.mesh.pose`, on top of where its parts are already."""
    matrix = pose(*pose_arguments, **pose_options)
    return [part._replace(matrix=matrix @ part.matrix) for part in thing]


def corners(thing: Iterable[Part]) -> np.ndarray:
    """``[n, 3]`` vertices of all parts, in common coordinates."""
    return np.concatenate(
        [part.mesh.vertices @ part.matrix[:3, :3].T + part.matrix[:3, 3] for part in thing]
    )


def footprint(thing: Thing) -> float:
    """Radius of the smallest upright cylinder around the origin that holds the thing."""
    return float(np.linalg.norm(corners(thing)[:, :2], axis=1).max())


def top(thing: Thing) -> float:
    """Height of the highest point."""
    return float(corners(thing)[:, 2].max())


def stand(thing: Thing) -> Thing:
    """The thing moved up or down until its lowest point is at ``z = 0``."""
    return place(thing, (0.0, 0.0, -float(corners(thing)[:, 2].min())))


def scatter(
    rng: np.random.Generator,
    things: Iterable[Thing],
    region: tuple[float, float, float, float],
    *,
    height: float = 0.0,
    gap: float = 0.005,
    taken: list[tuple[float, float, float]] | None = None,
) -> Thing:
    """Stand things side by side, at random places and turned at random, large ones first.

    Args:
        rng: Source of the places.
        things: What to place; those that find no free place are left out.
        region: ``(left, right, front, back)`` in x and y.
        height: Of what they stand on.
        gap: Least distance between their footprints.
        taken: ``(x, y, radius)`` of places already taken; new ones are added.

    Returns:
        The parts of all things that found a place.
    """
    left, right, front, back = region
    taken = [] if taken is None else taken
    placed: Thing = []
    for thing in sorted(things, key=footprint, reverse=True):
        radius = footprint(thing)
        for _ in range(80):
            x, y = rng.uniform(left, right), rng.uniform(front, back)
            clear = all(np.hypot(x - a, y - b) > radius + other + gap for a, b, other in taken)
            if clear:
                taken.append((x, y, radius))
                placed += place(stand(thing), (x, y, height), rng.uniform(0.0, 2.0 * np.pi))
                break
    return placed
