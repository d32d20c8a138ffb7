"""The page in a real browser: headless Chromium with WebGL in software."""

import io

import numpy as np
import pytest
from PIL import Image

from experiments.viewer_picture import LOADED, start_chromium
from occjax.viewer import Viewer


@pytest.fixture(scope="module")
def browser():
    """Chromium of the system, or the one that playwright installed."""
    from playwright.sync_api import Error, sync_playwright

    with sync_playwright() as playwright:
        try:
            started = start_chromium(playwright)
        except Error as error:
            pytest.skip(f"there is no Chromium that starts: {str(error).splitlines()[0]}")
        yield started
        started.close()


@pytest.fixture
def viewer(two_results, capsys):
    with Viewer(two_results) as viewer:
        yield viewer
    assert capsys.readouterr() == ("", "")  # a task that fails prints its traceback


@pytest.mark.slow
def test_a_person_looks_at_the_cloud_moves_sliders_and_picks_a_point(browser, viewer):
    page = browser.new_page(viewport={"width": 1100, "height": 600})
    page.set_default_timeout(120_000)
    requests = []
    page.on("request", lambda request: requests.append(request.url))
    page.goto(viewer.url)
    page.wait_for_function(LOADED)
    box = page.locator("canvas[data-engine]").bounding_box()

    def canvas():
        """Colours of the scene, without the notification about WebGL at its top."""
        shot = page.screenshot(clip={**box, "y": box["height"] * 0.25, "height": box["height"] / 2})
        return np.asarray(Image.open(io.BytesIO(shot)).convert("RGB")).astype(int)

    def set_slider(name, key):
        slider = page.get_by_role("slider")
        row = page.locator("div").filter(has_text=name).filter(has=slider).last
        row.get_by_role("slider").press(key)

    # The cloud, in the colours of the views, covers most of the middle of the canvas.
    shown = canvas()
    background = shown[0, 0]
    assert (np.abs(shown - background).max(-1) > 30).mean() > 0.4
    assert shown.reshape(-1, 3).std(0).min() > 10

    # The other result is nearer on the right: its disparity is yellow there, and blue on the left.
    viewer.comparison.result.value = "wrong"
    viewer.cloud.mode.value = "disparity"
    viewer.select_pixel(3, 4)  # on the left
    viewer.wait_until_idle()
    page.wait_for_timeout(2000)
    left, right = np.array_split(canvas(), 2, axis=1)
    assert (left[..., 2] - left[..., 0] > 50).mean() > 0.4
    assert (right[..., 0] - right[..., 2] > 100).mean() > 0.4

    # A click picks the point under the cursor.
    page.get_by_text("0.500 pixels per view step").wait_for()
    page.mouse.click(box["x"] + 0.6 * box["width"], box["y"] + 0.5 * box["height"])
    page.get_by_text("1.500 pixels per view step").wait_for()
    viewer.wait_until_idle()
    y, x = viewer.pixel.y.value, viewer.pixel.x.value
    assert 8 <= y <= 16
    assert 17 <= x <= 26

    page.get_by_role("tab", name="Views").click()
    set_slider("View column u", "ArrowRight")
    page.get_by_role("tab", name="Refocus").click()
    frames = viewer.refocus.frames
    set_slider("Aperture", "Home")
    page.wait_for_timeout(500)
    viewer.wait_until_idle()
    assert viewer.view.u.value == 2
    assert viewer.refocus.aperture.value == 0.0
    assert viewer.refocus.frames > frames

    # Nothing is fetched from another computer.
    assert all(url.startswith((viewer.url, "data:", "blob:")) for url in requests)
