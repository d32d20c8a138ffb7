"""Meshes of quadrilaterals: boxes, sheets, solids of revolution, tubes, and their transforms.

Lengths are in metres, ``z`` points up. Each shape stands on or is centred at the origin of its
local coordinates; textures are fixed to these coordinates.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .noise import fractal_noise

Point = Sequence[float | int] | np.ndarray
"""Position ``(x, y, z)`` in metres."""


class Mesh(NamedTuple):
    """Vertices and faces.

    Attributes:
        vertices: ``[n, 3]`` positions.
        faces: ``[m, 4]`` vertex indices, counter-clockwise seen from outside.
    """

    vertices: np.ndarray
    faces: np.ndarray


def grid(points: np.ndarray, *, close_rows: bool = False, close_columns: bool = False) -> Mesh:
    """Return the surface through a grid of points.

    Args:
        points: ``[n, m, 3]`` positions.
        close_rows: Connect the last row to the first one.
        close_columns: Connect the last column to the first one.
    """
    n, m = points.shape[:2]
    index = np.arange(n * m).reshape(n, m)
    if close_rows:
        index = np.concatenate([index, index[:1]])
    if close_columns:
        index = np.concatenate([index, index[:, :1]], axis=1)
    corners = (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1])
    return Mesh(points.reshape(-1, 3), np.stack(corners, -1).reshape(-1, 4))


def sheet(width: float | int, height: float | int, rows: int = 1, columns: int = 1) -> Mesh:
    """Return a rectangle centred at the origin in the plane ``z = 0``, facing up."""
    y, x = np.meshgrid(
        np.linspace(-height / 2, height / 2, rows + 1),
        np.linspace(-width / 2, width / 2, columns + 1),
        indexing="ij",
    )
    return grid(np.stack([x, y, np.zeros_like(x)], -1))


def box(width: float, depth: float, height: float, radius: float = 0.0, segments: int = 3) -> Mesh:
    """Return a box standing on ``z = 0`` with edges rounded by ``radius``."""
    half = np.array([width, depth, height]) / 2.0
    radius = min(radius, 0.98 * half.min())
    faces = []
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        along = [_box_steps(half[other], radius, segments) for other in (first, second)]
        a, b = np.meshgrid(*along, indexing="ij")
        for side in (-1.0, 1.0):
            points = np.empty((*a.shape, 3))
            points[..., first], points[..., second] = a, b
            points[..., axis] = side * half[axis]
            inner = np.clip(points, -(half - radius), half - radius)
            outward = points - inner
            length = np.linalg.norm(outward, axis=-1, keepdims=True)
            points = inner + radius * outward / np.where(length > 0.0, length, 1.0)
            faces.append(grid(points if side < 0.0 else points.swapaxes(0, 1)))
    return move(join(*faces), (0.0, 0.0, height / 2.0))


def _box_steps(half: float, radius: float, segments: int) -> np.ndarray:
    """Return coordinates along an edge, denser where the edge is rounded."""
    if radius == 0.0:
        return np.array([-half, half])
    arc = half - radius + radius * np.tan(np.linspace(0.0, np.pi / 4.0, segments + 1))
    return np.concatenate([-arc[::-1], arc])


def lathe(profile: ArrayLike, segments: int = 56, *, smooth: bool = True) -> Mesh:
    """Return a solid of revolution around the z axis.

    Args:
        profile: ``[n, 2]`` radius and height, upwards along the outside; the profile may pass over
            a rim and continue downwards inside.
        segments: Steps around the axis.
        smooth: Interpolate the points by a smooth curve.
    """
    profile = curve(profile, 6) if smooth else np.asarray(profile, float)
    radius = np.maximum(profile[:, :1], 1e-5)
    angle = np.linspace(0.0, 2.0 * np.pi, segments, endpoint=False)
    points = np.stack(
        np.broadcast_arrays(radius * np.cos(angle), radius * np.sin(angle), profile[:, 1:]), -1
    )
    return grid(points, close_columns=True)


def tube(path: ArrayLike, radius: ArrayLike, sides: int = 8) -> Mesh:
    """Return a closed round tube along a path.

    Args:
        path: ``[n, 3]`` points of its axis.
        radius: One radius, or ``[n]`` radii.
        sides: Number of corners of the cross section.
    """
    path = np.asarray(path, float)
    radius = np.broadcast_to(radius, len(path)).astype(float)
    tangent = np.gradient(path, axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    normal = _perpendicular(tangent[0])
    normals = []
    for direction in tangent:  # parallel transport keeps the tube from twisting
        normal = normal - direction * (normal @ direction)
        length = np.linalg.norm(normal)
        normal = normal / length if length > 1e-6 else _perpendicular(direction)
        normals.append(normal)
    across = np.cross(tangent, normals)
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)[:, None, None]
    ring = np.cos(angle) * np.asarray(normals) + np.sin(angle) * across
    points = path[:, None] + radius[:, None, None] * ring.swapaxes(0, 1)
    ends = np.broadcast_to(path[[0, -1], None], (2, sides, 3))
    return grid(np.concatenate([ends[:1], points, ends[1:]]), close_columns=True)


def ellipsoid(size: tuple[float, float, float], roundness: float = 1.0, steps: int = 40) -> Mesh:
    """Return an ellipsoid standing on ``z = 0``; a roundness below 1 gives a pillow shape."""
    latitude = np.linspace(-np.pi / 2, np.pi / 2, steps)[:, None]
    longitude = np.linspace(-np.pi, np.pi, 2 * steps, endpoint=False)

    def power(value):
        return np.sign(value) * np.abs(value) ** roundness

    unit = np.stack(
        np.broadcast_arrays(
            power(np.cos(latitude)) * power(np.cos(longitude)),
            power(np.cos(latitude)) * power(np.sin(longitude)),
            power(np.sin(latitude)) + 1.0,
        ),
        -1,
    )
    return grid(unit * (np.asarray(size) / 2.0), close_columns=True)


def leaf(length: float, width: float, *, bend: float, fold: float, steps: int = 10) -> Mesh:
    """Return a leaf along ``+x``, bent downwards by an angle and folded along its rib."""
    t = np.linspace(0.0, 1.0, steps)
    angle = bend * t
    spine = np.stack([np.cos(angle), np.zeros(steps), -np.sin(angle)], -1) * length / (steps - 1)
    spine = np.cumsum(spine, axis=0) - spine[0]
    half = width / 2.0 * (np.sin(np.pi * t**0.75) + 0.02)
    across = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
    points = np.repeat(spine[:, None], 5, axis=1)
    points[..., 1] += half[:, None] * across * np.cos(fold)
    points[..., 2] += half[:, None] * np.abs(across) * np.sin(fold)
    return grid(points)


def curve(points: ArrayLike, steps: int) -> np.ndarray:
    """Return ``[(n - 1) * steps + 1, k]`` points of a Catmull-Rom spline through points."""
    points = np.asarray(points, float)
    padded = np.concatenate([2 * points[:1] - points[1:2], points, 2 * points[-1:] - points[-2:-1]])
    t = np.linspace(0.0, 1.0, steps, endpoint=False)[:, None, None]
    before, start, end, after = padded[:-3], padded[1:-2], padded[2:-1], padded[3:]
    pieces = 0.5 * (
        2.0 * start
        + (end - before) * t
        + (2.0 * before - 5.0 * start + 4.0 * end - after) * t**2
        + (3.0 * start - before - 3.0 * end + after) * t**3
    )
    return np.concatenate([pieces.swapaxes(0, 1).reshape(-1, points.shape[1]), points[-1:]])


def displace(mesh: Mesh, rng: np.random.Generator, height: float, wavelength: float) -> Mesh:
    """Displace the surface along its normals by fractal noise of amplitude ``height``."""
    offset = height * fractal_noise(mesh.vertices / wavelength, rng)
    return mesh._replace(vertices=mesh.vertices + normals(mesh) * offset[:, None])


def normals(mesh: Mesh) -> np.ndarray:
    """Return ``[n, 3]`` unit normals of the vertices: area-weighted means over adjacent faces."""
    corner = mesh.vertices[mesh.faces]
    area = np.cross(corner[:, 2] - corner[:, 0], corner[:, 3] - corner[:, 1])
    total = np.zeros_like(mesh.vertices)
    for k in range(4):
        np.add.at(total, mesh.faces[:, k], area)
    # Vertices at the same position, as at the pole of a grid, must move together.
    _, same = np.unique(np.round(mesh.vertices, 6), axis=0, return_inverse=True)
    merged = np.zeros((same.max() + 1, 3))
    np.add.at(merged, same.ravel(), total)
    total = merged[same.ravel()]
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12)


def join(*meshes: Mesh) -> Mesh:
    """Return one mesh that contains several."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]),
    )


