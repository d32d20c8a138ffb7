"""The light field: a grid of views with the camera parameters, and the conventions of the library.

Conventions of the whole library (every other module refers to these):

* ``views[v, u, y, x, c]``: ``v`` is the angular row, top to bottom; ``u`` the angular column, left
  to right; ``y`` and ``x`` the pixel row and column; ``c`` the colour channel.
* The centre view, whose disparity is estimated, is ``v0 = V // 2``, ``u0 = U // 2``
  (:func:`centre_index`).
* Disparity ``d`` is in pixels per view step with the sign of the HCI 4D benchmark: what the centre
  view sees at ``(y, x)``, view ``(v, u)`` sees at ``(y - d * (v - v0), x - d * (u - u0))``. Rows
  move with ``v``, columns with ``u``; nearer points have larger disparity.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from occjax.errors import InputError, check_whole_pair

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GREY_WEIGHTS = (0.299, 0.587, 0.114)
"""Weights of red, green and blue in the grey image (ITU-R BT.601)."""

MIN_VIEW_SIZE_PX = 3
"""Smallest height and width, in pixels, of a view that is read from files."""

MIN_CERTAIN_SIZE_PX = 8
"""Height and width, in pixels, from which two axes can be told to be those of images."""


def centre_index(grid: tuple[int, ...]) -> tuple[int, int]:
    """Return the index ``(v0, u0)`` of the centre view of a grid.

    Args:
        grid: ``(V, U)``, number of view rows and view columns.

    Returns:
        ``(V // 2, U // 2)``: the middle of an odd grid, the view below and right of the middle of
        an even one.

    Example:
        >>> centre_index((9, 4))
        (4, 2)
    """
    v, u = grid
    return v // 2, u // 2


def view_name(view: Sequence[int] | None) -> str:
    """Return the name of a view: ``"centre view"`` or ``"view (v, u)"``.

    Example:
        >>> view_name(None), view_name([0, 2])
        ('centre view', 'view (0, 2)')
    """
    return "centre view" if view is None else f"view ({view[0]}, {view[1]})"


def view_offsets(v: int, u: int, *, column_spacing: float = 1.0) -> np.ndarray:
    """Return the offset of each view of a regular grid from the centre view.

    Swapping the last axis gives the transposed warp of the published OccCasNet code.

    Args:
        v: Number of view rows.
        u: Number of view columns.
        column_spacing: Distance of neighbouring columns, in steps of the rows.

    Returns:
        ``[v, u, 2]`` float32 offsets ``(row, column)``, in view steps; in steps of the rows if the
        columns have another spacing.

    Raises:
        InputError: If the numbers are not whole or less than 1.

    Example:
        >>> view_offsets(3, 3)[0, 2].tolist()
        [-1.0, 1.0]
    """
    check_whole_pair("(v, u)", (v, u))
    indices = np.stack(np.meshgrid(np.arange(v), np.arange(u), indexing="ij"), axis=-1)
    offsets = (indices - np.array(centre_index((v, u)))).astype(np.float32)
    return offsets * np.array([1.0, column_spacing], np.float32)


def grid_around(grid: np.ndarray, view: tuple[int, int], *, missing: Any = 0) -> np.ndarray:
    """Return an array with one entry per view, with another view in the centre.

    Args:
        grid: ``[V, U, ...]``, one entry for each view.
        view: ``(v, u)``, index of the view that becomes the centre.
        missing: Entry of the places outside of the grid, or ``[2 V - 1, 2 U - 1, ...]`` entries of
            all places.

    Returns:
        ``[2 V - 1, 2 U - 1, ...]``, a grid of one size for all views.

    Example:
        >>> grid_around(np.arange(4).reshape(2, 2), (0, 1), missing=-1).tolist()
        [[-1, -1, -1], [0, 1, -1], [2, 3, -1]]
    """
    rows, columns = grid.shape[:2]
    # Memory of zeros that are never written is not used.
    result = np.zeros((2 * rows - 1, 2 * columns - 1, *grid.shape[2:]), grid.dtype)
    if np.any(missing):
        result[...] = missing
    top, left = rows - 1 - view[0], columns - 1 - view[1]
    result[top : top + rows, left : left + columns] = grid
    return result


def whole_grid(grid: Sequence[int], view: Sequence[int] | None) -> tuple[int, int]:
    """Return the grid of all views, also of a light field around another view.

    Args:
        grid: ``(V, U)`` of the light field; around another view that of :func:`grid_around`.
        view: View around which it is; None for the centre view.

    Example:
        >>> whole_grid((17, 17), (0, 0)), whole_grid((9, 9), None)
        ((9, 9), (9, 9))
    """
    rows, columns = grid
    return (rows, columns) if view is None else ((rows + 1) // 2, (columns + 1) // 2)


def positions_around(positions: np.ndarray, view: tuple[int, int]) -> np.ndarray:
    """Return camera positions relative to another view, in the grid of :func:`grid_around`.

    Args:
        positions: ``[V, U, 2]`` positions ``(row, column)`` of any origin.
        view: ``(v, u)``, index of the view that becomes the centre.

    Returns:
        ``[2 V - 1, 2 U - 1, 2]`` float32; places outside of the grid continue it.

    Example:
        >>> positions_around(2 * view_offsets(1, 3), (0, 2))[0, :, 1].tolist()
        [-4.0, -2.0, 0.0, 2.0, 4.0]
    """
    rows, columns = positions.shape[:2]
    relative = (positions - positions[view]).astype(np.float32)
    centred = relative - relative[centre_index((rows, columns))]
    nominal = view_offsets(rows, columns).reshape(-1, 2)
    step = np.linalg.lstsq(nominal, centred.reshape(-1, 2))[0]
    regular = view_offsets(2 * rows - 1, 2 * columns - 1) @ step
    return grid_around(relative, view, missing=regular)


def project(y: Any, x: Any, disparity: Any, offset: Any) -> tuple[Any, Any]:
    """Project points of the centre view into another view.

    ``(y - d * offset[0], x - d * offset[1])``: the sign convention of this library.

    Args:
        y: Rows in the centre view, in pixels; NumPy or JAX array of any shape.
        x: Columns in the centre view, in pixels.
        disparity: Disparity of each point, in pixels per view step.
        offset: ``[2]`` offset ``(row, column)`` of the other view, in view steps.

    Returns:
        Rows and columns in the other view, in pixels.

    Example:
        >>> project(10.0, 20.0, 0.5, (-4.0, 2.0))
        (12.0, 19.0)
    """
    return y - disparity * offset[0], x - disparity * offset[1]


@dataclass(frozen=True)
class Calibration:
    """Camera parameters of the HCI format, which relate disparity to metric depth.

    Attributes:
        focal_length_mm: Focal length of each camera, in millimetres.
        sensor_size_mm: Longer side of the sensor, in millimetres.
        baseline_mm: Distance between neighbouring cameras, in millimetres.
        focus_distance_m: Distance of the plane whose disparity is zero, in metres.
    """

    focal_length_mm: float
    sensor_size_mm: float
    baseline_mm: float
    focus_distance_m: float

    def focal_length_pixels(self, image_size: tuple[int, int]) -> float:
        """Return the focal length in pixels: ``focal_length / sensor * max(H, W)``."""
        return self.focal_length_mm / self.sensor_size_mm * max(image_size)

    def inverse_depth(self, disparity: Any, image_size: tuple[int, int]) -> Any:
        """Return ``1 / depth`` in 1/m, which is linear in disparity: ``d / (f * b) + 1 / focus``.

        ``f`` is the focal length in pixels and ``b`` the baseline. This is the inverse of the
        formula of the HCI 4D benchmark, ``depth = beta * f_d / (d * f_d * sensor + beta)`` with
        ``beta = baseline * focal_length * max(H, W)``.

        Args:
            disparity: NumPy or JAX array ``[...]``, pixels per view step.
            image_size: ``(H, W)`` of the views, in pixels.

        Returns:
            ``[...]``; not positive at and beyond the disparity of infinitely distant points.
        """
        return disparity / self._parallax(image_size) + 1.0 / self.focus_distance_m

    def disparity(self, depth: Any, image_size: tuple[int, int]) -> Any:
        """Return the disparity of points at a depth: ``f * b * (1 / depth - 1 / focus)``.

        Args:
            depth: NumPy or JAX array ``[...]``, metres along the optical axis; positive, may be
                infinite.
            image_size: ``(H, W)`` of the views, in pixels.

        Returns:
            ``[...]`` pixels per view step; nearer points have larger ones.

        Example:
            >>> camera = Calibration(100.0, 35.0, baseline_mm=50.0, focus_distance_m=7.0)
            >>> camera.disparity(np.array([3.5, 7.0, np.inf]), (1, 3)).round(3).tolist()
            [0.061, 0.0, -0.061]
        """
        return (1.0 / depth - 1.0 / self.focus_distance_m) * self._parallax(image_size)

    def depth(self, disparity: np.ndarray, image_size: tuple[int, int]) -> np.ndarray:
        """Return the metric depth of a disparity map, by the formula of the HCI 4D benchmark.

        The inverse of :meth:`disparity`; :func:`occjax.ops.depth_from_disparity` is the same in
        JAX.

        Args:
            disparity: ``[...]``, pixels per view step.
            image_size: ``(H, W)`` of the views, in pixels.

        Returns:
            ``[...]`` depth along the optical axis, in metres; infinite where the disparity is at or
            below that of infinitely distant points.
        """
        inverse = self.inverse_depth(np.asarray(disparity, np.float64), image_size)
        distant = inverse <= 0.0
        return np.where(distant, np.inf, 1.0 / np.where(distant, 1.0, inverse))

    def _parallax(self, image_size: tuple[int, int]) -> float:
        """Return the disparity between one metre and infinity, in pixels per view step."""
        return self.focal_length_pixels(image_size) * self.baseline_mm / 1000.0


@dataclass(frozen=True, eq=False, repr=False)
class LightField:
    """A rectangular grid of views of one scene, with the metadata that its files contain.

    Attributes:
        views: ``[V, U, H, W, C]``, uint8, uint16 or floating point in [0, 1]; C is 1 or 3. Grey
            views may be passed without their channel axis.
        name: Short name of the scene, used for output folders.
        calibration: Camera parameters, if the source has them.
        disparity_range: ``(minimum, maximum)`` in pixels per view step, if the source has it.
        ground_truth: ``[H, W]`` float32 disparity of the centre view, if present.
        positions: ``[V, U, 2]`` float32 camera positions ``(row, column)`` of an irregular (gantry)
            grid, in steps of the mean spacing, relative to the centre view; None for a regular
            grid.
        usable: ``[V, U]`` bool, False for views that are missing or too dark to be compared with
            the centre view; None if all can be used. The centre view must be usable.
        source: Where the light field was read from.
        view_order_report: Measurement of the view order and the disparity range, if it was made.
            Set it to None when you replace the views.
        view: ``(v, u)``, index of the centre view in the light field that :meth:`around` has taken
            the views from; None if this is the whole light field.
    """

    views: np.ndarray
    name: str = "light field"
    calibration: Calibration | None = None
    disparity_range: tuple[float, float] | None = None
    ground_truth: np.ndarray | None = None
    positions: np.ndarray | None = None
    usable: np.ndarray | None = None
    source: Path | None = None
    view_order_report: Any = None
    view: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        """Add the channel axis of grey views; check shapes, types and values."""
        views = np.asarray(self.views)
        if views.ndim == 4 and views.shape[-1] not in (1, 3):
            views = views[..., np.newaxis]
        object.__setattr__(self, "views", views)
        if self.views.ndim != 5 or self.views.shape[-1] not in (1, 3):
            raise InputError(
                f"{self.name}: views must be [V, U, H, W] or [V, U, H, W, C] with C of 1 or 3, "
                f"not {list(self.views.shape)}; reshape or transpose them, for example a list of "
                "views by views.reshape(V, U, *views.shape[1:])"
            )
        large = min(self.grid) >= MIN_CERTAIN_SIZE_PX
        swapped = large and all(np.greater(self.grid, self.image_size))
        if swapped and self.view is None:
            raise InputError(
                f"{self.name}: views have the shape {list(self.views.shape)}, a grid of more rows "
                "and columns than the views have pixels; transpose them to [V, U, H, W] or "
                "[V, U, H, W, C]"
            )
        self._check_values()
        if self.positions is not None and self.positions.shape != (*self.grid, 2):
            raise InputError(
                f"{self.name}: positions are {list(self.positions.shape)}, not [V, U, 2]"
            )
        if self.usable is not None:
            self._check_usable(self.usable)
        low, high = self.disparity_range or (0.0, 1.0)
        if not -math.inf < low < high < math.inf:
            raise InputError(
                f"{self.name}: the disparity range needs minimum < maximum, not {low} {high}"
            )
        if self.ground_truth is not None and self.ground_truth.shape != self.image_size:
            raise InputError(
                f"{self.name}: ground truth is {list(self.ground_truth.shape)} "
                f"but the views are {list(self.image_size)}"
            )

    def _check_usable(self, usable: np.ndarray) -> None:
        """Refuse a mask of another shape or type, and one without the centre view."""
        if usable.shape != self.grid or usable.dtype != np.bool_:
            raise InputError(
                f"{self.name}: usable is {usable.dtype} {list(usable.shape)}, not bool [V, U]"
            )
        row, column = centre_index(self.grid)
        if not usable[row, column]:
            raise InputError(
                f"{self.name}: the centre view (row {row}, column {column}, counted from 0) is "
                "missing or cannot be used, but disparity is that of the centre view; leave out "
                "an outer row or column of views, so that another view is the centre"
            )

    def _check_values(self) -> None:
        """Refuse views that :func:`to_unit_float` cannot convert."""
        views, found = self.views, str(list(self.views.shape))
        if views.size > 0 and views.dtype in (np.uint8, np.uint16):
            return
        if views.size > 0 and np.issubdtype(views.dtype, np.floating):
            low, high = views.min(), views.max()
            # Resampling may leave values slightly outside [0, 1]. NaN fails both comparisons.
            if low >= -0.01 and high <= 1.01:
                return
            found = f"from {low:.4g} to {high:.4g}"
        raise InputError(
            f"{self.name}: views must be an array of uint8, of uint16 or of finite floating "
            f"point in [0, 1], not {views.dtype} {found}; scale or convert them, for example "
            "by numpy.asarray(views, numpy.uint8) if they are from 0 to 255"
        )

    @property
    def grid(self) -> tuple[int, int]:
        """``(V, U)``: number of view rows and view columns."""
        return self.views.shape[0], self.views.shape[1]

    @property
    def image_size(self) -> tuple[int, int]:
        """``(H, W)`` of each view, in pixels."""
        return self.views.shape[2], self.views.shape[3]

    @property
    def centre(self) -> np.ndarray:
        """``[H, W, C]`` centre view, as stored."""
        return self.views[centre_index(self.grid)]

    @property
    def offsets(self) -> np.ndarray:
        """``[V, U, 2]`` float32 offset ``(row, column)`` of each view, in view steps."""
        return view_offsets(*self.grid) if self.positions is None else self.positions

    def floating(self) -> np.ndarray:
        """Return the views as ``[V, U, H, W, C]`` float32 in [0, 1]."""
        return to_unit_float(self.views)

    def grey(self) -> np.ndarray:
        """Return ``[V, U, H, W]`` float32 grey views in [0, 1]: 0.299 R + 0.587 G + 0.114 B."""
        grey = np.empty(self.views.shape[:-1], np.float32)
        # One view at a time: a float copy of all colour views would be large.
        for v, u in np.ndindex(*self.grid):
            grey[v, u] = to_grey(self.views[v, u])
        return grey

    def central(self, rows: int, columns: int) -> LightField:
        """Return the ``rows`` x ``columns`` views around the centre view, which stays the centre.

        Raises:
            InputError: If the grid is smaller than that.
        """
        v, u = self.grid
        if rows > v or columns > u:
            raise InputError(f"{self.name}: has {v}x{u} views, {rows}x{columns} are needed")
        top, left = np.subtract(centre_index(self.grid), centre_index((rows, columns)))
        return self.rearranged(lambda grid: grid[top : top + rows, left : left + columns])

    def rearranged(self, arrange: Callable[[np.ndarray], np.ndarray]) -> LightField:
        """Return the views, with their positions and the mask, in another arrangement.

        The values of the positions do not change. The view order report is dropped.

        Args:
            arrange: Function that swaps, flips, crops or permutes the first two axes of an array
                ``[V, U, ...]``, which has one entry per view.

        Example:
            >>> LightField(np.zeros((3, 5, 8, 8))).rearranged(lambda grid: grid[:, 1:4]).grid
            (3, 3)
        """
        positions, usable = (
            None if grid is None else arrange(grid) for grid in (self.positions, self.usable)
        )
        return dataclasses.replace(
            self,
            views=arrange(self.views),
            positions=positions,
            usable=usable,
            view_order_report=None,
        )

    def around(self, view: tuple[int, int]) -> LightField:
        """Return the views around another view, which becomes the centre view.

        Everything that is computed from the result belongs to that view: its disparity map, with
        offsets, brightness and displacements of the other views relative to it. The disparity of a
        point is the same in all views.

        The new grid has ``2 V - 1`` rows and ``2 U - 1`` columns, so that it holds all views around
        any of them. Places outside of this light field are not usable. The ground truth belongs to
        the old centre view and is dropped.

        Args:
            view: ``(v, u)``, row and column of the view, counted from 0.

        Returns:
            The light field; this one if the view is its centre view.

        Raises:
            InputError: If there is no such view, or it cannot be used.

        Example:
            >>> corner = LightField(np.zeros((3, 3, 8, 8), np.uint8)).around((0, 2))
            >>> corner.grid, corner.usable[2].tolist()
            ((5, 5), [True, True, True, False, False])
        """
        check_whole_pair("view", view, minimum=0)
        rows, columns = self.grid
        v, u = view
        if not (0 <= v < rows and 0 <= u < columns):
            raise InputError(
                f"{self.name}: there is no view ({v}, {u}); rows are 0 to {rows - 1}, columns 0 to "
                f"{columns - 1}"
            )
        if (v, u) == centre_index(self.grid):
            return self
        usable = np.ones(self.grid, bool) if self.usable is None else self.usable
        report = self.view_order_report
        if not usable[v, u] or (report is not None and not report.brightness.usable[v, u]):
            raise InputError(
                f"{self.name}: the view ({v}, {u}) is missing or too dark; choose another view"
            )
        positions = self.positions
        return dataclasses.replace(
            self,
            views=grid_around(self.views, (v, u)),
            ground_truth=None,
            positions=None if positions is None else positions_around(positions, (v, u)),
            usable=grid_around(usable, (v, u)),
            view_order_report=None if report is None else report.around((v, u)),
            view=(v, u),
        )

    def plot(self, *, axes: Axes | None = None) -> Axes:
        """Draw the centre view with Matplotlib.

        Args:
            axes: Axes to draw into; by default those of a new figure.

        Returns:
            The axes.

        Example:
            >>> LightField(np.zeros((3, 3, 8, 8), np.uint8), name="wall").plot().get_title()
            'wall'
        """
        from occjax.viz.plots import plot_light_field

        return plot_light_field(self, axes)

    def __repr__(self) -> str:
        """Describe the light field in two lines."""
        from occjax.viz.descriptions import describe_light_field

        return str(describe_light_field(self))

    def _repr_html_(self) -> str:
        """Return the centre view and a table, which notebooks show."""
        from occjax.viz.descriptions import describe_light_field
        from occjax.viz.pictures import view_picture

        return describe_light_field(self).html(view_picture(self.centre))


def to_unit_float(images: np.ndarray) -> np.ndarray:
    """Return images as float32 in [0, 1]: integers are divided by the maximum of their type."""
    if np.issubdtype(images.dtype, np.integer):
        return images.astype(np.float32) / np.float32(np.iinfo(images.dtype).max)
    return images.astype(np.float32, copy=False)


def to_grey(images: np.ndarray) -> np.ndarray:
    """Return ``[...]`` float32 grey images in [0, 1] from images ``[..., C]``; see GREY_WEIGHTS."""
    if images.shape[-1] == 1:
        return to_unit_float(images[..., 0])
    return to_unit_float(images) @ np.asarray(GREY_WEIGHTS, np.float32)
