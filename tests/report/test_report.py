"""The page of a report: what it contains, its size, and what a browser makes of it."""

import base64
import io
import json
import re
import shutil
import zlib
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image

from occjax.errors import InputError
from occjax.estimators import Estimate
from occjax.lightfield import Calibration, LightField
from occjax.report.page import write_report
from occjax.report.scenes import ReportConfig, packed, read_scenes, report_scene
from occjax.results.summary import read_summary

pytest.importorskip("jinja2")

SIZE = (48, 64)
CAMERA = Calibration(50.0, 36.0, baseline_mm=40.0, focus_distance_m=2.5)
RANDOM = np.random.default_rng(0)
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "chrome"))), None)


class Page(HTMLParser):
    """Elements of a page, the addresses in it, and its scripts by their type."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.addresses, self.cells, self.data = [], [], [], []
        self.inside = (None, None)
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        attributes = dict(attributes)
        self.elements.append((tag, attributes))
        self.addresses += [attributes[name] for name in ("src", "href") if name in attributes]
        self.inside = (tag, attributes.get("type"))
        if tag == "tr":
            self.cells.append([])

    def handle_data(self, text):
        if self.inside == ("script", "application/json"):
            self.data.append(json.loads(text))
        if self.inside[0] in ("td", "th", "a", "button") and text.strip():
            self.cells[-1].append(text.strip())

    def handle_endtag(self, tag):
        self.inside = (None, None)


def estimate(size=SIZE, *, occlusion=(3, 5), **changes):
    truth = np.linspace(-1.0, 2.0, size[0] * size[1], dtype=np.float32).reshape(size)
    disparity = truth + RANDOM.normal(0.0, 0.1, size).astype(np.float32)
    disparity[0, 0] = np.nan
    views = RANDOM.integers(1, 256, (*occlusion, *size, 3), np.uint8)
    fields = {"views": views, "name": "a <b> & c", "calibration": CAMERA, "ground_truth": truth}
    return Estimate(
        disparity=disparity,
        confidence=RANDOM.uniform(0.01, 1.0, size).astype(np.float32),
        standard_deviation=disparity,
        disparity_range=(-1.5, 2.5),
        model="photometric",
        occlusion=RANDOM.random((*occlusion, *size), np.float32),
        seconds={"load": 1.5, "run": 2.0},
        notes=("</script><b>bold</b>",),
        light_field=LightField(**{**fields, **changes}),
    )


def unpacked(packed_map, shape):
    """Decode a map by its description."""
    planes = np.frombuffer(zlib.decompress(base64.b64decode(packed_map["codes"])), np.uint8)
    upper, lower = planes.reshape(2, *shape).astype(int)
    folded = 256 * upper + lower
    change = np.where(folded % 2 == 1, -(folded + 1) // 2, folded // 2)
    codes = np.empty(shape, int)
    for y, x in np.ndindex(shape):
        before = codes[y, x - 1] if x else codes[y - 1, 0] if y else 0
        codes[y, x] = (before + change[y, x]) % 65536
    values = packed_map["low"] + packed_map["scale"] * codes
    return np.where(codes == 65535, np.nan, values)


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Two folders of results in one folder: with everything, and with little."""
    folder = tmp_path_factory.mktemp("results")
    full = estimate()
    full.save(folder / "full", what="all")
    little = estimate(name="little", calibration=None, ground_truth=None)
    little.save(folder / "little", what="maps")
    return folder, full


