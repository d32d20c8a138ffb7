"""Surfaces as arrays, with closed-form intersection.

Every surface is a quadric in its own coordinates, cut to a box and, if it is flat, to an outline:

``curvature . (x^2, y^2, z^2) + slope * z + constant = 0``

Planes, boxes, ellipsoids, cylinders, cones, bowls, vases and bent leaves are all of that form, so a
scene is one set of arrays (not a list of objects), can be drawn at random, vmapped and compiled
once, and the nearest surface along a ray is found exactly.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from occjax.data.poses import compose, translation
from occjax.data.textures import Materials, Scalar, Triple


class Surfaces(NamedTuple):
    """Quadric patches, one entry per surface.

    Attributes:
        to_own: ``[n, 3, 4]`` affine map from scene coordinates to the surface's own coordinates.
        curvature: ``[n, 3]`` coefficients of x^2, y^2 and z^2.
        slope: ``[n]`` coefficient of z.
        constant: ``[n]`` constant coefficient.
        extent: ``[n, 2, 3]`` lower and upper corner of the box that the surface is cut to.
        outline: ``[n, 4]`` coefficients ``o`` of the outline: what is kept has
            ``o[0] x^2 + o[1] y^2 + o[2] |y| + o[3] <= 0``.
        materials: What the surfaces look like.
    """

    to_own: Float[Array, "n 3 4"]
    curvature: Float[Array, "n 3"]
    slope: Float[Array, " n"]
    constant: Float[Array, " n"]
    extent: Float[Array, "n 2 3"]
    outline: Float[Array, "n 4"]
    materials: Materials


FAR = 1e6
"""Half the size of the box of a surface that is not cut."""


def quadric(
    pose: Float[Array, "3 4"],
    materials: Materials,
    *,
    curvature: Triple = (0.0, 0.0, 0.0),
    slope: Scalar = 0.0,
    constant: Scalar = 0.0,
    lower: Triple = (-FAR, -FAR, -FAR),
    upper: Triple = (FAR, FAR, FAR),
    outline: tuple[Scalar, Scalar, Scalar, Scalar] = (0.0, 0.0, 0.0, 0.0),
) -> Surfaces:
    """One quadric patch; the other constructors are special cases.

    Args:
        pose: ``[3, 4]`` affine map from the surface's own to scene coordinates.
        materials: One material.
        curvature: Coefficients of x^2, y^2 and z^2.
        slope: Coefficient of z.
        constant: Constant coefficient.
        lower: Corner of the box that the surface is cut to, in own coordinates.
        upper: The opposite corner.
        outline: See :class:`Surfaces`.
    """
    linear = jnp.linalg.inv(pose[:, :3])
    to_own = jnp.concatenate([linear, -(linear @ pose[:, 3:])], axis=1)
    return Surfaces(
        to_own=to_own[None],
        curvature=jnp.asarray([curvature], jnp.float32),
        slope=jnp.asarray([slope], jnp.float32),
        constant=jnp.asarray([constant], jnp.float32),
        extent=jnp.asarray([[lower, upper]], jnp.float32),
        outline=jnp.asarray([outline], jnp.float32),
        materials=materials,
    )


def plane(pose: Float[Array, "3 4"], materials: Materials) -> Surfaces:
    """The unbounded plane z = 0."""
    return quadric(pose, materials, slope=1.0)


def disc(pose: Float[Array, "3 4"], materials: Materials, radius: Scalar) -> Surfaces:
    """A flat disc around the z axis."""
    return quadric(pose, materials, slope=1.0, outline=(1.0, 1.0, 0.0, -(radius**2)))


def ellipsoid(pose: Float[Array, "3 4"], materials: Materials, radii: Triple) -> Surfaces:
    """An ellipsoid around the origin."""
    curvature = tuple(radius**-2.0 for radius in radii)
    return quadric(pose, materials, curvature=curvature, constant=-1.0)


def box(
    pose: Float[Array, "3 4"],
    materials: tuple[Materials, Materials, Materials],
    half: Triple,
) -> Surfaces:
    """A box around the origin: three pairs of parallel faces (across x, y and z)."""
    pairs = []
    for axis in range(3):
        curvature: list[Scalar] = [0.0, 0.0, 0.0]
        curvature[axis] = half[axis] ** -2.0
        # The pair's own faces lie a little inside the cut, where rounding cannot lose them.
        margin = [size * (1.001 if other == axis else 1.0) for other, size in enumerate(half)]
        pairs.append(
            quadric(
                pose,
                materials[axis],
                curvature=tuple(curvature),
                constant=-1.0,
                lower=tuple(-size for size in margin),
                upper=tuple(margin),
            )
        )
    return join(*pairs)


def tube(
    pose: Float[Array, "3 4"],
    materials: Materials,
    *,
    bottom: Scalar,
    top: Scalar,
    radius: Scalar,
    flare: Scalar = 0.0,
) -> Surfaces:
    """A wall of revolution around z: ``x^2 + y^2 = radius^2 + flare * z^2``, cut at both ends.

    ``flare`` 0 is a cylinder; positive is a hyperboloid with its waist at z = 0 (the neck of a
    vase), and with ``radius`` 0 a cone.
    """
    return quadric(
        pose,
        materials,
        curvature=(1.0, 1.0, -flare),
        constant=-(radius**2),
        lower=(-FAR, -FAR, bottom),
        upper=(FAR, FAR, top),
    )


def bowl(
    pose: Float[Array, "3 4"],
    materials: Materials,
    radii: Triple,
    *,
    bottom: Scalar,
    top: Scalar,
) -> Surfaces:
    """An ellipsoid around the origin, open where it is cut at two heights z."""
    return quadric(
        pose,
        materials,
        curvature=tuple(radius**-2.0 for radius in radii),
        constant=-1.0,
        lower=(-FAR, -FAR, bottom),
        upper=(FAR, FAR, top),
    )


def leaf(
    pose: Float[Array, "3 4"],
    materials: Materials,
    length: Scalar,
    width: Scalar,
    bend: Scalar = 0.0,
) -> Surfaces:
    """A leaf along x from 0 to ``length``: pointed at both ends, arched to the height ``bend``.

    Its outline is the lens in which two circles through both ends overlap.
    """
    half, breadth = 0.5 * length, 0.5 * width
    lift = (half**2 - breadth**2) / (2.0 * breadth)
    centred = compose(pose, translation(half, 0.0, 0.0))
    # The sheet z = bend * (1 - x^2 / half^2) is an arch from end to end.
    return quadric(
        centred,
        materials,
        curvature=(bend / half**2, 0.0, 0.0),
        slope=1.0,
        constant=-bend,
        outline=(1.0, 1.0, 2.0 * lift, -(half**2)),
    )


def join(*parts: Surfaces) -> Surfaces:
    """All surfaces of the parts in one set of arrays."""
    return jax.tree.map(lambda *arrays: jnp.concatenate(arrays), *parts)


class Hits(NamedTuple):
    """The hit of each ray.

    Attributes:
        distance: ``[r]`` ray parameter of the hit, infinite where nothing is hit.
        surface: ``[r]`` int32 index of the surface, 0 where nothing is hit.
    """

    distance: Float[Array, " r"]
    surface: Int[Array, " r"]


def first_hits(
    surfaces: Surfaces,
    origins: Float[Array, "r 3"],
    directions: Float[Array, "r 3"],
    start: Float[Array, ""] | float = -jnp.inf,
) -> Hits:
    """First surface that each ray ``origin + distance * direction`` meets after ``start``.

    Surfaces are visited one after the other: memory is that of the rays alone.

    Args:
        surfaces: The scene.
        origins: ``[r, 3]`` in scene coordinates.
        directions: ``[r, 3]``, of any length.
        start: Smallest ray parameter that counts.
    """

    def visit(nearest: Hits, numbered):
        index, surface = numbered
        distance = _distance(surface, origins, directions, start)
        nearer = distance < nearest.distance
        return Hits(
            jnp.where(nearer, distance, nearest.distance),
            jnp.where(nearer, index, nearest.surface),
        ), None

    rays = origins.shape[0]
    nothing = Hits(jnp.full(rays, jnp.inf, origins.dtype), jnp.zeros(rays, jnp.int32))
    count = surfaces.slope.shape[0]
    hits, _ = jax.lax.scan(visit, nothing, (jnp.arange(count, dtype=jnp.int32), surfaces))
    return hits


def _distance(surface, origins, directions, start) -> Float[Array, " r"]:
    """Ray parameter at which each ray first meets one surface (fields without the leading axis)."""
    linear, offset = surface.to_own[:, :3], surface.to_own[:, 3]
    direction = [_dot(linear[axis], directions) for axis in range(3)]
    origin = [_dot(linear[axis], origins) + offset[axis] for axis in range(3)]
    # Measure from the point of the ray nearest to the surface's origin: the coefficients below are
    # then of the size of the surface, not of the distance to it, and float32 is exact enough.
    length = sum(component**2 for component in direction)
    anchor = -sum(o * d for o, d in zip(origin, direction, strict=True)) / length
    origin = [o + anchor * d for o, d in zip(origin, direction, strict=True)]

    a = sum(surface.curvature[i] * direction[i] ** 2 for i in range(3))
    b = sum(surface.curvature[i] * direction[i] * origin[i] for i in range(3))
    b = b + 0.5 * surface.slope * direction[2]
    c = sum(surface.curvature[i] * origin[i] ** 2 for i in range(3))
    c = c + surface.slope * origin[2] + surface.constant
    discriminant = b * b - a * c
    root = jnp.sqrt(jnp.maximum(discriminant, 0.0))
    q = -(b + jnp.where(b < 0.0, -root, root))  # never a difference of nearly equal numbers

    def accepted(numerator, denominator):
        exists = (discriminant >= 0.0) & (jnp.abs(denominator) > 1e-12 * length)
        step = numerator / jnp.where(exists, denominator, 1.0)
        point = [o + step * d for o, d in zip(origin, direction, strict=True)]
        for axis in range(3):
            exists &= (point[axis] >= surface.extent[0, axis]) & (
                point[axis] <= surface.extent[1, axis]
            )
        rim = surface.outline[0] * point[0] ** 2 + surface.outline[1] * point[1] ** 2
        rim = rim + surface.outline[2] * jnp.abs(point[1]) + surface.outline[3]
        distance = anchor + step
        return jnp.where(exists & (rim <= 0.0) & (distance > start), distance, jnp.inf)

    return jnp.minimum(accepted(q, a), accepted(c, q))


def own_points(surfaces: Surfaces, index: Int[Array, " r"], points: Float[Array, "r 3"]):
    """Points of the scene in the coordinates of one surface each."""
    maps = surfaces.to_own[index]
    return jnp.einsum("rij,rj->ri", maps[:, :, :3], points, precision="highest") + maps[:, :, 3]


def normals(surfaces: Surfaces, index: Int[Array, " r"], own: Float[Array, "r 3"]):
    """Unit normals in scene coordinates at points given in the coordinates of their surface."""
    upwards = jnp.array([[0.0, 0.0, 1.0]]) * surfaces.slope[index][:, None]
    gradient = 2.0 * surfaces.curvature[index] * own + upwards
    normal = jnp.einsum(
        "rij,ri->rj", surfaces.to_own[index][:, :, :3], gradient, precision="highest"
    )
    return normal / jnp.maximum(jnp.linalg.norm(normal, axis=-1, keepdims=True), 1e-20)


def _dot(row: Float[Array, "3"], vectors: Float[Array, "r 3"]) -> Float[Array, " r"]:
    return row[0] * vectors[:, 0] + row[1] * vectors[:, 1] + row[2] * vectors[:, 2]
