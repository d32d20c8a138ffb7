"""The examples of the documentation run."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from occjax.lightfield import Calibration

DOCS = Path(__file__).resolve().parents[1] / "docs"


def examples(page):
    """Return the Python examples of a page, in their order."""
    return re.findall(r"```python\n(.*?)```", (DOCS / page).read_text("utf-8"), re.DOTALL)


def test_cost_volume_examples_run_in_their_order():
    variables = {}
    for example in examples("cost-volumes.md"):
        exec(example, variables)
    truth = variables["light_field"].ground_truth
    error = np.abs(np.asarray(variables["disparity"]) - truth)
    assert np.median(error) < 0.1
    assert variables["volume"].shape == (9, *truth.shape, 9)


def test_the_camera_is_found_from_two_known_distances():
    camera = Calibration(25.0, 20.0, baseline_mm=3.0, focus_distance_m=0.7)
    depths = np.array([0.5, 1.1])
    variables = {}
    for example in examples("cameras.md"):
        exec(example, variables)
    measured = variables["baseline_and_focus"](
        camera.disparity(depths, (300, 400)), depths, camera.focal_length_pixels((300, 400))
    )
    np.testing.assert_allclose(measured, (3.0, 0.7))


def test_refocusing_examples_run_in_their_order():
    variables = {}
    for example in examples("refocusing.md"):
        exec(example, variables)
    assert np.isfinite(variables["gradient"])
    inside = np.s_[8:-8, 8:-8]
    centre = variables["views"][1, 1]
    assert np.abs(variables["sharp"] - centre)[inside].mean() < 0.02


def test_every_page_is_in_the_navigation_of_the_site():
    navigation = (DOCS.parent / "mkdocs.yml").read_text("utf-8").partition("\nnav:")[2]
    listed = set(re.findall(r"[\w/-]+\.md", navigation))
    # The page of a notebook is generated.
    pages = {page.with_suffix(".md") for page in DOCS.rglob("*.ipynb")} | set(DOCS.rglob("*.md"))
    assert listed == {page.relative_to(DOCS).as_posix() for page in pages}


@pytest.mark.parametrize("path", sorted(DOCS.rglob("*.ipynb")), ids=lambda path: path.stem)
def test_notebooks_are_stored_without_results(path):
    notebook = json.loads(path.read_text("utf-8"))
    assert set(notebook["metadata"]) == {"kernelspec", "language_info"}
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert code
    for cell in code:
        assert (cell["outputs"], cell["execution_count"], cell["metadata"]) == ([], None, {})
