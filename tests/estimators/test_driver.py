"""From a light field to an estimate: what all estimators have in common."""

import dataclasses
import importlib.util
import pickle
import sys
from pathlib import Path

import jax
import jax.export
import jax.numpy as jnp
import numpy as np
import pytest

import occjax
from occjax import programs
from occjax.errors import InputError
from occjax.estimators import (
    estimate,
    estimate_occlusion,
    export_estimator,
    make_estimator,
    run_estimator,
)
from tests.scenes import plane

RANGE = (-2.0, 2.0)
KINDS = pytest.mark.parametrize("name", ["photometric", "tiny", "proposal_small"])


def median_error(result, light_field):
    return np.median(np.abs(result.disparity - light_field.ground_truth)[6:-6, 6:-6])


@pytest.mark.slow
def test_photometric_estimate_of_a_slanted_plane(estimators, scene):
    phases = []
    result = run_estimator(
        estimators["photometric"],
        scene,
        disparity_range=RANGE,
        occlusion=True,
        report_phase=phases.append,
    )
    assert median_error(result, scene) < 0.03
    assert result.model == "photometric"
    assert result.weights is None
    assert result.disparity_range == RANGE
    assert result.disparity.dtype == np.float32
    assert result.occlusion.shape == (3, 3, 24, 32)
    assert 0 <= result.confidence.min() <= result.confidence.max() <= 1
    reported = [phase for phase in phases if not phase.startswith("compiling")]
    assert reported == ["preparing", "loading the program", "estimating", "occlusion maps"]
    assert set(result.seconds) == {"prepare", "compile", "run", "occlusion"}
    assert all(seconds > 0 for seconds in result.seconds.values())
    restored = pickle.loads(pickle.dumps(result))
    np.testing.assert_array_equal(restored.disparity, result.disparity)


@KINDS
def test_two_runs_give_identical_results_of_two_stages(name, estimators, scene):
    one, other = (
        run_estimator(estimators[name], scene, disparity_range=RANGE, occlusion=k > 0)
        for k in range(2)
    )
    for field in ("disparity", "confidence", "standard_deviation", "coarse"):
        np.testing.assert_array_equal(getattr(one, field), getattr(other, field))
        assert getattr(one, field).shape == scene.image_size
    first, last = one.stages
    np.testing.assert_array_equal(first, one.coarse)
    np.testing.assert_array_equal(last, one.disparity)
    assert other.occlusion.shape == (3, 3, 24, 32)
    assert (one.occlusion is None) == (name != "tiny")  # occlusion maps are part of OccCasNet
    assert one.model == name
    assert one.weights == (None if name == "photometric" else f"{name}.safetensors")


def test_array_of_views_is_estimated_like_the_light_field(estimators, scene):
    views = estimate(scene.views, model=estimators["tiny"], disparity_range=RANGE)
    light_field = estimate(scene, model=estimators["tiny"], disparity_range=RANGE)
    np.testing.assert_array_equal(views.disparity, light_field.disparity)


def test_path_is_refused_with_the_call_that_reads_it(tmp_path):
    with pytest.raises(InputError, match=r"is a path; pass occjax\.load\('.*scene.npz'\)"):
        estimate(str(tmp_path / "scene.npz"))


def test_light_fields_of_one_shape_are_compiled_once(estimators, scene, monkeypatch):
    run_estimator(estimators["photometric"], scene, disparity_range=RANGE)
    loaded, load = [], programs.load_or_compile
    monkeypatch.setattr(
        programs, "load_or_compile", lambda *given: loaded.append(given[3]) or load(*given)
    )
    other = plane(size=(24, 32), seed=2)
    one = run_estimator(estimators["photometric"], other, disparity_range=(-2.1, 1.9))
    again = estimate(other, model="photometric", disparity_range=(-2.1, 1.9))
    assert not [name for name in loaded if name[1] == "ProposalEstimator"]
    np.testing.assert_array_equal(one.disparity, again.disparity)
    assert occjax.estimate is estimate


