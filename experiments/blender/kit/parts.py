"""Objects assembled from parts; a part is a mesh with a surface and a pose."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from .mesh import Mesh, pose
from .surfaces import Surface

IDENTITY = np.eye(4)


class Part(NamedTuple):
    """One mesh of the scene with its surface and pose.

    Attributes:
        mesh: Shape in local coordinates.
        surface: Material; its texture is fixed to the local coordinates.
        matrix: ``[4, 4]`` transform from local to scene coordinates.
    """

    mesh: Mesh
    surface: Surface
    matrix: np.ndarray = IDENTITY


Thing = list[Part]
"""Parts of one object, which stands on ``z = 0`` at the origin until it is placed."""


def place(thing: Iterable[Part], *pose_arguments, **pose_options) -> Thing:
    """Return the thing with the transform of :func:`.mesh.pose` applied to all its parts."""
    matrix = pose(*pose_arguments, **pose_options)
    return [part._replace(matrix=matrix @ part.matrix) for part in thing]


def corners(thing: Iterable[Part]) -> np.ndarray:
    """Return the ``[n, 3]`` vertices of all parts in common coordinates."""
    return np.concatenate(
        [part.mesh.vertices @ part.matrix[:3, :3].T + part.matrix[:3, 3] for part in thing]
    )


def choose(rng: np.random.Generator, choices: Sequence[Any]) -> Any:
    """Return a random element."""
    return choices[rng.integers(len(choices))]


def footprint(thing: Thing) -> float:
    """Return the radius of the smallest vertical cylinder about the origin that holds the thing."""
    return float(np.linalg.norm(corners(thing)[:, :2], axis=1).max())


def top(thing: Thing) -> float:
    """Return the height of the highest vertex."""
    return float(corners(thing)[:, 2].max())


def stand(thing: Thing) -> Thing:
    """Return the thing moved vertically so that its lowest vertex is at ``z = 0``."""
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
    """Place things at random positions and angles without overlap, large ones first.

    Args:
        rng: Random generator.
        things: Things to place; those for which no free position is found are left out.
        region: ``(left, right, front, back)`` in x and y, in metres.
        height: Height of the ground that they stand on, in metres.
        gap: Minimum distance between footprints, in metres.
        taken: ``(x, y, radius)`` of occupied discs; new ones are appended.

    Returns:
        The parts of all placed things.
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
