"""Occlusion order of surfaces: the only evidence for the sign of disparity.

Reversing both axes of the grid of views negates disparity. The views are equally consistent in both
cases. Occlusion tells them apart: where two points of the centre view meet in one pixel of another
view, that view shows the nearer point, and with the correct sign this is the point of larger
disparity.

A point counts only if the opposite view, the mirror image of the other view about the centre, shows
it. What a nearer surface hides on one side is almost always visible on the other. A background
point to which the blur of the disparity map has given the disparity of the nearer surface is
visible in neither view, and would vote for the wrong sign.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Array, Bool, Float

from occjax.kernels.bilinear import inside_view, warp_plane
from occjax.layout.consistency import Arm, Cross, motion
from occjax.layout.orientation import Orientation
from occjax.programs import kept


def nearer_in_front(cross: Cross, disparity: np.ndarray, orientation: Orientation) -> float | None:
    """Return the fraction of decided collisions in which the point of larger disparity is visible.

    Args:
        cross: Views around the centre, relative to their brightness.
        disparity: ``[h, w]`` disparity of the centre view under ``orientation``, in pixels of the
            light field per view step.
        orientation: The view order that is assumed.

    Returns:
        Fraction in [0, 1], each collision weighted by the squared contrast of its two points: near
        1 if the sign is correct, near 0 if it is reversed; None if too few points collide, or if
        the majority depends on one arm: a single misplaced view must not reverse the sign.
    """
    config = cross.config
    # For each arm: weight of the collisions with the nearer point in front, weight of those with
    # the farther point in front, number of both.
    votes = []
    projected = [_project_to_outermost(cross, arm, disparity, orientation) for arm in cross.arms]
    for arm, (displacement, difference, _) in zip(cross.arms, projected, strict=True):
        counted = np.ones(disparity.shape, bool)
        for other, (_, in_opposite, inside) in zip(cross.arms, projected, strict=True):
            if other.on_row == arm.on_row and other is not arm:
                counted = inside & (in_opposite < config.min_hidden_difference)
        maps = (difference, disparity, displacement, counted)
        axis, _ = motion(arm.on_row, orientation)
        small, large, distance = _collisions(*(m if axis == 1 else m.T for m in maps))
        collides = distance >= config.min_collision_px
        visible, hidden = config.max_visible_difference, config.min_hidden_difference
        large_visible = collides & (large < visible) & (small > hidden)
        small_visible = collides & (small < visible) & (large > hidden)
        # The view shows the visible point, so the difference of the hidden point is their contrast.
        near = float(np.sum(small[large_visible] ** 2))
        far = float(np.sum(large[small_visible] ** 2))
        votes.append((near, far, int(large_visible.sum() + small_visible.sum())))
    near, far, decided = np.sum(votes, axis=0)
    if decided < config.min_collisions:
        return None
    without_one = np.array([near, far]) - np.array(votes)[:, :2]
    has_votes = without_one.sum(1) != 0.0
    is_reversed = (without_one[:, 0] > without_one[:, 1]) != (near > far)
    if np.any(has_votes & is_reversed):
        return None
    return float(near / (near + far))


def _project_to_outermost(
    cross: Cross, arm: Arm, disparity: np.ndarray, orientation: Orientation
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Project the centre view into the outermost view of an arm and compare the two.

    Returns:
        ``[h, w]`` displacement of each point towards index 0, in pixels; ``[h, w]`` grey difference
        between the point and what the view shows there; ``[h, w]`` whether that is in the image.
    """
    axis, sign = motion(arm.on_row, orientation)
    offset = np.zeros(2, np.float32)
    offset[axis] = sign * arm.offsets[-1] / cross.scale
    shown, inside = map(np.asarray, _warp(arm.images[-1], disparity, offset))
    return disparity * offset[axis], np.abs(shown - cross.centre), inside


@kept
def _warp(
    image: Float[Array, "h w"], disparity: Float[Array, "h w"], offset: Float[Array, "2"]
) -> tuple[Float[Array, "h w"], Bool[Array, "h w"]]:
    """Return what a view shows at each point of the centre view, and whether it is in the image."""
    return warp_plane(image, disparity, offset), inside_view(disparity, offset)


def _collisions(
    difference: np.ndarray, disparity: np.ndarray, displacement: np.ndarray, counted: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find points of the centre view that meet in one pixel of a view that moves along x.

    Args:
        difference: ``[h, w]`` grey difference between each point and what the view shows there.
        disparity: ``[h, w]`` disparity, by which points are ranked.
        displacement: ``[h, w]`` displacement of each point towards lower x, in pixels.
        counted: ``[h, w]`` whether a point counts.

    Returns:
        ``[h * w]`` for each pixel of the view: the grey difference of the point of smallest
        disparity there, that of the point of largest disparity, and the difference of their
        displacements in pixels. NaN where no point falls.
    """
    h, w = difference.shape
    pixel = np.rint(np.arange(w) - displacement).astype(np.int64)
    inside = (pixel >= 0) & (pixel < w) & counted
    pixel = (np.arange(h)[:, None] * w + pixel)[inside]
    order = np.argsort(disparity[inside], kind="stable")
    found = []
    for ranked in (order[::-1], order):  # The last of several assignments to a pixel remains.
        values = np.full((2, h * w), np.nan, np.float32)
        values[0, pixel[ranked]] = difference[inside][ranked]
        values[1, pixel[ranked]] = displacement[inside][ranked]
        found.append(values)
    (small, small_moved), (large, large_moved) = found
    return small, large, np.abs(large_moved - small_moved)
