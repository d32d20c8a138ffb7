"""Curved surfaces and solids in disparity space, intersected with rays in closed form.

Points have the coordinates ``(X, Y, d)``: the column and row, in pixels from the image centre, at
which the centre view sees them, and their disparity. The ray of pixel ``(y, x)`` of the view at
offset ``(t, s)`` is the line ``(x + s d, y + t d, d)``. So ``d`` is the parameter of every ray, the
nearest hit has the largest ``d``, and the coefficients of ``d`` depend only on the view.

All surfaces are quadrics ``f = quadratic . p^2 + linear p_z + constant`` in local coordinates
``p = matrix (X, Y, d) + translation``:

* a wall is ``f = 0``;
* a sheet is ``f = 0`` where its outline, a binary image over the square ``[-1, 1]^2`` of local x
  and y, is true;
* a solid is ``f <= 0`` inside the box ``|p| <= half_extent``: an ellipsoid, a capped cylinder, a
  box.

Images over the square ``[-1, 1]^2`` have rows along y and columns along x. Outlines are sampled at
the nearest pixel: the square is divided into as many cells as there are pixels
(``align_corners=False`` in PyTorch). Maps are sampled bilinearly: the centres of the outermost
pixels are at -1 and 1 (``align_corners=True``).

Arrays have one near per ray and no trailing axis of components: compilers turn that into much
faster code on a CPU.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int


class Quadrics(NamedTuple):
    """Quadric surfaces, one near each.

    Attributes:
        matrix: ``[n, 3, 3]`` linear part of the map from ``(X, Y, d)`` to local coordinates.
        translation: ``[n, 3]`` constant part of that map: local coordinates of the origin.
        quadratic: ``[n, 3]`` coefficients of x^2, y^2, z^2.
        linear: ``[n]`` coefficient of z.
        constant: ``[n]`` constant coefficient.
        half_extent: ``[n, 3]`` half the side lengths of the box of a solid, in local coordinates;
            negative if the solid is absent.
    """

    matrix: Float[Array, "n 3 3"]
    translation: Float[Array, "n 3"]
    quadratic: Float[Array, "n 3"]
    linear: Float[Array, " n"]
    constant: Float[Array, " n"]
    half_extent: Float[Array, "n 3"]


class Geometry(NamedTuple):
    """All surfaces of a scene; the index of a surface counts through walls, sheets, solids.

    Attributes:
        walls: Unbounded surfaces. The first is the plane at the lowest disparity, hit by every ray
            that hits nothing else.
        sheets: Thin surfaces with outlines.
        outlines: ``[sheets, m, m]`` true inside the outline, over local y and x.
        solids: Solids, cut to boxes.
        disparity_range: ``[2]`` lowest and highest disparity of any hit.
    """

    walls: Quadrics
    sheets: Quadrics
    outlines: Bool[Array, "sheets m m"]
    solids: Quadrics
    disparity_range: Float[Array, "2"]

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
    lowest, highest = geometry.disparity_range

    def in_range(disparity):
        return (disparity >= lowest) & (disparity <= highest)

    def meet_wall(nearest: Hits, item):
        surface, index = item
        upper, lower = _intersections(surface, *_local_rays(surface, y, x, offset))
        found = _first_valid(in_range, upper, lower)
        return _nearer(nearest, found, index), None

    def meet_sheet(nearest: Hits, item):
        surface, outline, index = item
        origin, direction = _local_rays(surface, y, x, offset)

        def on_sheet(disparity):
            local_x, local_y = (origin[axis] + disparity * direction[axis] for axis in (0, 1))
            return in_range(disparity) & _sample_nearest(outline, local_y, local_x)

        upper, lower = _intersections(surface, origin, direction)
        found = _first_valid(on_sheet, upper, lower)
        return _nearer(nearest, found, index), None

    def meet_solid(nearest: Hits, item):
        surface, index = item
        origin, direction = _local_rays(surface, y, x, offset)
        upper, lower = _intersections(surface, origin, direction)
        near, far = jnp.minimum(upper, highest), jnp.maximum(lower, lowest)
        # The slab method (Kay and Kajiya, 1986): the box is the intersection of three slabs.
        for axis in range(3):
            inverse = 1.0 / jnp.where(jnp.abs(direction[axis]) < 1e-9, 1e-9, direction[axis])
            centre = -origin[axis] * inverse
            half_width = surface.half_extent[axis] * jnp.abs(inverse)
            near = jnp.minimum(near, centre + half_width)
            far = jnp.maximum(far, centre - half_width)
        found = jnp.where(near >= far, near, -jnp.inf)
        return _nearer(nearest, found, index), None

    parts = (geometry.walls, geometry.sheets, geometry.solids)
    ends = np.cumsum([len(part.linear) for part in parts])
    walls, sheets, solids = jnp.split(jnp.arange(ends[-1], dtype=jnp.int32), ends[:-1])
    nearest = Hits(jnp.full(x.shape, lowest), jnp.zeros(x.shape, jnp.int32))
    nearest, _ = jax.lax.scan(meet_wall, nearest, (geometry.walls, walls))
    nearest, _ = jax.lax.scan(meet_sheet, nearest, (geometry.sheets, geometry.outlines, sheets))
    nearest, _ = jax.lax.scan(meet_solid, nearest, (geometry.solids, solids))
    return nearest


def sample_bilinear(
    image: Float[Array, "m n"], y: Float[Array, "*r"], x: Float[Array, "*r"]
) -> Float[Array, "*r"]:
    """Interpolate bilinearly in an image over the square [-1, 1]^2.

    The centres of the outermost pixels are at -1 and 1. Outside, the border is replicated.
    """
    m, n = image.shape
    row = jnp.clip((y + 1.0) * (0.5 * (m - 1)), 0.0, m - 1.001)
    column = jnp.clip((x + 1.0) * (0.5 * (n - 1)), 0.0, n - 1.001)
    top_row, left_column = row.astype(jnp.int32), column.astype(jnp.int32)
    row_fraction = row - top_row.astype(row.dtype)
    column_fraction = column - left_column.astype(column.dtype)
    flat, first = image.reshape(-1), top_row * n + left_column
    top, bottom = (
        take_unchecked(flat, left) * (1.0 - column_fraction)
        + take_unchecked(flat, left + 1) * column_fraction
        for left in (first, first + n)
    )
    return top * (1.0 - row_fraction) + bottom * row_fraction


def _sample_nearest(image: Bool[Array, "m m"], y, x):
    """Return the nearest pixel of a binary image over the square [-1, 1]^2; false outside.

    Pixel ``i`` of a row of ``m`` covers ``-1 + 2 i / m`` to ``-1 + 2 (i + 1) / m``.
    """
    m = image.shape[0]
    row, column = jnp.floor((y + 1.0) * (0.5 * m)), jnp.floor((x + 1.0) * (0.5 * m))
    inside = (jnp.abs(y) < 1.0) & (jnp.abs(x) < 1.0)
    index = jnp.where(inside, row * m + column, 0.0).astype(jnp.int32)
    return take_unchecked(image.reshape(-1), jnp.minimum(index, m * m - 1)) & inside


def take_unchecked(values: Array, index: Int[Array, "*r"]) -> Array:
    """Return values at indices that are known to be within bounds, without checking them."""
    return values.at[index].get(mode="promise_in_bounds")


def _local_rays(surface: Quadrics, y, x, offset):
    """Return rays ``origin + d direction`` in local coordinates.

    Returns:
        The three components of the origins, at zero disparity, one value per ray; and the direction
        ``[3]``, which all rays of a view share.
    """
    x_axis, y_axis, d_axis = surface.matrix.T
    origin = [x_axis[i] * x + y_axis[i] * y + surface.translation[i] for i in range(3)]
    return origin, x_axis * offset[1] + y_axis * offset[0] + d_axis


def _intersections(surface: Quadrics, origin, direction):
    """Return the larger and the smaller disparity at which rays meet ``f = 0``.

    They are NaN or infinite if a ray does not meet it. The roots of ``a d^2 + 2 b d + c`` are
    computed as ``c / q`` and ``q / a``, which stay exact as ``a`` goes to zero.
    """
    a = jnp.sum(surface.quadratic * direction**2)
    a = jnp.where(jnp.abs(a) < 1e-12, 1e-12, a)
    b = 0.5 * surface.linear * direction[2]
    c = surface.linear * origin[2] + surface.constant
    for axis in range(3):
        scaled = surface.quadratic[axis] * origin[axis]
        b, c = b + scaled * direction[axis], c + scaled * origin[axis]
    root = jnp.sqrt(b * b - a * c)
    q = -(b + jnp.copysign(root, b))
    roots = c / q, q * (1.0 / a)
    return jnp.maximum(*roots), jnp.minimum(*roots)


def _first_valid(valid, upper, lower):
    """Return the larger disparity if it is valid, else the smaller one, else -inf."""
    return jnp.where(valid(upper), upper, jnp.where(valid(lower), lower, -jnp.inf))


def _nearer(nearest: Hits, found: Float[Array, "*r"], index: Int[Array, ""]) -> Hits:
    """Return the nearer of two hits."""
    closer = found > nearest.disparity
    return Hits(
        jnp.where(closer, found, nearest.disparity), jnp.where(closer, index, nearest.surface)
    )
