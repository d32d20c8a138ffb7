"""Which of two surfaces hides the other: the one thing that tells the sign of disparity.

Reversing both axes of the grid of views is the same as negating disparity, so the views agree just
as well and photo-consistency cannot tell the two apart. Occlusion can: where two points of the
centre view fall on the same pixel of another view, that view shows the nearer one, and with the
right sign this is the one of larger disparity.

A point counts only if the opposite view, the mirror image of the other one about the centre, shows
it. What is hidden on one side of a nearer surface is nearly always seen on the other; a point of
the background that the disparity map's blur has given the nearer surface's disparity is shown
by neither, and would vote for the wrong sign.
"""

from __future__ import annotations

import numpy as np

from occjax.io.orientation import Orientation
from occjax.io.photoconsistency import Arm, Cross, motion

COLLISION_PIXELS = 1.5
"""Two points that fall together must come from further apart than rounding could bring them."""

SEEN, HIDDEN = 0.04, 0.08
"""Grey difference, relative to the brightness of the centre view, below which a point counts as the
one shown, above which as not shown.

Hidden points are often misplaced by the blur of the disparity map over the edge of what hides them;
asking for a marked contrast between the two leaves those out.
"""

FEWEST_VOTES = 50
"""Collisions with a decided outcome below which nothing is said."""


def nearer_in_front(cross: Cross, disparity: np.ndarray, orientation: Orientation) -> float | None:
    """Share of decided collisions in which the point of larger disparity is the one shown.

    Args:
        cross: Views around the centre, with their brightness.
        disparity: ``[h, w]`` disparity of the centre view under ``orientation``, in pixels of the
            light field per view step.
        orientation: The layout of the grid that is assumed.

    Returns:
        Share in [0, 1], each collision weighted by the squared contrast of its two points: near 1
        if the sign is right and near 0 if it is reversed; None where too few collide.
    """
    near = far = 0.0
    votes = 0
    fallen = [_outermost_view(cross, arm, disparity, orientation) for arm in cross.arms]
    for arm, (displacement, difference) in zip(cross.arms, fallen, strict=True):
        axis, _ = motion(arm.along_row, orientation)
        known = np.ones(disparity.shape, bool)
        for other, (_, of_opposite) in zip(cross.arms, fallen, strict=True):
            if other.along_row == arm.along_row and other is not arm:
                known = of_opposite < HIDDEN
        maps = (difference, disparity, displacement, known)
        small, large, gap = _collisions(*(m if axis == 1 else m.T for m in maps))
        met = gap >= COLLISION_PIXELS
        large_shown = met & (large < SEEN) & (small > HIDDEN)
        small_shown = met & (small < SEEN) & (large > HIDDEN)
        near += float(np.sum(small[large_shown] ** 2))
        far += float(np.sum(large[small_shown] ** 2))
        votes += int(large_shown.sum() + small_shown.sum())
    return near / (near + far) if votes >= FEWEST_VOTES else None


def _outermost_view(
    cross: Cross, arm: Arm, disparity: np.ndarray, orientation: Orientation
) -> tuple[np.ndarray, np.ndarray]:
    """Where points fall in the outermost view of an arm, and how unlike they are to what it shows.

    Returns:
        ``[h, w]`` pixels that each point moves towards index 0, and ``[h, w]`` grey differences.
    """
    offset, image = max(zip(arm.offsets, arm.images, strict=True), key=lambda pair: abs(pair[0]))
    axis, sign = motion(arm.along_row, orientation)
    displacement = disparity * np.float32(sign * offset / cross.scale)
    return displacement, _difference(cross.centre, image, displacement, axis)


def _difference(
    centre: np.ndarray, view: np.ndarray, displacement: np.ndarray, axis: int
) -> np.ndarray:
    """``[h, w]`` grey difference between each point and what a view shows where it falls."""
    if axis == 0:
        return _difference(centre.T, view.T, displacement.T, 1).T
    h, w = centre.shape
    target = np.arange(w) - displacement
    base = np.clip(np.floor(target).astype(np.int64), 0, w - 2)
    fraction = target - base
    row = np.arange(h)[:, None]
    shown = view[row, base] * (1 - fraction) + view[row, base + 1] * fraction
    return np.abs(shown - centre)


def _collisions(
    difference: np.ndarray, disparity: np.ndarray, displacement: np.ndarray, counts: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where points of the centre view fall on one pixel of a view that moves along x.

    Args:
        difference: ``[h, w]`` grey difference between each point and what the view shows there.
        disparity: ``[h, w]``, by which points are ranked.
        displacement: ``[h, w]`` pixels that each point is moved towards lower x.
        counts: ``[h, w]`` points that are looked at.

    Returns:
        For each pixel of the view, flattened: the grey difference of the fallen point of smallest
        disparity, that of the point of largest disparity, and how far apart in pixels the two were
        moved. NaN where nothing falls.
    """
    h, w = difference.shape
    pixel = np.rint(np.arange(w) - displacement).astype(np.int64)
    falls = (pixel >= 0) & (pixel < w) & counts
    pixel = (np.arange(h)[:, None] * w + pixel)[falls]
    order = np.argsort(disparity[falls], kind="stable")
    found = []
    for ranked in (order[::-1], order):  # of several assignments to a pixel the last one stays
        values = np.full((2, h * w), np.nan, np.float32)
        values[0, pixel[ranked]] = difference[falls][ranked]
        values[1, pixel[ranked]] = displacement[falls][ranked]
        found.append(values)
    (small, small_moved), (large, large_moved) = found
    return small, large, np.abs(large_moved - small_moved)
