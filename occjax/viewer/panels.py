"""The panels of the page: each has controls, and a function that shows the current selection."""

from __future__ import annotations

import html
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import viser
from matplotlib.colors import to_hex
from viser import uplot

from occjax.evaluation.metrics import BAD_PIXEL_THRESHOLD, compare
from occjax.lightfield import centre_index, project
from occjax.results.conversion import flying_pixels
from occjax.viewer import cloud
from occjax.viewer.config import ViewerConfig
from occjax.viewer.drawing import (
    CENTRE,
    MARK,
    css,
    enlarged,
    epipolar_picture,
    patch_picture,
    with_cross,
)
from occjax.viewer.pixel import (
    Line,
    angular_patch,
    cost_curve,
    epipolar_image,
    patch_occlusion,
)
from occjax.viewer.refocusing import LiveRefocuser
from occjax.viewer.scene import ViewedResult, ViewedScene
from occjax.viewer.worker import LatestWorker
from occjax.viz.pictures import view_picture


@dataclass
class Selected:
    """What is selected: the index of a result, and a pixel ``(y, x)`` of the centre view."""

    result: int
    pixel: tuple[int, int]


@dataclass(frozen=True, eq=False)
class Page:
    """What all panels share.

    Attributes:
        server: Server of the page.
        scene: What is shown.
        config: Settings.
        worker: Thread that computes pictures.
        selected: Selected result and pixel.
    """

    server: viser.ViserServer
    scene: ViewedScene
    config: ViewerConfig
    worker: LatestWorker
    selected: Selected

    @property
    def result(self) -> ViewedResult:
        """The selected result."""
        return self.scene.results[self.selected.result]

    @property
    def disparity(self) -> float:
        """Disparity of the picked pixel in the selected result, in pixels per view step."""
        return float(self.result.disparity[self.selected.pixel])

    def when_changed(self, handles: tuple[Any, ...], kind: str, task: Callable[[], None]) -> None:
        """Run a task on the worker whenever a control changes."""
        for handle in handles:
            handle.on_update(lambda _: self.worker.submit(kind, task))


class Panel:
    """A part of the page; by default it depends on neither the result nor the pixel."""

    def show_result(self) -> None:
        """Show the selected result."""
        self.show_pixel()

    def show_pixel(self) -> None:
        """Show the selected pixel."""


