"""From folders of results and estimates to a scene."""

import dataclasses
import json

import numpy as np
import pytest

from occjax.errors import InputError
from occjax.estimators import Estimate
from occjax.io import write_pfm
from occjax.results.outputs import OutputOptions, write_outputs
from occjax.viewer import open_viewer, read_scene
from tests.scenes import plane


@pytest.fixture(scope="module")
def light_field():
    return plane(grid=(3, 3), size=(24, 32), disparity=0.5, name="table")


@pytest.fixture(scope="module")
def estimate(light_field):
    shape = light_field.image_size
    return Estimate(
        light_field.ground_truth,
        np.full(shape, 0.5, np.float32),
        np.zeros(shape, np.float32),
        (-1.0, 2.0),
        "photometric",
    )


def test_a_written_folder_is_shown_with_the_given_views(tmp_path, light_field, estimate):
    write_outputs(estimate, light_field, tmp_path / "table", OutputOptions(("maps",)))
    scene = read_scene([tmp_path], light_field)  # the only folder of results in it
    np.testing.assert_array_equal(scene.results[0].disparity, estimate.disparity)
    np.testing.assert_array_equal(scene.results[0].confidence, estimate.confidence)
    assert (scene.name, scene.results[0].name) == ("table", "table")
    assert scene.disparity_range == (-1.0, 2.0)
    assert scene.light_field.grid == (3, 3)


def test_the_views_are_read_from_where_the_summary_says(tmp_path, light_field, estimate):
    source = tmp_path / "views.npy"
    np.save(source, light_field.views)
    write_outputs(estimate, light_field, tmp_path / "out", OutputOptions(("maps",)))
    path = tmp_path / "out/summary.json"
    summary = json.loads(path.read_text())
    path.write_text(json.dumps({**summary, "source": str(source)}))
    assert read_scene([tmp_path / "out"]).light_field.grid == (3, 3)
    source.unlink()
    with pytest.warns(UserWarning, match="--scene SCENE"):
        assert read_scene([tmp_path / "out"]).light_field is None


def test_the_views_are_read_with_the_options_of_the_estimate(tmp_path, light_field, estimate):
    # Files that count columns first, from bottom to top, of which the centre row is used.
    stored = light_field.views[::-1].swapaxes(0, 1)
    np.save(tmp_path / "views.npy", stored)
    row = dataclasses.replace(light_field.central(1, 3), source=tmp_path / "views.npy")
    options = {"order": "uv", "flip": "v", "views": [1, 3], "save": ["maps"], "all_views": False}
    settings = {"options": options}
    outputs = OutputOptions(("maps",))
    write_outputs(estimate, row, tmp_path / "out", outputs, settings=settings)
    shown = read_scene([tmp_path / "out"]).light_field
    np.testing.assert_array_equal(shown.views, light_field.views[1:2])


def test_another_view_is_shown_with_the_views_around_it(tmp_path, light_field, estimate):
    np.save(tmp_path / "views.npy", light_field.views)
    whole = dataclasses.replace(light_field, source=tmp_path / "views.npy")
    write_outputs(estimate, whole.around((0, 2)), tmp_path / "corner", OutputOptions(("maps",)))
    for given in (None, whole):
        scene = read_scene([tmp_path / "corner"], given)
        np.testing.assert_array_equal(scene.light_field.centre, light_field.views[0, 2])
        assert scene.light_field.usable.sum() == 9
    with open_viewer(scene, open_browser=False) as viewer:
        # The sliders have the rows and columns of the light field, and start at the view.
        assert (viewer.view.v.value, viewer.view.v.max) == (0, 2)
        assert (viewer.view.u.value, viewer.view.u.max) == (2, 2)
        viewer.wait_until_idle()
    assert scene.view_name == "view (0, 2)"
    write_outputs(estimate, whole, tmp_path / "centre", OutputOptions(("maps",)))
    with pytest.raises(InputError, match=r"of the view \(0, 2\), but .* of the centre view"):
        read_scene([tmp_path / "centre", tmp_path / "corner"])


def test_what_cannot_be_shown_is_named(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        read_scene([tmp_path / "nothing"])
    with pytest.raises(InputError, match=r"no disparity\.pfm"):
        read_scene([tmp_path])
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write_pfm(tmp_path / name / "disparity.pfm", np.zeros((4, 5), np.float32))
    with pytest.raises(InputError, match=r"2 scenes \(a, b\)"):
        read_scene([tmp_path])


def test_an_estimate_opens_itself_next_to_others(light_field, estimate):
    with estimate.view(light_field, others=(estimate,), open_browser=False) as viewer:
        viewer.wait_until_idle()
        assert viewer.comparison.result.options == ("photometric (1)", "photometric (2)")
