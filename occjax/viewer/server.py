"""The server of the page: it builds the panels and passes on what the user selects."""

from __future__ import annotations

import contextlib
import io
import socket
import threading

import numpy as np
import viser

from occjax.errors import InputError
from occjax.lightfield import whole_grid
from occjax.viewer.config import LOOPBACK, ViewerConfig
from occjax.viewer.panels import (
    CloudPanel,
    ComparisonPanel,
    Page,
    Panel,
    PixelPanel,
    RefocusPanel,
    Selected,
    ViewPanel,
    set_value,
)
from occjax.viewer.scene import ViewedScene
from occjax.viewer.worker import LatestWorker


class Viewer:
    """A page in the browser that shows one scene, until it is closed.

    Attributes:
        url: Address of the page.
        port: Port of the server.
    """

    def __init__(
        self,
        scene: ViewedScene,
        *,
        host: str = LOOPBACK,
        port: int | None = None,
        config: ViewerConfig | None = None,
    ) -> None:
        """Start the server; nothing is opened in a browser.

        Args:
            scene: What is shown.
            host: Address to listen at.
            port: Port to listen at; None for a free one.
            config: Settings.

        Raises:
            InputError: If the port is taken, or the address is not one of this computer.
        """
        self._closed = threading.Event()
        self._server = _start(host, port)
        self._worker = LatestWorker()
        self.port = self._server.get_port()
        self.url = f"http://{'localhost' if host == '0.0.0.0' else host}:{self.port}"
        height, width = scene.image_size
        self._selected = Selected(0, (height // 2, width // 2))
        self._page = Page(
            self._server, scene, config or ViewerConfig(), self._worker, self._selected
        )
        self._blinker: threading.Thread | None = None
        try:
            self._build()
        except BaseException:
            self.close()
            raise
        if len(scene.results) > 1:
            self._blinker = threading.Thread(target=self._blink, name="occjax blink", daemon=True)
            self._blinker.start()

    def _build(self) -> None:
        """Add all panels that the scene has data for."""
        scene, gui = self._page.scene, self._server.gui
        gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
        gui.set_panel_label("occjax")
        gui.main_panel.dock_right()
        gui.add_markdown(_description(scene))
        self.panels: list[Panel] = []
        if len(scene.results) > 1:
            self.comparison = ComparisonPanel(self._page, self.select_result)
            self.panels.append(self.comparison)
        self.cloud = CloudPanel(self._page)
        self.panels.append(self.cloud)
        side = gui.add_panel()
        side.dock_left()
        side.set_width(400)
        with side.add_tab("Picked pixel", icon=viser.Icon.TARGET):
            self.pixel = PixelPanel(self._page, self.select_pixel)
            self.panels.append(self.pixel)
        if scene.light_field is not None:
            with side.add_tab("Views", icon=viser.Icon.GRID_DOTS):
                self.view = ViewPanel(self._page)
                self.panels.append(self.view)
            with side.add_tab("Refocus", icon=viser.Icon.FOCUS_2):
                self.refocus = RefocusPanel(self._page)
                self.panels.append(self.refocus)
        self._server.scene.on_click()(self._clicked)
        self.select_pixel(*self._selected.pixel)

    def select_pixel(self, y: int, x: int) -> None:
        """Select a pixel of the centre view; all panels follow.

        Args:
            y: Row; rows outside the image count as the nearest one.
            x: Column.
        """
        height, width = self._page.scene.image_size
        self._selected.pixel = min(max(y, 0), height - 1), min(max(x, 0), width - 1)
        self._worker.submit("pixel", self._show_pixel)

    def select_result(self, index: int) -> None:
        """Select the result that is shown."""
        self._selected.result = index
        self._worker.submit("result", self._show_result)

    def wait_until_idle(self) -> None:
        """Wait until the page shows what was selected."""
        self._worker.wait_until_idle()

    def wait(self) -> None:
        """Wait until the viewer is closed, for instance by Ctrl-C."""
        while not self._closed.wait(0.5):
            pass

    def close(self) -> None:
        """Close the page: its threads end and its port is free again."""
        self._closed.set()
        if self._blinker is not None:
            self._blinker.join()
        self._worker.close()
        with _no_output():
            self._server.stop()

    def __enter__(self) -> Viewer:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _show_pixel(self) -> None:
        y, x = self._selected.pixel
        set_value(self.pixel.y, y)
        set_value(self.pixel.x, x)
        for panel in self.panels:
            panel.show_pixel()

    def _show_result(self) -> None:
        for panel in self.panels:
            panel.show_result()

    def _clicked(self, event: viser.SceneClickEvent) -> None:
        picked = self.cloud.pick(np.array(event.ray_origin), np.array(event.ray_direction))
        if picked is not None:
            self.select_pixel(*picked)

    def _blink(self) -> None:
        while not self._closed.wait(self._page.config.blink_seconds):
            if self.comparison.blink.value:
                self.select_result((self._selected.result + 1) % len(self._page.scene.results))


def _no_output() -> contextlib.AbstractContextManager[object]:
    """Drop what is printed meanwhile: the server prints its start and its end."""
    return contextlib.redirect_stdout(io.StringIO())


def _start(host: str, port: int | None) -> viser.ViserServer:
    """Start a server at exactly this port, quietly."""
    if port is not None:
        # The server would silently take the next free port.
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((host, port))
            except (OSError, OverflowError) as error:
                raise InputError(
                    f"port {port} of {host} cannot be used ({error}); pass another --port, or "
                    "none for a free one"
                ) from error
    with _no_output():
        return viser.ViserServer(host=host, port=port or 0, verbose=False)


def _description(scene: ViewedScene) -> str:
    """Return what is shown, in Markdown."""
    height, width = scene.image_size
    views = "without its views"
    if scene.light_field is not None:
        light_field = scene.light_field
        views = "{}x{} views".format(*whole_grid(light_field.grid, light_field.view))
        if light_field.view is not None:
            views = f"{scene.view_name} of {views}"
    depth = "points in metres" if scene.calibration else "relief: depth without true scale"
    return (
        f"**{scene.name}**, {views} of {height}x{width} pixels, {depth}.\n\n"
        "*Drag to turn, right-drag to move, scroll to zoom. Click a point to inspect it.*"
    )