def move(mesh: Mesh, offset: Point) -> Mesh:
    """Return the mesh translated by an offset."""
    return mesh._replace(vertices=mesh.vertices + np.asarray(offset))


def transform(mesh: Mesh, matrix: np.ndarray) -> Mesh:
    """Return the mesh transformed by a ``[4, 4]`` matrix."""
    return mesh._replace(vertices=mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3])


def pose(
    location: Point = (0.0, 0.0, 0.0),
    turn: float = 0.0,
    tilt: float = 0.0,
    roll: float = 0.0,
    scale: float = 1.0,
) -> np.ndarray:
    """Return the ``[4, 4]`` matrix that scales, rolls about x, tilts about y, turns about z, moves.

    Angles are in radians.
    """
    matrix = np.eye(4)
    matrix[:3, :3] = scale * (_rotation(2, turn) @ _rotation(1, tilt) @ _rotation(0, roll))
    matrix[:3, 3] = location
    return matrix


def _rotation(axis: int, angle: float) -> np.ndarray:
    first, second = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[first, first] = matrix[second, second] = np.cos(angle)
    matrix[second, first], matrix[first, second] = np.sin(angle), -np.sin(angle)
    return matrix


def _perpendicular(direction: np.ndarray) -> np.ndarray:
    other = np.eye(3)[np.argmin(np.abs(direction))]
    normal = np.cross(direction, other)
    return normal / np.linalg.norm(normal)
