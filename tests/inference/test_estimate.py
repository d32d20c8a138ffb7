"""Estimators as users call them: ranges, grids, weights, and what they refuse."""

import dataclasses
import hashlib
import json
import pickle

import jax
import jax.export
import jax.numpy as jnp
import numpy as np
import pytest

import occjax
from occjax.errors import InputError
from occjax.inference import Estimator, estimate
from occjax.inference.estimate import _compiled
from occjax.inference.preparation import choose_range
from occjax.io import Orientation, check
from occjax.lightfield import LightField
from occjax.models import bundled, preset
from occjax.models.weights import save_weights
from tests.io.scenes import two_planes
from tests.reference.variables import random_variables
from tests.scenes import plane


@pytest.fixture(scope="module")
def photometric():
    return Estimator("photometric")


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    path = tmp_path_factory.mktemp("weights") / "tiny.safetensors"
    save_weights(path, random_variables(preset("tiny")), preset("tiny"))
    return path


@pytest.fixture(scope="module")
def tiny_estimator(tiny):
    return Estimator(weights=tiny)


@pytest.fixture(scope="module")
def light_estimator(tmp_path_factory):
    path = tmp_path_factory.mktemp("weights") / "light.safetensors"
    save_weights(path, random_variables(preset("light_small")), preset("light_small"))
    return Estimator(weights=path)


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package with random weights of given presets."""

    def fill(*names):
        entries = []
        for name in names:
            config = preset(name)
            save_weights(tmp_path / f"{name}.safetensors", random_variables(config), config)
            data = (tmp_path / f"{name}.safetensors").read_bytes()
            digest = hashlib.sha256(data).hexdigest()
            entries.append({"name": name, "summary": "for tests", "sha256": digest})
        (tmp_path / "index.json").write_text(json.dumps(entries))

    monkeypatch.setattr(bundled, "FOLDER", tmp_path)
    bundled.bundled_weights.cache_clear()
    yield fill
    bundled.bundled_weights.cache_clear()


def interior_error(result, light_field):
    return np.abs(result.disparity - light_field.ground_truth)[6:-6, 6:-6]


def test_an_estimate_can_be_pickled_before_and_after_its_occlusion_is_known(photometric):
    result = photometric(plane(slope=(0.01, -0.005)), disparity_range=(-1.0, 2.0))
    before = pickle.loads(pickle.dumps(result))
    np.testing.assert_array_equal(before.occlusion, result.occlusion)
    after = pickle.loads(pickle.dumps(result))
    np.testing.assert_array_equal(after.occlusion, result.occlusion)
    np.testing.assert_array_equal(after.disparity, result.disparity)


def test_a_slanted_plane_is_recovered(photometric):
    light_field = plane(slope=(0.01, -0.005))
    result = photometric(light_field, disparity_range=(-1.0, 2.0))
    assert np.median(interior_error(result, light_field)) < 0.03
    assert result.model == "photometric"
    assert result.weights is None
    assert result.disparity_range == (-1.0, 2.0)
    assert result.disparity.dtype == np.float32
    assert result.occlusion.shape == (3, 3, 40, 48)
    assert 0 <= result.confidence.min() <= result.confidence.max() <= 1


def test_without_a_range_the_images_give_it(photometric):
    light_field = plane(disparity=0.8)
    result = photometric(light_field)
    low, high = result.disparity_range
    assert low < 0.8 < high
    assert any("found by photo-consistency" in note for note in result.notes)
    assert np.median(interior_error(result, light_field)) < 0.03


@pytest.mark.parametrize(
    ("searched", "end"), [((-1.0, 2.0), None), ((-2.4, 0.6), "upper"), ((1.0, 4.0), "lower")]
)
def test_a_range_that_ends_before_the_scene_is_told(photometric, searched, end):
    result = photometric(plane(disparity=0.8), disparity_range=searched)
    told = [note for note in result.notes if "end of the searched range" in note]
    assert len(told) == (end is not None)
    assert all(f"the {end} end" in note for note in told)


def test_the_range_is_that_of_the_layout_which_is_used():
    """Occlusion says that the grid is turned by 180 degrees; it is taken as declared."""
    turned = LightField(two_planes()[0][::-1, ::-1])  # disparities of 1 and -1.5
    assert check(turned).best == Orientation().reversed_sign
    (low, high), _ = choose_range(turned, None)
    assert -2.0 <= low < -1.5
    assert 1.0 < high <= 1.5


def test_the_range_of_the_file_is_used_silently(photometric):
    result = photometric(plane(disparity_range=(-1.0, 2.0)))
    assert result.disparity_range == (-1.0, 2.0)
    assert not result.notes


def test_scenes_of_one_shape_are_compiled_once(photometric):
    photometric(plane(seed=1), disparity_range=(-1.0, 2.0))
    before = _compiled.cache_info().misses
    photometric(plane(seed=2), disparity_range=(-1.2, 1.8))
    estimate(plane(seed=2), model="photometric", disparity_range=(-1.2, 1.8))
    assert _compiled.cache_info().misses == before


def test_irregular_positions_are_used(photometric):
    regular = plane(disparity=0.5)
    # The same views declared twice as far apart have half the disparity.
    offsets = np.stack(np.meshgrid([-2.0, 0.0, 2.0], [-2.0, 0.0, 2.0], indexing="ij"), -1)
    wide = plane(disparity=0.5, positions=offsets.astype(np.float32))
    far = photometric(regular, disparity_range=(-1.0, 2.0)).disparity
    near = photometric(wide, disparity_range=(-1.0, 2.0)).disparity
    assert np.median(far[6:-6, 6:-6]) == pytest.approx(0.5, abs=0.03)
    assert np.median(near[6:-6, 6:-6]) == pytest.approx(0.25, abs=0.03)


def test_a_network_is_named_by_its_weights(tiny_estimator):
    result = tiny_estimator(plane())
    assert result.model == "tiny"
    assert result.weights == "tiny.safetensors"
    assert result.coarse.shape == (40, 48)
    assert result.disparity_range == (-2.0, 2.0)


@pytest.mark.parametrize(
    ("name", "scene"),
    [
        ("tiny_estimator", plane(disparity=0.5)),
        ("light_estimator", plane(grid=(5, 5), size=(24, 24))),
        ("photometric", plane(disparity=0.5)),
    ],
)
def test_there_is_a_disparity_of_each_of_two_stages(name, scene, request):
    result = request.getfixturevalue(name)(scene, disparity_range=(-2.0, 2.0))
    first, last = result.stages
    np.testing.assert_array_equal(first, result.coarse)
    np.testing.assert_array_equal(last, result.disparity)


def test_a_larger_grid_is_cropped_and_said(tiny_estimator):
    large = plane(grid=(5, 7))
    result = tiny_estimator(large)
    assert "the central 3x3 of 5x7 views are used" in result.notes
    same = tiny_estimator(large.central(3, 3))
    np.testing.assert_array_equal(result.disparity, same.disparity)


def test_a_range_elsewhere_moves_the_candidates(tiny_estimator):
    result = tiny_estimator(plane(), disparity_range=(4.0, 6.0))
    assert result.disparity_range == (3.0, 7.0)
    assert result.coarse.min() >= 3.0
    assert any("moved" in note for note in result.notes)


def test_weights_of_the_transposed_warp_are_announced(tiny):
    result = Estimator(weights=tiny, warp="transposed")
    assert any("transposed" in note for note in result.notes)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"model": "no_such_model"}, r"no_such_model.*photometric, cas_1"),
        ({"model": "occcasnet"}, "occjax weights fetch"),
        ({"model": "photometric", "weights": "w.h5"}, "takes no weights"),
        ({"model": "photometric", "warp": "correct"}, "has no warp"),
        ({"warp": "correct"}, "no choice of warp"),
        ({"precision": "float16"}, "float32 or bfloat16"),
        ({"weights": "absent.safetensors"}, "absent.safetensors: there is no such file"),
    ],
)
def test_options_that_do_not_fit_say_why(options, message):
    with pytest.raises(InputError, match=message):
        Estimator(**options)


def test_weights_for_another_model_are_refused(tiny):
    with pytest.raises(InputError, match="another network"):
        Estimator("cas_1", weights=tiny)


@pytest.mark.parametrize("bad", [(2.0, 1.0), (0.0, 0.0), (float("nan"), 1.0)])
def test_a_range_that_is_none_is_refused(photometric, bad):
    with pytest.raises(InputError, match="minimum < maximum"):
        photometric(plane(), disparity_range=bad)


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("wrong", [(1, 2, 3), 1.0, "ab", (None, 1)])
def test_a_range_that_is_not_two_numbers_is_refused(wrong):
    with pytest.raises(InputError, match="needs two numbers"):
        estimate(plane(), disparity_range=wrong)


def test_a_grid_too_small_names_what_fits(tiny_estimator):
    with pytest.raises(InputError, match=r"has 1x5 views.*photometric"):
        tiny_estimator(plane(grid=(1, 5)))


def test_a_range_wider_than_the_network_is_refused(tiny_estimator):
    with pytest.raises(InputError, match="photometric model takes any range"):
        tiny_estimator(plane(), disparity_range=(-4.0, 4.0))


def test_the_function_is_the_estimator(photometric):
    light_field = plane()
    result = estimate(light_field, model="photometric", disparity_range=(-1.0, 2.0))
    again = photometric(light_field, disparity_range=(-1.0, 2.0))
    np.testing.assert_array_equal(result.disparity, again.disparity)
    assert occjax.estimate is estimate


def test_the_first_weights_of_the_package_are_the_default(package):
    package("light_small", "tiny")
    assert Estimator().model == "light_small"
    assert Estimator("tiny").weights == "tiny.safetensors"
    assert Estimator("photometric").weights is None


def test_without_weights_in_the_package_the_default_needs_none(package):
    package()
    assert Estimator().model == "photometric"


def test_a_network_of_any_views_has_no_other_warp(package):
    package("light_small")
    with pytest.raises(InputError, match="no choice of warp"):
        Estimator(warp="transposed")


def _changed(light_field, row, column):
    views = light_field.views.copy()
    views[row, column] = views[row, column, ::-1]
    return dataclasses.replace(light_field, views=views)


def test_a_light_network_looks_at_the_row_the_column_and_the_diagonals(light_estimator):
    light_field = plane(grid=(5, 5), size=(24, 24))
    answer = light_estimator(light_field, disparity_range=(-2.0, 2.0)).disparity

    def changes(row, column):
        changed = _changed(light_field, row, column)
        return np.any(light_estimator(changed, disparity_range=(-2.0, 2.0)).disparity != answer)

    assert all(changes(*view) for view in [(0, 0), (2, 4), (1, 2), (3, 1), (2, 2)])
    assert not any(changes(*view) for view in [(0, 1), (1, 0), (3, 4), (4, 3)])


def test_a_light_network_uses_all_views_of_an_irregular_grid(light_estimator):
    light_field = plane(grid=(5, 5), size=(24, 24))
    rows, columns = np.indices((5, 5), dtype=np.float32) - 2
    positions = np.stack([rows + 0.2 * columns, columns], axis=-1)
    light_field = dataclasses.replace(light_field, positions=positions)
    answers = [
        light_estimator(one, disparity_range=(-2.0, 2.0)).disparity
        for one in (light_field, _changed(light_field, 0, 1))
    ]
    assert np.any(answers[0] != answers[1])


def test_a_light_network_says_where_every_view_is_occluded(light_estimator):
    result = light_estimator(plane(grid=(4, 6), size=(20, 24)), disparity_range=(-2.0, 2.0))
    assert result.occlusion.shape == (4, 6, 20, 24)


@pytest.mark.parametrize(
    ("name", "grid"), [("tiny_estimator", (3, 3)), ("light_estimator", (4, 6))]
)
def test_an_exported_estimator_gives_the_same_answer_without_the_library(name, grid, request):
    estimator = request.getfixturevalue(name)
    scene = plane(grid=grid, size=(20, 24))
    exported = estimator.export(scene, disparity_range=(-2.0, 2.0))
    again = jax.export.deserialize(exported.serialize())
    result = again.call(jnp.asarray(scene.grey()))
    expected = estimator(scene, disparity_range=(-2.0, 2.0))
    np.testing.assert_allclose(result["disparity"], expected.disparity, atol=1e-5)
    assert [shape.shape for shape in again.in_avals] == [(*grid, 20, 24)]


@pytest.mark.parametrize("name", ["photometric", "tiny_estimator", "light_estimator"])
def test_estimating_twice_gives_the_same_numbers(name, request):
    estimator = request.getfixturevalue(name)
    scene = plane(grid=(3, 3) if name == "tiny_estimator" else (4, 6), size=(20, 24))
    one, other = (estimator(scene, disparity_range=(-2.0, 2.0)) for _ in range(2))
    for field in ("disparity", "confidence", "occlusion"):
        np.testing.assert_array_equal(getattr(one, field), getattr(other, field))