class CloudPanel(Panel):
    """The point cloud of each result, and its controls."""

    def __init__(self, page: Page) -> None:
        self.page, scene = page, page.scene
        step = cloud.sampling_step(scene.image_size, page.config.max_points)
        self._grid = np.s_[::step, ::step]
        self._points = [
            cloud.cloud_points(
                result.disparity,
                scene.calibration,
                disparity_range=cloud.disparity_ends(scene),
                relief_depth=page.config.relief_depth,
            )
            for result in scene.results
        ]
        self._flying = [flying_pixels(result.disparity)[self._grid] for result in scene.results]
        self._point_size = step * cloud.pixel_size(self._points[0], scene.calibration)
        self.camera = cloud.first_camera(self._points[0], scene.calibration)
        self._add_controls()
        self._clouds = [self._add_cloud(index) for index in range(len(scene.results))]
        radius = 0.01 * max(scene.image_size) * self._point_size / step
        self._marker = page.server.scene.add_icosphere("/picked", radius=radius, color=MARK)
        self._set_first_camera()
        # A browser may already be connected, so callbacks come when there is something to change.
        page.when_changed((self.mode,), "colours", self.show_colours)
        page.when_changed((self.threshold, self.hide_flying), "points", self.show_points)
        page.when_changed((self.size,), "size", self._show_size)
        self.look.on_click(lambda event: self._look(event.client))

    def _add_controls(self) -> None:
        gui, scene = self.page.server.gui, self.page.scene
        available = cloud.modes(scene)
        with gui.add_folder("Point cloud"):
            self.mode = gui.add_dropdown(
                "Colours", available, initial_value=available[0], hint="What the colours show."
            )
            self._legend = gui.add_html(legend_html(cloud.legend(scene, 0, available[0])))
            self.size = gui.add_slider(
                "Point size",
                0.5,
                4.0,
                0.1,
                1.3,
                hint="1: neighbouring points of a surface that faces the camera touch each other.",
            )
            self.threshold = gui.add_slider(
                "Min. confidence",
                0.0,
                1.0,
                0.01,
                0.0,
                hint="Hide points whose disparity is less certain than this.",
                visible="confidence" in available,
            )
            self.hide_flying = gui.add_checkbox(
                "Hide flying",
                True,
                hint="Hide flying pixels: points between two surfaces, which belong to neither.",
            )
            self.look = gui.add_button(
                "Look from the camera",
                icon=viser.Icon.CAMERA,
                hint=f"Turn back to where the {scene.view_name} was taken.",
            )

    def visible(self, index: int) -> np.ndarray:
        """Return ``[h, w]`` which of the sampled points of a result are shown."""
        result = self.page.scene.results[index]
        shown = np.isfinite(self._points[index][self._grid]).all(axis=-1)
        if result.confidence is not None:
            shown &= ~(result.confidence[self._grid] < self.threshold.value)
        return shown & ~self._flying[index] if self.hide_flying.value else shown

    def pick(self, origin: np.ndarray, direction: np.ndarray) -> tuple[int, int] | None:
        """Return the pixel of the point under the cursor, if there is one."""
        index = self.page.selected.result
        shown = np.argwhere(self.visible(index))
        points = self._points[index][self._grid][tuple(shown.T)]
        picked = cloud.pick_point(points, origin, direction)
        if picked is None:
            return None
        step = self._grid[0].step
        return int(shown[picked, 0]) * step, int(shown[picked, 1]) * step

    def show_result(self) -> None:
        """Show the cloud of the selected result and hide the others."""
        with self.page.server.atomic():
            for index, handle in enumerate(self._clouds):
                handle.visible = index == self.page.selected.result
        if self.mode.value == "difference":
            self.show_colours()
        self.show_pixel()

    def show_pixel(self) -> None:
        """Move the marker to the picked point."""
        point = self._points[self.page.selected.result][self.page.selected.pixel]
        self._marker.visible = bool(np.isfinite(point).all())
        if self._marker.visible:
            self._marker.position = point

    def show_colours(self) -> None:
        """Colour the clouds, and explain the colours."""
        self._legend.content = legend_html(
            cloud.legend(self.page.scene, self.page.selected.result, self.mode.value)
        )
        for index, handle in enumerate(self._clouds):
            handle.colors = self._colours(index)[self.visible(index)]

    def show_points(self) -> None:
        """Show the points that are certain enough."""
        for index, handle in enumerate(self._clouds):
            shown = self.visible(index)
            with self.page.server.atomic():
                handle.points = self._points[index][self._grid][shown]
                handle.colors = self._colours(index)[shown]

    def _colours(self, index: int) -> np.ndarray:
        return cloud.picture(self.page.scene, index, self.mode.value)[self._grid]

    def _add_cloud(self, index: int) -> viser.PointCloudHandle:
        shown = self.visible(index)
        return self.page.server.scene.add_point_cloud(
            f"/cloud/{index}",
            points=self._points[index][self._grid][shown],
            colors=self._colours(index)[shown],
            point_size=self.size.value * self._point_size,
            point_shape="square",
            point_shading="flat",
            precision="float32",
            visible=index == self.page.selected.result,
        )

    def _show_size(self) -> None:
        for handle in self._clouds:
            handle.point_size = self.size.value * self._point_size

    def _set_first_camera(self) -> None:
        server, camera = self.page.server, self.camera
        distance = float(np.linalg.norm(camera.look_at - camera.position))
        server.scene.set_up_direction("+y")
        initial = server.initial_camera
        initial.position, initial.look_at = camera.position, camera.look_at
        initial.fov = camera.field_of_view
        initial.near, initial.far = 1e-3 * distance, 1e3 * distance

    def _look(self, client: viser.ClientHandle | None) -> None:
        for one in [client] if client else self.page.server.get_clients().values():
            with one.atomic():
                one.camera.up_direction = (0.0, 1.0, 0.0)
                one.camera.position = self.camera.position
                one.camera.look_at = self.camera.look_at


