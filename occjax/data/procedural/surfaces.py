"""Curved surfaces and solids in disparity space, intersected with rays in closed form.

Points have the coordinates ``(X, Y, d)``: the column and row, in pixels from the image centre, at
which the centre view sees them, and their disparity. The ray of pixel ``(y, x)`` of the view at
offset ``(t, s)`` is the line ``(x + s d, y + t d, d)``. So ``d`` is the parameter of every ray, the
nearest hit has the largest ``d``, and the coefficients of ``d`` depend only on the view.

All surfaces are quadrics ``f = curvature . p^2 + slope p_z + constant`` in local coordinates
``p = linear (X, Y, d) + shift``:

* a wall is ``f = 0``;
* a sheet is ``f = 0`` where its outline, a binary image over the square ``[-1, 1]^2`` of local x
  and y, is true;
* a solid is ``f <= 0`` cut to a box: an ellipsoid, a capped cylinder, a box.

Arrays have one entry per ray and no trailing axis of components: compilers turn that into much
faster code on a CPU.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int


class Quadrics(NamedTuple):
    """Quadric surfaces, one entry each.

    Attributes:
        linear: ``[n, 3, 3]`` map from ``(X, Y, d)`` to local coordinates.
        shift: ``[n, 3]`` local coordinates of the origin.
        curvature: ``[n, 3]`` coefficients of x^2, y^2, z^2.
        slope: ``[n]`` coefficient of z.
        constant: ``[n]`` constant coefficient.
        half: ``[n, 3]`` half the size of the box that a solid is cut to; negative if absent.
    """

    linear: Float[Array, "n 3 3"]
    shift: Float[Array, "n 3"]
    curvature: Float[Array, "n 3"]
    slope: Float[Array, " n"]
    constant: Float[Array, " n"]
    half: Float[Array, "n 3"]


class Geometry(NamedTuple):
    """All surfaces of a scene; the index of a surface counts through walls, sheets, solids.

    Attributes:
        walls: Unbounded surfaces. The first is the plane at the lowest disparity, hit by every ray
            that hits nothing else.
        sheets: Thin surfaces with outlines.
        outlines: ``[sheets, m, m]`` true inside the outline, over local y and x.
        solids: Solids, cut to boxes.
        limits: ``[2]`` lowest and highest disparity of any hit.
    """

    walls: Quadrics
    sheets: Quadrics
    outlines: Bool[Array, "sheets m m"]
    solids: Quadrics
    limits: Float[Array, "2"]

    @property
    def surfaces(self) -> Quadrics:
        """All surfaces in the order of their indices."""
        parts = zip(self.walls, self.sheets, self.solids, strict=True)
        return Quadrics(*(jnp.concatenate(values) for values in parts))


class Hits(NamedTuple):
    """First hits of rays: disparity and index of the surface."""

    disparity: Float[Array, "*r"]
    surface: Int[Array, "*r"]


def first_hits(
    geometry: Geometry, y: Float[Array, "*r"], x: Float[Array, "*r"], offset: Float[Array, "2"]
) -> Hits:
    """Return the nearest surface along rays of one view.

    Args:
        geometry: The scene.
        y: Row at which each ray meets the view's image, in pixels from the image centre.
        x: Column of the same point.
        offset: ``[2]`` row and column offset of the view from the centre view, in view steps.

    Returns:
        Disparity and surface of each ray.
    """
    lowest, highest = geometry.limits

    def within(disparity):
        return (disparity >= lowest) & (disparity <= highest)

    def meet_wall(nearest: Hits, item):
        surface, index = item
        upper, lower = _crossings(surface, *_local_rays(surface, y, x, offset))
        found = jnp.where(within(upper), upper, jnp.where(within(lower), lower, -jnp.inf))
        return _nearer(nearest, found, index), None

    def meet_sheet(nearest: Hits, item):
        surface, outline, index = item
        origin, direction = _local_rays(surface, y, x, offset)

        def kept(disparity):
            inside = _lookup(
                outline, origin[1] + disparity * direction[1], origin[0] + disparity * direction[0]
            )
            return within(disparity) & inside

        upper, lower = _crossings(surface, origin, direction)
        found = jnp.where(kept(upper), upper, jnp.where(kept(lower), lower, -jnp.inf))
        return _nearer(nearest, found, index), None

    def meet_solid(nearest: Hits, item):
        surface, index = item
        origin, direction = _local_rays(surface, y, x, offset)
        upper, lower = _crossings(surface, origin, direction)
        enter, leave = jnp.minimum(upper, highest), jnp.maximum(lower, lowest)
        for axis in range(3):
            towards = jnp.where(jnp.abs(direction[axis]) < 1e-9, 1e-9, direction[axis])
            slowness = 1.0 / towards
            middle, reach = -origin[axis] * slowness, surface.half[axis] * jnp.abs(slowness)
            enter, leave = jnp.minimum(enter, middle + reach), jnp.maximum(leave, middle - reach)
        found = jnp.where(enter >= leave, enter, -jnp.inf)
        return _nearer(nearest, found, index), None

    parts = (geometry.walls, geometry.sheets, geometry.solids)
    ends = np.cumsum([len(part.slope) for part in parts])
    walls, sheets, solids = jnp.split(jnp.arange(ends[-1], dtype=jnp.int32), ends[:-1])
    nearest = Hits(jnp.full(x.shape, lowest), jnp.zeros(x.shape, jnp.int32))
    nearest, _ = jax.lax.scan(meet_wall, nearest, (geometry.walls, walls))
    nearest, _ = jax.lax.scan(meet_sheet, nearest, (geometry.sheets, geometry.outlines, sheets))
    nearest, _ = jax.lax.scan(meet_solid, nearest, (geometry.solids, solids))
    return nearest


def interpolate(
    image: Float[Array, "m n"], y: Float[Array, "*r"], x: Float[Array, "*r"]
) -> Float[Array, "*r"]:
    """Interpolate bilinearly in an image over the square [-1, 1]^2; the border is replicated."""
    m, n = image.shape
    row = jnp.clip((y + 1.0) * (0.5 * (m - 1)), 0.0, m - 1.001)
    column = jnp.clip((x + 1.0) * (0.5 * (n - 1)), 0.0, n - 1.001)
    whole_row, whole_column = row.astype(jnp.int32), column.astype(jnp.int32)
    part_row = row - whole_row.astype(row.dtype)
    part_column = column - whole_column.astype(column.dtype)
    flat, first = image.reshape(-1), whole_row * n + whole_column
    top, bottom = (
        take_unchecked(flat, left) * (1.0 - part_column)
        + take_unchecked(flat, left + 1) * part_column
        for left in (first, first + n)
    )
    return top * (1.0 - part_row) + bottom * part_row


def _lookup(image: Bool[Array, "m m"], y, x):
    """Return the nearest pixel of a binary image over the square [-1, 1]^2; false outside."""
    m = image.shape[0]
    row, column = jnp.floor((y + 1.0) * (0.5 * m)), jnp.floor((x + 1.0) * (0.5 * m))
    inside = (jnp.abs(y) < 1.0) & (jnp.abs(x) < 1.0)
    index = jnp.where(inside, row * m + column, 0.0).astype(jnp.int32)
    return take_unchecked(image.reshape(-1), jnp.minimum(index, m * m - 1)) & inside


def take_unchecked(values: Array, index: Int[Array, "*r"]) -> Array:
    """Return values at indices that are known to be within bounds, without checking them."""
    return values.at[index].get(mode="promise_in_bounds")


def _local_rays(surface: Quadrics, y, x, offset):
    """Return rays in local coordinates: origins at zero disparity, by component, and direction."""
    across, down, away = surface.linear[:, 0], surface.linear[:, 1], surface.linear[:, 2]
    origin = [across[axis] * x + down[axis] * y + surface.shift[axis] for axis in range(3)]
    return origin, across * offset[1] + down * offset[0] + away


def _crossings(surface: Quadrics, origin, direction):
    """Return the larger and the smaller disparity at which rays cross ``f = 0``.

    They are NaN or infinite if there is no crossing. The roots of ``a d^2 + 2 b d + c`` are
    computed as ``c / q`` and ``q / a``, which stay exact as ``a`` goes to zero.
    """
    a = jnp.sum(surface.curvature * direction**2)
    a = jnp.where(jnp.abs(a) < 1e-12, 1e-12, a)
    b = 0.5 * surface.slope * direction[2]
    c = surface.slope * origin[2] + surface.constant
    for axis in range(3):
        bent = surface.curvature[axis] * origin[axis]
        b, c = b + bent * direction[axis], c + bent * origin[axis]
    root = jnp.sqrt(b * b - a * c)
    q = -(b + jnp.copysign(root, b))
    one, other = c / q, q * (1.0 / a)
    return jnp.maximum(one, other), jnp.minimum(one, other)


def _nearer(nearest: Hits, found: Float[Array, "*r"], index: Int[Array, ""]) -> Hits:
    """Return the nearer of two hits."""
    closer = found > nearest.disparity
    return Hits(
        jnp.where(closer, found, nearest.disparity), jnp.where(closer, index, nearest.surface)
    )
