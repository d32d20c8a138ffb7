"""Pictures of a light field with another focus, another aperture or from another view."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from itertools import groupby
from typing import Literal

import numpy as np

from occjax.layout import ViewBrightness, registered, view_brightness
from occjax.lightfield import LightField
from occjax.programs import kept
from occjax.viz.pictures import view_picture

CameraPath = Literal["circle", "row", "column"]
"""Path of the camera through the grid of views."""


class Refocuser:
    """Images of one light field, focused at any disparity.

    The light field is prepared once: shifted views are moved back, the brightness of the views is
    equalised, and missing or dark views are left out.

    Attributes:
        light_field: The prepared light field, with floating-point views.

    Example:
        >>> wall = LightField(np.full((3, 3, 8, 9), 255, np.uint8))
        >>> Refocuser(wall).image(0.5, aperture=2.0).shape
        (8, 9, 3)
    """

    def __init__(self, light_field: LightField) -> None:
        light_field, _ = registered(light_field)
        brightness = view_brightness(light_field)
        views = light_field.floating()
        if views is light_field.views:
            views = views.copy()
        for v, u in np.ndindex(*light_field.grid):
            if brightness.usable[v, u]:
                views[v, u] = np.clip(brightness.equalised(views[v, u], v, u), 0.0, 1.0)
        usable = brightness.usable
        equal = ViewBrightness(np.ones(light_field.grid, np.float32), usable, dark=0)
        report = light_field.view_order_report
        if report is not None:
            report = dataclasses.replace(report, brightness=equal)
        self.light_field = dataclasses.replace(
            light_field, views=views, usable=usable, view_order_report=report
        )

    def image(self, disparity: float, *, aperture: float | None = None) -> np.ndarray:
        """Return the image focused at a disparity.

        Args:
            disparity: Disparity in focus, pixels per view step.
            aperture: Diameter of the aperture, in view steps; None for all views.

        Returns:
            ``[H, W, 3]`` uint8 RGB.
        """
        return self._picture(np.float32(disparity), aperture)

    def all_in_focus(self, disparity: np.ndarray, *, aperture: float | None = None) -> np.ndarray:
        """Return an image that is sharp everywhere; see :func:`occjax.ops.all_in_focus`.

        Args:
            disparity: ``[H, W]`` disparity of the centre view, pixels per view step.
            aperture: Diameter of the aperture, in view steps; None for all views.

        Returns:
            ``[H, W, 3]`` uint8 RGB.
        """
        return self._picture(np.asarray(disparity, np.float32), aperture)

    def sweep(self, path: CameraPath = "circle") -> Iterator[np.ndarray]:
        """Yield the usable views along a closed path, which show the parallax.

        Args:
            path: ``"circle"`` around the centre view, as wide as the grid, or ``"row"`` or
                ``"column"`` through the centre view, there and back.

        Yields:
            ``[H, W, 3]`` uint8 RGB.
        """
        for index in sweep_path(self.light_field, path):
            yield view_picture(self.light_field.views[index])

    def _picture(self, disparity: np.ndarray | np.float32, aperture: float | None) -> np.ndarray:
        field = self.light_field
        diameter = np.float32(np.inf if aperture is None else aperture)
        usable = np.asarray(field.usable, np.float32)
        offsets = np.asarray(field.offsets, np.float32)
        image = _refocused(field.views, disparity, offsets, usable, diameter)
        return view_picture(np.asarray(image))


def sweep_path(light_field: LightField, path: CameraPath) -> list[tuple[int, int]]:
    """Return the usable views nearest to a closed path through the grid.

    Args:
        light_field: The light field.
        path: See :meth:`Refocuser.sweep`.

    Returns:
        Indices ``(v, u)``; no two in succession are equal, nor are the first and the last.

    Example:
        >>> sweep_path(LightField(np.zeros((1, 3, 8, 8), np.uint8)), "row")
        [(0, 2), (0, 1), (0, 0), (0, 1)]
    """
    usable = np.ones(light_field.grid, bool) if light_field.usable is None else light_field.usable
    indices = np.argwhere(usable)
    offsets = light_field.offsets[usable]
    angles = np.linspace(0.0, 2.0 * np.pi, 8 * max(light_field.grid), endpoint=False)
    low, high = offsets.min(0), offsets.max(0)
    down = np.sin(angles) if path == "circle" else np.cos(angles)
    points = (low + high) / 2 + (high - low) / 2 * np.stack([down, np.cos(angles)], -1)
    if path != "circle":
        points[:, 0 if path == "row" else 1] = 0.0  # through the centre view
    nearest = np.square(points[:, None] - offsets).sum(-1).argmin(1)
    visited = [place for place, _ in groupby(map(int, nearest))]
    if len(visited) > 1 and visited[0] == visited[-1]:
        visited.pop()
    return [(int(v), int(u)) for v, u in indices[visited]]


@kept
def _refocused(views, disparity, offsets, usable, diameter):
    from occjax.ops import all_in_focus, aperture_weights, refocus

    weights = usable * aperture_weights(offsets, diameter)
    function = all_in_focus if disparity.ndim else refocus
    return function(views, disparity, offsets=offsets, weights=weights)
