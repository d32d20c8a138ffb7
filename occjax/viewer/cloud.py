"""The point cloud: positions, colours, visible points, camera, and the point under the cursor.

Axes: x to the right, y up, z to the viewer.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np
from matplotlib.colors import Colormap, Normalize

from occjax.io.maps import Map
from occjax.lightfield import Calibration
from occjax.results.conversion import point_cloud
from occjax.viewer.scene import ViewedScene
from occjax.viz.colour import confidence_colours, disparity_colours, disparity_norm
from occjax.viz.pictures import coloured, confidence_picture, error_picture, error_scale

Mode = Literal["image", "disparity", "confidence", "error", "difference"]
"""What the colours of the points show."""


class Camera(NamedTuple):
    """A camera that looks along -z, with y up.

    Attributes:
        position: ``[3]`` position.
        look_at: ``[3]`` point around which the user turns the cloud.
        field_of_view: Vertical angle, in radians.
    """

    position: np.ndarray
    look_at: np.ndarray
    field_of_view: float


class Legend(NamedTuple):
    """Meaning of the colours.

    Attributes:
        low: Value of the first colour.
        high: Value of the last colour.
        colours: Colours of the range.
        label: Quantity and unit.
    """

    low: float
    high: float
    colours: Colormap
    label: str


def cloud_points(
    disparity: np.ndarray,
    calibration: Calibration | None,
    *,
    disparity_range: tuple[float, float],
    relief_depth: float = 0.4,
) -> np.ndarray:
    """Return the point of each pixel: in metres if the camera is known, else a relief.

    Args:
        disparity: ``[H, W]``, pixels per view step.
        calibration: Camera parameters, if known.
        disparity_range: ``(minimum, maximum)``, whose difference is the depth of a relief.
        relief_depth: Depth of a relief, as a fraction of the longer side of the image.

    Returns:
        ``[H, W, 3]`` float32; NaN where a pixel has no point. A relief is in pixels: the centre of
        the range has z = 0.

    Example:
        >>> cloud_points(np.array([[0.0, 1.0]]), None, disparity_range=(0.0, 1.0))[0, 1].tolist()
        [0.5, 0.0, 0.4000000059604645]
    """
    if calibration is not None:
        return point_cloud(Map(disparity, "disparity"), calibration).points.astype(np.float32)
    height, width = disparity.shape
    y, x = np.mgrid[:height, :width]
    low, high = disparity_range
    scale = relief_depth * max(height, width) / (high - low)
    z = (disparity - 0.5 * (low + high)) * scale
    points = np.stack([x - 0.5 * (width - 1), 0.5 * (height - 1) - y, z], axis=-1)
    return np.where(np.isfinite(z)[..., None], points, np.nan).astype(np.float32)


def first_camera(points: np.ndarray, calibration: Calibration | None) -> Camera:
    """Return the camera from which the cloud looks like the centre view.

    Args:
        points: ``[H, W, 3]`` points of :func:`cloud_points`.
        calibration: Camera parameters, if known.

    Returns:
        The centre camera if the points are metric, else one in front of the relief. The field of
        view contains the longer side of the image.
    """
    height, width = points.shape[:2]
    side = float(max(height, width))
    if calibration is None:
        distance = 1.6 * side
        return Camera(np.array([0.0, 0.0, distance]), np.zeros(3), 2 * math.atan(0.65 / 1.6))
    depth = -points[..., 2]
    known = depth[np.isfinite(depth)]
    distance = float(np.median(known)) if known.size else 1.0
    focal_length = calibration.focal_length_pixels((height, width))
    angle = 2 * math.atan(0.65 * side / focal_length)
    return Camera(np.zeros(3), np.array([0.0, 0.0, -distance]), angle)


def pixel_size(points: np.ndarray, calibration: Calibration | None) -> float:
    """Return the distance of neighbouring points on a surface that faces the camera."""
    if calibration is None:
        return 1.0
    depth = -points[..., 2]
    known = depth[np.isfinite(depth)]
    # Points at a greater depth are farther apart; most of them should leave no gap.
    distance = float(np.percentile(known, 75)) if known.size else 1.0
    return distance / calibration.focal_length_pixels(points.shape[:2])


def modes(scene: ViewedScene) -> tuple[Mode, ...]:
    """Return what the colours can show of a scene."""
    available: dict[Mode, bool] = {
        "image": scene.light_field is not None,
        "disparity": True,
        "confidence": any(result.confidence is not None for result in scene.results),
        "error": scene.ground_truth is not None,
        "difference": len(scene.results) > 1,
    }
    return tuple(mode for mode, possible in available.items() if possible)


def compared_with(result: int) -> int:
    """Return the index of the result that is subtracted: the first, or from it the second."""
    return 0 if result else 1


def picture(scene: ViewedScene, result: int, mode: Mode) -> np.ndarray:
    """Return the colour of each pixel.

    Args:
        scene: The scene.
        result: Index of the result.
        mode: What the colours show, one of :func:`modes`.

    Returns:
        ``[H, W, 3]`` uint8 RGB; grey where there is no value.
    """
    shown = scene.results[result]
    if mode == "image":
        assert scene.centre is not None
        return scene.centre
    if mode == "confidence":
        missing = np.full(scene.image_size, np.nan)
        return confidence_picture(missing if shown.confidence is None else shown.confidence)
    if mode == "error":
        assert scene.ground_truth is not None
        return error_picture(shown.disparity, scene.ground_truth)
    if mode == "difference":
        return error_picture(shown.disparity, scene.results[compared_with(result)].disparity)
    return coloured(shown.disparity, Normalize(*disparity_ends(scene)), disparity_colours())


def legend(scene: ViewedScene, result: int, mode: Mode) -> Legend | None:
    """Return the meaning of the colours; None for the image."""
    if mode == "disparity":
        label = "disparity, pixels per view step (yellow is near)"
        return Legend(*disparity_ends(scene), disparity_colours(), label)
    if mode == "confidence":
        return Legend(0.0, 1.0, confidence_colours(), "confidence (1 is certain)")
    if mode in ("error", "difference"):
        _, colours, ticks = error_scale()
        label = "disparity minus ground truth (red is too near)"
        if mode == "difference":
            other = scene.results[compared_with(result)].name
            label = f"disparity minus {other} (red is nearer than there)"
        return Legend(ticks[0], ticks[-1], colours, label)
    return None


def disparity_ends(scene: ViewedScene) -> tuple[float, float]:
    """Return the ends of the disparity colours, the same for all results of a scene."""
    ranges = [
        disparity_norm(result.disparity, result.confidence, scene.ground_truth)
        for result in scene.results
    ]
    ends = np.array([[one.vmin, one.vmax] for one in ranges], np.float64)
    return float(ends[:, 0].min()), float(ends[:, 1].max())


def sampling_step(image_size: tuple[int, int], max_points: int) -> int:
    """Return n such that every n-th row and column gives at most so many points.

    Example:
        >>> sampling_step((512, 512), 600_000), sampling_step((2000, 3000), 600_000)
        (1, 4)
    """
    return max(1, math.ceil(math.sqrt(image_size[0] * image_size[1] / max_points)))


def pick_point(points: np.ndarray, origin: np.ndarray, direction: np.ndarray) -> int | None:
    """Return the point under the cursor: the nearest one of those close to the line of sight.

    Args:
        points: ``[N, 3]`` visible points.
        origin: ``[3]`` position of the viewer's camera.
        direction: ``[3]`` direction in which the user clicked.

    Returns:
        Index of the point; None if no point is within about a degree of the line.

    Example:
        >>> points = np.array([[0.0, 0.0, -2.0], [0.0, 0.0, -1.0], [0.5, 0.0, -1.0]])
        >>> pick_point(points, np.zeros(3), np.array([0.0, 0.0, -1.0]))
        1
    """
    unit = np.asarray(direction, np.float64) / np.linalg.norm(direction)
    relative = points - np.asarray(origin)
    along = relative @ unit
    across = np.linalg.norm(relative - along[:, None] * unit, axis=-1)
    angle = np.where(along > 0.0, across / np.maximum(along, 1e-12), np.inf)
    nearest_angle = angle.min(initial=np.inf)
    if nearest_angle > 0.02:
        return None
    close = angle <= nearest_angle + 0.003
    return int(np.argmin(np.where(close, along, np.inf)))