class ViewPanel(Panel):
    """One view of the light field at a time."""

    def __init__(self, page: Page) -> None:
        assert page.scene.light_field is not None
        self.page, self._light_field = page, page.scene.light_field
        v0, u0 = centre_index(self._light_field.grid)
        usable = self._light_field.usable
        if usable is None:
            usable = np.ones(self._light_field.grid, bool)
        # Around another view than the centre view, many places of the grid are empty.
        v, u = (np.flatnonzero(usable.any(axis)) for axis in (1, 0))
        self._first = int(v[0]), int(u[0])
        rows, columns = int(np.ptp(v)) + 1, int(np.ptp(u)) + 1
        gui = page.server.gui
        gui.add_markdown(
            "A light field is a grid of photos, taken side by side. Move the sliders: near "
            "things move more than far ones, and that is what disparity measures."
        )
        self.v = gui.add_slider(
            "View row v",
            0,
            max(rows - 1, 1),
            1,
            v0 - self._first[0],
            hint="0 is the highest camera.",
            disabled=rows == 1,
        )
        self.u = gui.add_slider(
            "View column u",
            0,
            max(columns - 1, 1),
            1,
            u0 - self._first[1],
            hint="0 is the leftmost camera.",
            disabled=columns == 1,
        )
        self._picture = gui.add_image(
            self._drawn(), format="jpeg", jpeg_quality=page.config.jpeg_quality
        )
        page.when_changed((self.v, self.u), "view", self.show_pixel)

    def show_pixel(self) -> None:
        """Show the selected view, with a cross where the result says that it sees the point."""
        self._picture.image = self._drawn()

    def _drawn(self) -> np.ndarray:
        rows, columns = self._light_field.grid
        v, u = int(self.v.value) + self._first[0], int(self.u.value) + self._first[1]
        # The slider of a single row or column is disabled, but its range also includes 1.
        index = min(v, rows - 1), min(u, columns - 1)
        image = view_picture(self._light_field.views[index])
        y, x = self.page.selected.pixel
        if not np.isfinite(self.page.disparity):
            return enlarged(image)
        offset = self._light_field.offsets[index]
        row, column = project(y, x, self.page.disparity, offset)
        return with_cross(image, float(row), float(column))


class RefocusPanel(Panel):
    """The image of a camera with a large aperture, focused at a chosen disparity."""

    def __init__(self, page: Page) -> None:
        assert page.scene.light_field is not None
        self.page = page
        self._refocuser = LiveRefocuser(page.scene.light_field, page.config)
        low, high = page.scene.disparity_range
        largest = math.ceil(2.0 * self._refocuser.largest_aperture) / 2.0
        gui = page.server.gui
        gui.add_markdown(
            "Focus after the photo was taken: all views are shifted by the disparity of a plane "
            "and averaged. What lies in that plane is sharp."
        )
        self.disparity = gui.add_slider(
            "Focus",
            low,
            high,
            max(round((high - low) / 200, 3), 0.001),
            round(page.scene.typical_disparity, 3),
            hint="Disparity of the plane in focus, in pixels per view step. Larger is nearer.",
        )
        self.aperture = gui.add_slider(
            "Aperture",
            0.0,
            max(largest, 1.0),
            0.5,
            largest,
            hint="Diameter of the aperture, in view steps: the views inside are averaged. 0 is the "
            "centre view alone, in which everything is sharp.",
        )
        self.at_pixel = gui.add_button(
            "Focus on the picked pixel", hint="Set the focus to the disparity of the picked pixel."
        )
        self._picture = gui.add_image(
            enlarged(view_picture(page.scene.light_field.centre)),
            format="jpeg",
            jpeg_quality=page.config.jpeg_quality,
        )
        self.frames = 0
        page.when_changed((self.disparity, self.aperture), "refocus", self.show)
        self.at_pixel.on_click(lambda _: self._focus_on_pixel())
        page.worker.submit("refocus", self.show)  # compiles before the user moves a slider

    def show(self) -> None:
        """Show a preview at once, and the image of all views when the sliders rest."""
        self._show(preview=True)
        if not self.page.worker.superseded("refocus", self.page.config.rest_seconds):
            self._show(preview=False)

    def _show(self, *, preview: bool) -> None:
        image = self._refocuser.image(
            float(self.disparity.value), float(self.aperture.value), preview=preview
        )
        self._picture.image = enlarged(image)
        self.frames += 1

    def _focus_on_pixel(self) -> None:
        value = self.page.disparity
        if np.isfinite(value):
            low, high = self.page.scene.disparity_range
            set_value(self.disparity, round(float(np.clip(value, low, high)), 3))