@pytest.fixture(scope="module")
def page(results, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "report.html"
    write_report(path, read_scenes((results[0],)))
    return path


@pytest.mark.parametrize("values", [[[0.25]], [[np.nan, np.nan]], [[1.0, np.nan], [-3.5, 2.0]]])
def test_a_packed_map_has_its_values(values):
    values = np.array(values)
    np.testing.assert_allclose(unpacked(packed(values), values.shape), values, atol=1e-4)


def test_the_page_has_the_values_and_needs_nothing_else(page, results):
    text = page.read_text("utf-8")
    parsed = Page(text)
    assert all(address.startswith(("data:image/", "#scene-")) for address in parsed.addresses)
    assert not re.search(r"https?://|url\(|@import", text)
    policy = next(a["content"] for _, a in parsed.elements if "http-equiv" in a)
    assert policy.startswith("default-src 'none';")
    assert "</script><b>" not in text
    assert "&lt;/script&gt;&lt;b&gt;" in text

    full, expected = parsed.data[0], results[1]
    for name, values in (
        ("disparity", expected.disparity),
        ("error", expected.disparity - expected.light_field.ground_truth),
    ):
        np.testing.assert_allclose(unpacked(full["maps"][name], SIZE), values, atol=1e-4)
    actual = unpacked(full["maps"]["confidence"], SIZE)
    np.testing.assert_allclose(actual, expected.confidence, atol=6e-3)  # two digits
    assert full["occlusion"]["grid"] == [3, 5]
    # 1 / depth = slope * disparity + constant, by the formula of the HCI benchmark.
    depth = CAMERA.depth(np.array([0.5]), SIZE)[0]
    camera = full["camera"]
    assert 1 / (0.5 * camera["slope"] + camera["constant"]) == pytest.approx(depth)
    little = parsed.data[1]
    assert set(little["maps"]) == {"disparity", "confidence"}
    assert little["camera"] is little["occlusion"] is None


def test_a_view_that_is_not_the_centre_view_is_named(tmp_path):
    # View (0, 1) of 3x5 views is the centre of 5x9 places, of which columns 3 to 7 have a view.
    corner = estimate(occlusion=(5, 9), view=(0, 1), ground_truth=None)
    corner.occlusion[...] = 1.0
    corner.occlusion[2, 4] = 0.0
    corner.save(tmp_path / "results", what="all")
    write_report(tmp_path / "report.html", read_scenes((tmp_path / "results",)))
    text = (tmp_path / "report.html").read_text("utf-8")
    assert "3x5 views" in text
    assert "<figcaption>View (0, 1)</figcaption>" in text
    # The sliders start at the view furthest from (0, 1).
    inputs = [attributes for _, attributes in Page(text).elements if "data-axis" in attributes]
    assert [attributes["value"] for attributes in inputs] == ["2", "4"]
    occlusion = Page(text).data[0]["occlusion"]
    assert (occlusion["grid"], occlusion["centre"]) == ([3, 5], [0, 1])
    encoded = occlusion["image"].removeprefix("data:image/jpeg;base64,")
    mosaic = np.asarray(Image.open(io.BytesIO(base64.b64decode(encoded))))
    height, width = SIZE
    tiles = mosaic.reshape(3, height, 5, width).mean((1, 3))
    np.testing.assert_allclose(tiles, 255 * (np.arange(15).reshape(3, 5) != 1), atol=3)


def test_a_table_lists_several_scenes_with_their_scores(page, results):
    headings, full, little = Page(page.read_text("utf-8")).cells[:3]
    summary = read_summary(results[0] / "full/summary.json")
    row = dict(zip(headings, full, strict=True))
    assert row["scene"] == "a <b> & c"
    assert row["views"] == "3x5"
    assert row["seconds"] == "3.5"
    assert float(row["MSE x100"]) == pytest.approx(summary["metrics"]["mse_x100"], rel=1e-3)
    assert float(row["BadPix 0.07 [%]"]) == pytest.approx(
        summary["metrics"]["badpix"]["0.07"], rel=1e-3
    )
    assert little[:4] == ["little", "photometric", "3x5", "48x64"]


def test_a_large_scene_is_decimated_to_less_than_5_mb(tmp_path):
    """Noise cannot be compressed: no scene of this size takes more."""
    size, grid = (1200, 1300), (1, 3)
    big = estimate(size, occlusion=grid)
    scene = report_scene(big, {"scene": "big", "metrics": {"mse_x100": 1.0}})
    assert scene.data["step"] == 3
    assert (scene.data["height"], scene.data["width"]) == (400, 434)
    smaller = estimate((570, 570), occlusion=(9, 9))
    text = json.dumps(report_scene(smaller, {"scene": "s", "metrics": {"mse_x100": 1.0}}).data)
    assert smaller.disparity.size > 0.98 * ReportConfig().max_pixels
    assert 1e6 < len(text) < 5e6


def test_what_cannot_be_reported_is_refused(tmp_path, results):
    with pytest.raises(InputError, match="no scene"):
        write_report(tmp_path / "report.html", [])
    with pytest.raises(InputError, match=r"pass a folder that occjax estimate wrote$"):
        read_scenes((tmp_path,))
    older = shutil.copytree(results[0] / "little", tmp_path / "older")
    (older / "centre.png").unlink()
    with pytest.raises(InputError, match="older: has no centre view"):
        read_scenes((older,))


@pytest.mark.slow
def test_a_browser_shows_the_values_under_the_pointer_and_draws_the_points(page, results):
    playwright = pytest.importorskip("playwright.sync_api")
    if CHROMIUM is None:
        pytest.skip("there is no Chromium")
    software = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    errors = []
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=software)
        shown = browser.new_page(viewport={"width": 420, "height": 3000})  # as wide as a phone
        shown.on("pageerror", lambda error: errors.append(error))
        shown.goto(page.as_uri())
        section = shown.locator("#scene-1[data-ready]")
        section.wait_for(timeout=60_000)
        assert shown.evaluate("document.documentElement.scrollWidth") <= 420

        box = section.locator("[data-map=disparity]").bounding_box()
        x, y = box["x"] + box["width"] * 20.5 / 64, box["y"] + box["height"] * 10.5 / 48
        shown.mouse.move(x, y)
        text = section.locator(".values").inner_text()

        canvas = section.locator("[data-points]")
        least = section.locator("[data-confidence]")
        pictures = []
        for confidence in ("0", "1"):
            least.fill(confidence)
            shown.wait_for_timeout(300)
            pictures.append(np.asarray(Image.open(io.BytesIO(canvas.screenshot())).convert("RGB")))

        section.locator("[data-axis='1']").fill("4")
        view = section.locator(".view").inner_text()
        orders = {}
        for heading in ("scene", "MSE x100"):
            for direction in ("ascending", "descending"):
                shown.locator("#index th", has_text=heading).click()
                orders[heading, direction] = shown.locator("#index tbody a").all_inner_texts()
        browser.close()
    assert not errors
    disparity, truth = results[1].disparity[10, 20], results[1].light_field.ground_truth[10, 20]
    confidence, depth = results[1].confidence[10, 20], CAMERA.depth(np.array([disparity]), SIZE)[0]
    assert text == (
        f"row 10, column 20 \u00b7 disparity {disparity:.3f} \u00b7 confidence {confidence:.2f} "
        f"\u00b7 error {disparity - truth:.3f} \u00b7 depth {depth:.3f} m"
    )
    assert view == "(0, 4)"
    assert orders["scene", "ascending"] == ["a <b> & c", "little"]
    assert orders["scene", "descending"] == ["little", "a <b> & c"]
    # "little" has no ground truth, so no error by which it could be the best or the worst.
    assert orders["MSE x100", "ascending"] == ["a <b> & c", "little"]
    assert orders["MSE x100", "descending"] == ["a <b> & c", "little"]
    drawn = [np.mean(picture != 32) for picture in pictures]
    assert drawn[0] > 0.3
    assert drawn[1] < 0.02