def test_disparity_of_another_view_is_that_of_the_plane_there(estimators, monkeypatch):
    slope = np.array([0.02, -0.01])
    scene = plane(grid=(5, 5), size=(32, 40), slope=slope)
    photometric = estimators["photometric"]
    centre = estimate(scene, model=photometric, disparity_range=RANGE)
    same = estimate(scene, model=photometric, disparity_range=RANGE, view=(2, 2))
    np.testing.assert_array_equal(same.disparity, centre.disparity)
    y, x = np.mgrid[:32, :40]
    loaded, load = [], programs.load_or_compile
    monkeypatch.setattr(
        programs, "load_or_compile", lambda *given: loaded.append(given[3]) or load(*given)
    )
    for view in ((0, 0), (0, 4), (4, 0)):
        result = estimate(scene, model=photometric, disparity_range=RANGE, view=view)
        # Pixel (y, x) of this view shows the point (y + d v, x + d u) of the centre view.
        truth = (0.6 + slope[0] * y + slope[1] * x) / (1 - slope @ np.subtract(view, 2))
        assert np.median(np.abs(result.disparity - truth)[8:-8, 8:-8]) < 0.03
        assert result.light_field.view == view
        assert result.notes[0].startswith(f"disparity of the view {view}")
    assert len([name for name in loaded if name[1] == "ProposalEstimator"]) <= 1
    with pytest.raises(InputError, match=r"no view \(5, 0\)"):
        estimate(scene, model=photometric, view=(5, 0))


def test_views_declared_twice_as_far_apart_have_half_the_disparity(estimators):
    offsets = np.stack(np.meshgrid([-2.0, 0.0, 2.0], [-2.0, 0.0, 2.0], indexing="ij"), -1)
    wide = plane(size=(24, 32), disparity=0.5, positions=offsets.astype(np.float32))
    result = run_estimator(estimators["photometric"], wide, disparity_range=(-1.0, 1.0))
    assert np.median(result.disparity[6:-6, 6:-6]) == pytest.approx(0.25, abs=0.03)


def test_occlusion_maps_are_smaller_at_the_true_disparity(scene):
    right, wrong = (
        estimate_occlusion(scene, scene.ground_truth + np.float32(error)) for error in (0.0, 0.5)
    )
    np.testing.assert_array_equal(right[1, 1], np.zeros(scene.image_size))
    assert 2 * right[..., 4:-4, 4:-4].mean() < wrong[..., 4:-4, 4:-4].mean()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["photometric", "tiny"])
def test_exported_estimator_gives_the_same_result(name, estimators, scene, tolerance):
    exported = export_estimator(estimators[name], scene, disparity_range=RANGE)
    restored = jax.export.deserialize(exported.serialize())
    assert [shape.shape for shape in restored.in_avals] == [(3, 3, 24, 32)]
    result = restored.call(jnp.asarray(scene.grey()))
    expected = run_estimator(estimators[name], scene, disparity_range=RANGE)
    np.testing.assert_allclose(result["disparity"], expected.disparity, **tolerance("float32"))


@pytest.mark.slow
def test_an_export_has_no_colour_of_its_light_field(estimators, scene):
    estimator = estimators["proposal_small"]
    exported = export_estimator(estimator, scene, disparity_range=RANGE)
    grey = dataclasses.replace(scene, views=scene.grey()[..., None])
    of_colour, of_grey = (
        run_estimator(estimator, each, disparity_range=RANGE).disparity for each in (scene, grey)
    )
    assert np.abs(of_colour - of_grey).max() > 0.1
    result = exported.call(jnp.asarray(scene.grey()))
    np.testing.assert_allclose(result["disparity"], of_grey, atol=1e-3)


def test_model_of_the_documentation_estimates_a_slanted_plane(scene):
    path = Path(__file__).parents[2] / "docs/examples/plane_sweep.py"
    spec = importlib.util.spec_from_file_location("plane_sweep", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    result = occjax.estimate(
        scene, model=module.PlaneSweep(), disparity_range=(-0.5, 1.5), occlusion=True
    )
    assert median_error(result, scene) < 0.05
    assert result.model == "plane sweep"
    assert result.occlusion.shape == (3, 3, 24, 32)


def test_an_export_without_flatbuffers_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "flatbuffers", None)
    with pytest.raises(InputError, match=r"pip install 'occjax\[export\]'"):
        export_estimator(make_estimator("photometric"), plane())