class PixelPanel(Panel):
    """The picked pixel: numbers, and what the views see there."""

    def __init__(self, page: Page, select: Callable[[int, int], None]) -> None:
        self.page, gui = page, page.server.gui
        height, width = page.scene.image_size
        y, x = page.selected.pixel
        gui.add_markdown(
            f"Click a point of the cloud, or type its place in the {page.scene.view_name}."
        )
        self.y = gui.add_number("Row y", y, min=0, max=height - 1, step=1, hint="0 is the top.")
        self.x = gui.add_number("Column x", x, min=0, max=width - 1, step=1, hint="0 is the left.")
        self.numbers = gui.add_markdown("")
        self._light_field = page.scene.light_field
        if self._light_field is not None:
            self._add_pictures()
        for handle in (self.y, self.x):
            handle.on_update(lambda event: self._typed(event.client, select))
        page.worker.submit("pixel", self.show_pixel)

    def _typed(self, client: viser.ClientHandle | None, select: Callable[[int, int], None]) -> None:
        """Select the typed pixel. A click in the cloud also sets the numbers, without a client."""
        if client is not None:
            select(int(self.y.value), int(self.x.value))

    def _add_pictures(self) -> None:
        page, gui, config = self.page, self.page.server.gui, self.page.config
        black = np.zeros((8, 8, 3), np.uint8)
        with gui.add_folder("Epipolar plane image"):
            self.line = gui.add_dropdown(
                "Line",
                ("row", "column"),
                hint="The same pixel row in all views of the centre row, or the same pixel column "
                "in all views of the centre column.",
            )
            self.epi = gui.add_image(black, format="png")
            gui.add_markdown(
                "One line of pixels of each view, stacked; dark lines are brightened. A point "
                "draws a slanted line; the pink line has the slope of its disparity, and should "
                "follow the texture."
            )
        with gui.add_folder("Angular patch"):
            self._patch = gui.add_image(black, format="png")
            gui.add_markdown(
                "The colour of the point in each view, one square per view; dark ones are "
                "brightened. Crossed views see something else "
                f"(occlusion map above {config.occluded_above:g}): an occluder, or "
                "the disparity is wrong. The view of the map has a yellow frame."
            )
        with gui.add_folder("Matching cost"):
            self._cost = gui.add_uplot(
                (np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(2)),
                (
                    uplot.Series(label="disparity"),
                    uplot.Series(label="all views", stroke="#4c9be8", width=2),
                    uplot.Series(label="best part of the views", stroke=css(CENTRE), width=2),
                    uplot.Series(label="estimate", stroke=css(MARK), width=2),
                ),
                scales={"x": uplot.Scale(time=False)},
                height=190,
            )
            gui.add_markdown(
                f"How much the views differ from the {page.scene.view_name} if the point had this "
                "disparity. The pink line is the estimate; it should be at a low point. Where "
                "something hides the point from some views, only the yellow curve has a low point "
                "there."
            )
        page.when_changed((self.line,), "epi", self._show_epi)

    def show_pixel(self) -> None:
        """Show numbers and pictures of the picked pixel in the selected result."""
        y, x = self.page.selected.pixel
        self.numbers.content = pixel_text(self.page.scene, self.page.selected)
        if self._light_field is None:
            return
        self._show_epi()
        disparity = self.page.disparity
        known = disparity if np.isfinite(disparity) else 0.0
        patch = angular_patch(self._light_field, y, x, known)
        stored = self.page.result.occlusion
        maps = patch_occlusion(patch) if stored is None else stored[:, :, y, x]
        self._patch.image = patch_picture(patch, maps > self.page.config.occluded_above)
        self._show_cost(disparity)

    def _show_epi(self) -> None:
        assert self._light_field is not None
        y, x = self.page.selected.pixel
        line: Line = "row" if self.line.value == "row" else "column"
        epi = epipolar_image(
            self._light_field, y, x, line, radius_px=self.page.config.epi_radius_px
        )
        picked = x if line == "row" else y
        self.epi.image = epipolar_picture(epi, picked, self.page.disparity)

    def _show_cost(self, disparity: float) -> None:
        assert self._light_field is not None
        config = self.page.config
        candidates = np.linspace(*self.page.scene.disparity_range, config.cost_candidates)
        y, x = self.page.selected.pixel
        curve = cost_curve(self._light_field, y, x, candidates, radius_px=config.cost_radius_px)
        spike = np.zeros(candidates.size)
        if np.isfinite(disparity):
            spike[np.argmin(np.abs(candidates - disparity))] = curve.all_views.max()
        self._cost.data = (candidates, curve.all_views, curve.best_part, spike)


