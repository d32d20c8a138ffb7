"""Picture of the viewer's page for the documentation, made in headless Chromium.

After ``occjax demo -o FOLDER``, ``python -m experiments.viewer_picture FOLDER -o docs/viewer.jpg``
turns the cloud, picks a pixel next to a depth edge, and writes what a user then sees. It needs the
extra ``test``, for playwright, and Chromium. Cost: a minute. Expected: the picture of the page on
the viewer.
"""

from __future__ import annotations

import io
import shutil
from pathlib import Path
from typing import Annotated

from PIL import Image
from playwright.sync_api import Browser, Playwright, sync_playwright
from tyro.conf import Positional, arg

from experiments.command_line import main
from occjax.viewer import Viewer, read_scene

SIZE = (1440, 900)
"""Width and height of the window, in pixels."""

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
SOFTWARE_WEBGL = (
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
)
LOADED = "document.querySelector('canvas[data-engine]')?.style.opacity === '1'"


def start_chromium(playwright: Playwright) -> Browser:
    """Start Chromium of the system, or the one that playwright installed, with WebGL."""
    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    return playwright.chromium.launch(executable_path=path, args=SOFTWARE_WEBGL)


def viewer_picture(
    results: Positional[Annotated[Path, arg(help="Folder that occjax demo wrote.")]],
    output: Annotated[Path, arg(aliases=["-o"], help="Picture to write.")],
    pixel: Annotated[tuple[int, int], arg(help="Row and column of the picked pixel.")] = (74, 191),
    turn: Annotated[tuple[int, int], arg(help="Pixels by which the mouse is dragged.")] = (80, 30),
) -> None:
    """Write the picture."""
    with Viewer(read_scene([results])) as viewer, sync_playwright() as playwright:
        browser = start_chromium(playwright)
        page = browser.new_page(viewport={"width": SIZE[0], "height": SIZE[1]})
        page.set_default_timeout(300_000)
        page.goto(viewer.url)
        page.wait_for_function(LOADED)
        viewer.select_pixel(*pixel)
        viewer.wait_until_idle()
        page.wait_for_timeout(5_000)
        for notification in page.locator(".mantine-Notification-closeButton").all():
            notification.click()  # about WebGL in software
        box = page.locator("canvas[data-engine]").bounding_box()
        assert box is not None
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + turn[0], y + turn[1], steps=10)
        page.mouse.up()
        page.wait_for_timeout(5_000)
        picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
        browser.close()
    picture.save(output, quality=85)


if __name__ == "__main__":
    main(viewer_picture, __doc__)
