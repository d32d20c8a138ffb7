"""First hit of one ray, by polynomial roots in float64 and membership tests point by point."""

import numpy as np

CLEAR = 2e-3
"""A ray is clear of edges where surfaces larger or smaller by this, of own size, change nothing."""

SHORTEST = 0.02
"""A solid is met clearly where the ray is within it for this much disparity."""


def first_hit(geometry, y, x, offset):
    """Disparity and surface that one ray meets first, and whether it stays clear of edges."""
    low, high = (float(limit) for limit in geometry.disparity_range)
    hits, clear = [(low, 0)], True
    index = -1
    for kind in ("walls", "sheets", "solids"):
        surfaces = getattr(geometry, kind)
        for i in range(surfaces.linear.shape[0]):
            index += 1
            part = {
                name: np.asarray(values[i], np.float64)
                for name, values in surfaces._asdict().items()
            }
            origin = part["matrix"] @ np.array([x, y, 0.0]) + part["translation"]
            direction = part["matrix"] @ np.array([offset[1], offset[0], 1.0])
            candidates = [
                d
                for d in _candidates(part, origin, direction, low, high, kind)
                if low - 1e-9 <= d <= high + 1e-9
            ]
            if kind == "sheets":
                outline = np.asarray(geometry.outlines[i])
                found = []
                for d in candidates:
                    around = _outline_around(outline, origin + d * direction)
                    clear = clear and len(set(around)) == 1
                    found += [d] if around[0] else []
            elif kind == "solids":
                found = [d for d in candidates if _within(part, origin + d * direction, 1e-9)]
                near = [d for d in candidates if _within(part, origin + d * direction, CLEAR)]
                clear = clear and bool(found) == bool(near)
                clear = clear and (not found or max(found) - min(found) > SHORTEST)
            else:
                found = candidates
            if found:
                hits.append((max(found), index))
    hits.sort(key=lambda hit: hit[0])
    near = {surface for d, surface in hits if hits[-1][0] - d < 1e-3}
    clear = clear and len(near) == 1
    return (*hits[-1], clear)


def _candidates(part, origin, direction, low, high, kind):
    """Disparities at which a ray may enter or meet a surface."""
    quadratic = np.sum(part["quadratic"] * direction**2)
    linear = 2 * np.sum(part["quadratic"] * origin * direction) + part["linear"] * direction[2]
    constant = np.sum(part["quadratic"] * origin**2) + part["linear"] * origin[2] + part["constant"]
    polynomial = np.trim_zeros([quadratic, linear, constant], "f")
    roots = np.roots(polynomial) if len(polynomial) > 1 else np.zeros(0)
    candidates = [root.real for root in roots if abs(root.imag) < 1e-12]
    if kind == "solids":
        with np.errstate(divide="ignore", invalid="ignore"):  # a ray along a face never meets it
            for sign in (-1.0, 1.0):
                candidates.extend((sign * part["half_extent"] - origin) / direction)
        candidates.extend([low, high])
    return candidates


def _within(part, point, slack):
    """Whether a point is within a solid that is larger by a little."""
    level = np.sum(part["quadratic"] * point**2) + part["linear"] * point[2] + part["constant"]
    return bool(level <= slack and (np.abs(point) <= part["half_extent"] + slack).all())


def _outline_around(outline, point):
    """Whether a sheet is there at a point, and at points around it."""
    shifts = [(0, 0), (-CLEAR, -CLEAR), (-CLEAR, CLEAR), (CLEAR, -CLEAR), (CLEAR, CLEAR)]
    return [_cell(outline, outline.shape[0], point[1] + y, point[0] + x) for y, x in shifts]


def _cell(outline, size, y, x):
    if abs(y) >= 1 or abs(x) >= 1:
        return False
    return bool(outline[int((y + 1) / 2 * size), int((x + 1) / 2 * size)])
