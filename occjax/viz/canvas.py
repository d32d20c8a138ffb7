"""Figures whose layout is given in pixels.

Maps are shown without resampling: each value becomes a square of whole pixels, so positions are
computed in pixels instead of by matplotlib. Matplotlib's global state (pyplot, the current figure)
is not used, so figures can be drawn in any thread.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure

from occjax.io.atomic import atomic_path

MARGIN = 14
TITLE_HEIGHT = 30
BAR_WIDTH = 16
BAR_TEXT = 74
"""Lengths in pixels: outer margin, title line, width of a colour bar and of its labels."""

TEXT = "#222222"


class Canvas:
    """A white figure whose parts are placed in pixels from the top left corner.

    Attributes:
        figure: The matplotlib figure.
    """

    def __init__(self, width: int, height: int) -> None:
        self.size = (width, height)
        dpi = 100
        self.figure = Figure(figsize=(width / dpi, height / dpi), dpi=dpi, facecolor="white")
        FigureCanvasAgg(self.figure)

    def axes(
        self, left: int, top: int, width: int, height: int, *, projection: str | None = None
    ) -> Axes:
        """Add empty axes in a rectangle; ``projection`` may be ``"polar"``."""
        total_width, total_height = self.size
        return self.figure.add_axes(
            (
                left / total_width,
                1.0 - (top + height) / total_height,
                width / total_width,
                height / total_height,
            ),
            projection=projection,
        )

    def image(
        self,
        pixels: np.ndarray,
        left: int,
        top: int,
        zoom: int,
        *,
        colours: Colormap | None = None,
        norm: Normalize | None = None,
    ) -> Axes:
        """Add an image ``[H, W]`` or ``[H, W, 3]`` with each value ``zoom`` pixels wide."""
        height, width = pixels.shape[:2]
        axes = self.axes(left, top, width * zoom, height * zoom)
        axes.imshow(pixels, cmap=colours, norm=norm, interpolation="nearest", aspect="auto")
        axes.set_axis_off()
        return axes

    def title(self, text: str, left: int) -> None:
        """Add a line of text at the top, starting at ``left``."""
        x, y = left / self.size[0], 1.0 - (MARGIN + 0.4 * TITLE_HEIGHT) / self.size[1]
        self.figure.text(x, y, text, fontsize=10.5, ha="left", va="center", color=TEXT)

    def bar(
        self,
        norm: Normalize,
        colours: Colormap,
        label: str,
        rectangle: tuple[int, int, int, int],
        *,
        ticks: list[float] | None = None,
        extend: str = "neither",
    ) -> None:
        """Add a colour bar along the longer side of a rectangle (left, top, width, height).

        ``extend`` (neither, min, max or both) names the ends that are drawn as arrows: values lie
        beyond them.
        """
        axes = self.axes(*rectangle)
        upright = rectangle[3] > rectangle[2]
        bar = self.figure.colorbar(
            ScalarMappable(norm, colours),
            cax=axes,
            orientation="vertical" if upright else "horizontal",
            ticks=ticks,
            extend=extend,
        )
        bar.set_label(label, fontsize=9.5, color=TEXT)
        bar.ax.tick_params(labelsize=8.5, length=3, width=0.7, color=TEXT, labelcolor=TEXT)
        bar.outline.set_linewidth(0.0)


def map_canvas(
    values: np.ndarray,
    norm: Normalize,
    colours: Colormap,
    *,
    title: str,
    label: str,
    ticks: list[float] | None = None,
    extend: str = "neither",
    zoom: int | None = None,
) -> tuple[Canvas, Axes]:
    """Draw a map with a title above and a colour bar to its right, or below if the map is wide.

    Args:
        values: ``[H, W]`` map, or ``[H, W, 3]`` RGB image.
        norm: Range of the bar.
        colours: Colours of the bar.
        title: Line above the map.
        label: Quantity and unit of the bar.
        ticks: Values to mark on the bar.
        extend: Ends of the range with values beyond them: neither, min, max or both.
        zoom: Width of a value, in pixels; by default chosen for a convenient size.

    Returns:
        The figure, and the axes that contain the map.
    """
    height, width = values.shape[:2]
    zoom = zoom or whole_zoom((height, width))
    height, width = height * zoom, width * zoom
    left, top = MARGIN, MARGIN + TITLE_HEIGHT
    min_width, min_bar = 500, 310  # room for the title, and for the label of the bar
    if width >= 2 * height:
        length = max(width, min_bar)
        canvas = Canvas(max(length, min_width) + 2 * MARGIN, top + height + 72 + MARGIN)
        # The label of the lowest value is centred below the left end.
        bar = (left + 8, top + height + 12, length - 16, BAR_WIDTH)
    else:
        length = max(height, min_bar)
        canvas = Canvas(
            max(left + width + 12 + BAR_WIDTH + BAR_TEXT, min_width), top + length + MARGIN
        )
        bar = (left + width + 12, top, BAR_WIDTH, length)
    canvas.title(title, left)
    axes = canvas.image(values, left, top, zoom, colours=colours, norm=norm)
    canvas.bar(norm, colours, label, bar, ticks=ticks, extend=extend)
    return canvas, axes


def save(figure: Figure, path: str | Path) -> None:
    """Write a figure as PNG, atomically; equal figures give equal bytes.

    Args:
        figure: Figure of this package.
        path: File to write; an existing file is replaced.

    Raises:
        InputError: If the file cannot be written.

    Example:
        >>> import tempfile
        >>> from occjax.viz import disparity_figure
        >>> path = Path(tempfile.mkdtemp()) / "disparity.png"
        >>> save(disparity_figure(np.eye(8)), path)
        >>> path.exists()
        True
    """
    with atomic_path(path) as temporary:
        # By default the file would contain the version of matplotlib.
        FigureCanvasAgg(figure).print_png(temporary, metadata={"Software": None})


def whole_zoom(size: tuple[int, int], longest: int = 540) -> int:
    """Return the largest whole zoom at which an image fits into a length, at least 1.

    Args:
        size: ``(H, W)`` of the image.
        longest: Length of the longer side on the screen, in pixels.

    Example:
        >>> whole_zoom((128, 160)), whole_zoom((2000, 10))
        (3, 1)
    """
    return max(1, longest // max(size))