class ComparisonPanel(Panel):
    """Choice among several results: switch, blink, difference, scores."""

    def __init__(self, page: Page, select: Callable[[int], None]) -> None:
        self.page, gui = page, page.server.gui
        names = tuple(result.name for result in page.scene.results)
        with gui.add_folder("Results"):
            self.result = gui.add_dropdown(
                "Result", names, initial_value=names[0], hint="The result that is shown."
            )
            self.blink = gui.add_checkbox(
                "Blink", False, hint="Show the results in turn: differences flicker."
            )
            self.scores = gui.add_markdown(comparison_table(page.scene))
        self.result.on_update(lambda _: select(names.index(self.result.value)))

    def show_result(self) -> None:
        """Name the selected result."""
        name = self.page.scene.results[self.page.selected.result].name
        set_value(self.result, name)


def set_value(control: Any, value: object) -> None:
    """Set the value of a control; its callbacks run if that changes it."""
    if control.value != value:
        control.value = value


def legend_html(legend: cloud.Legend | None) -> str:
    """Return a colour bar with its label as HTML; nothing for None."""
    if legend is None:
        return ""
    stops = ", ".join(to_hex(legend.colours(at)) for at in np.linspace(0.0, 1.0, 33))
    low, high = legend.low, legend.high
    ticks = "".join(f"<span>{value:.3g}</span>" for value in (low, 0.5 * (low + high), high))
    return (
        '<div style="margin:0.2em 0.9em 0.6em;font-size:0.8em">'
        f'<div style="height:0.9em;border-radius:3px;background:linear-gradient(to right,{stops})">'
        f'</div><div style="display:flex;justify-content:space-between">{ticks}</div>'
        f'<div style="text-align:center;opacity:0.75">{html.escape(legend.label)}</div></div>'
    )


def pixel_text(scene: ViewedScene, selected: Selected) -> str:
    """Return the numbers of the picked pixel as a Markdown table."""
    result, at = scene.results[selected.result], selected.pixel
    disparity = result.disparity[at]
    rows = [("disparity", f"{disparity:.3f} pixels per view step")]
    if scene.calibration is not None:
        depth = scene.calibration.depth(result.disparity, scene.image_size)[at]
        rows.append(("depth", f"{depth:.4g} m"))
    if result.confidence is not None:
        rows.append(("confidence", f"{result.confidence[at]:.2f} (1 is certain)"))
    if scene.ground_truth is not None:
        truth = scene.ground_truth[at]
        rows += [("ground truth", f"{truth:.3f}"), ("error", f"{disparity - truth:+.3f}")]
    for index, other in enumerate(scene.results):
        if index != selected.result:
            rows.append((f"disparity, {other.name}", f"{other.disparity[at]:.3f}"))
    body = "\n".join(f"| {name} | {value} |" for name, value in rows)
    return f"| | |\n|---|---|\n{body}"


def comparison_table(scene: ViewedScene) -> str:
    """Return the scores as a Markdown table; without ground truth, the mean difference in words."""
    if scene.ground_truth is None:
        difference = scene.results[0].disparity - scene.results[1].disparity
        mean = float(np.nanmean(np.abs(difference)))
        return (
            f"The first two differ by {mean:.3f} pixels per view step on average. Colours: "
            "*difference* shows where. There is no ground truth, so no scores."
        )
    rows = []
    for result in scene.results:
        metrics = compare(result.disparity, scene.ground_truth)
        if metrics is not None:
            bad = metrics.badpix[BAD_PIXEL_THRESHOLD]
            rows.append(f"| {result.name} | {bad:.2f} % | {metrics.mse_x100:.3f} |")
    head = f"| result | BadPix {BAD_PIXEL_THRESHOLD:g} | MSE x100 |\n|---|---|---|\n"
    return head + "\n".join(rows) + "\n\nLower is better. BadPix: pixels with a larger error."
