"""Preparation of light fields for OccCasNet and ProposalNet, and the choice of the range."""

import dataclasses

import numpy as np
import pytest

from occjax.errors import InputError
from occjax.estimators import estimate, make_estimator, run_estimator
from occjax.estimators.ranges import choose_range, notes_on_limits
from occjax.estimators.strips import StripConfig, plan_strips
from occjax.evaluation import evaluate
from occjax.io import load, read_pfm
from occjax.layout import Orientation, check
from occjax.lightfield import LightField
from occjax.models import preset
from tests.io.scenes import two_planes
from tests.scenes import plane


def test_larger_grid_is_cropped_with_a_note(estimators):
    large = plane(grid=(5, 7), size=(24, 32))
    cropped = estimators["tiny"].prepare(large, None)
    expected = estimators["tiny"].prepare(large.central(3, 3), None)
    np.testing.assert_array_equal(cropped.views, expected.views)
    assert cropped.notes == ("the central 3x3 of 5x7 views are used",)
    assert not expected.notes
    assert expected.disparity_range == (-2.0, 2.0)


def test_range_elsewhere_moves_the_candidates(estimators, scene):
    result = run_estimator(estimators["tiny"], scene, disparity_range=(4.0, 6.0))
    assert result.disparity_range == (3.0, 7.0)
    assert result.coarse.min() >= 3.0
    assert "the searched disparities are [3.00, 7.00]" in result.notes


def test_light_fields_that_do_not_fit_occcasnet_are_refused(estimators, scene):
    tiny = estimators["tiny"]
    with pytest.raises(InputError, match=r"has 1x5 views.*photometric"):
        tiny.prepare(plane(grid=(1, 5)), None)
    with pytest.raises(InputError, match="model proposal, which takes any range"):
        tiny.prepare(scene, (-4.0, 4.0))
    _, second = preset("tiny").stages
    stages = (preset("tiny").stages[0], dataclasses.replace(second, occlusion="ground_truth"))
    needs_truth = dataclasses.replace(tiny, config=preset("tiny", stages=stages))
    with pytest.raises(InputError, match="ground truth, which is missing"):
        needs_truth.prepare(dataclasses.replace(scene, ground_truth=None), None)


def test_proposal_net_selects_row_column_and_diagonals_of_a_grid(estimators):
    proposal, light_field = estimators["proposal_small"], plane(grid=(5, 5), size=(16, 16))
    inputs = proposal.prepare(light_field, (-1.0, 1.0))
    used = {divmod(int(index), 5) for index in inputs.view_indices}
    assert {(0, 0), (2, 4), (1, 2), (3, 1), (2, 2)} <= used
    assert not used & {(0, 1), (1, 0), (3, 4), (4, 3)}
    rows, columns = np.indices((5, 5), dtype=np.float32) - 2
    positions = np.stack([rows + 0.2 * columns, columns], axis=-1)
    irregular = proposal.prepare(dataclasses.replace(light_field, positions=positions), (-1.0, 1.0))
    assert irregular.views.shape == (1, 25, 16, 16)


def test_proposal_net_refuses_a_range_of_too_many_candidates(estimators, scene):
    with pytest.raises(InputError, match="too wide; the model searches at most"):
        estimators["photometric"].prepare(scene, (-1e3, 1e3))


def test_measured_range_is_noted_and_declared_range_is_not():
    (low, high), (note,) = choose_range(plane(disparity=0.8), None)
    assert low < 0.8 < high
    assert "found by photo-consistency" in note
    assert choose_range(plane(disparity_range=(-1.0, 2.0)), None) == ((-1.0, 2.0), ())


def test_without_a_measured_range_disparities_keep_to_the_range_that_is_told():
    noise = 0.5 + 0.1 * np.random.default_rng(0).random((3, 3, 32, 32), np.float32)
    result = estimate(noise, model="photometric")
    assert any("; searched [-4.00, 4.00]" in note for note in result.notes)
    assert result.disparity_range == (-4.0, 4.0)
    assert np.abs(result.disparity).max() <= 4.0


def test_range_is_that_of_the_declared_layout():
    """Occlusion shows that the grid is rotated by 180 degrees; the declared layout is used."""
    rotated = LightField(two_planes()[0][::-1, ::-1])  # disparities of 1 and -1.5
    assert check(rotated).best == Orientation().reversed_sign
    (low, high), _ = choose_range(rotated, None)
    assert -2.0 <= low < -1.5
    assert 1.0 < high <= 1.5


@pytest.mark.parametrize("requested", [(2.0, 1.0), (0.0, 0.0), (float("nan"), 1.0)])
def test_reversed_and_empty_ranges_are_refused(requested, scene):
    with pytest.raises(InputError, match="minimum < maximum"):
        choose_range(scene, requested)


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("requested", [(1, 2, 3), 1.0, "ab", (None, 1)])
def test_ranges_that_are_not_two_numbers_are_refused(requested, scene):
    with pytest.raises(InputError, match="needs two numbers"):
        estimate(scene, model="photometric", disparity_range=requested)


@pytest.mark.parametrize(
    ("low", "high", "limit"), [(0, 1, None), (0.3, 1, "lower"), (0, 0.7, "upper")]
)
def test_many_disparities_at_a_limit_are_noted(low, high, limit):
    disparity = np.clip(np.linspace(0.2, 0.8, 100, dtype=np.float32)[None], low, high)
    confidence = np.full_like(disparity, 0.01)
    notes = notes_on_limits(disparity, confidence, (float(low), float(high)))
    assert len(notes) == (limit is not None)
    assert all(f"at the {limit} limit" in note for note in notes)


def test_a_range_is_not_too_narrow_where_nothing_can_be_measured(estimators):
    black = LightField(np.zeros((3, 3, 24, 32), np.uint8))
    (note,) = estimate(black, model=estimators["photometric"]).notes
    assert note.startswith("too little texture to measure the disparity range")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"model": "no_such_model"}, r"no_such_model.*'proposal' or 'photometric'"),
        ({"model": "occcasnet"}, "occjax weights fetch"),
        ({"model": "photometric", "weights": "w.h5"}, "takes no weights"),
        ({"model": "photometric", "warp": "correct"}, "has no warp"),
        ({"warp": "correct"}, "has no warp option"),
        ({"precision": "float16"}, "did you mean 'bfloat16'"),
        ({"weights": "absent.safetensors"}, "absent.safetensors: there is no such file"),
    ],
)
def test_options_that_do_not_fit_together_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        make_estimator(**options)


def test_weights_name_the_model_and_its_warp(weights_file):
    path = weights_file("tiny")
    assert make_estimator(weights=path).name == "tiny"
    transposed = make_estimator("tiny", weights=path, warp="transposed")
    inputs = transposed.prepare(plane(grid=(3, 3), size=(16, 16)), None)
    assert any("transposed" in note for note in inputs.notes)
    with pytest.raises(InputError, match="another model"):
        make_estimator("cas_1", weights=path)


def test_bundled_weights_are_found_by_default_and_by_former_names():
    default, alias = make_estimator(), make_estimator("light")
    assert default == alias
    assert (default.name, default.weights) == ("proposal", "proposal.safetensors")
    assert make_estimator(weights="light").weights == "proposal.safetensors"


def test_the_outermost_usable_views_are_selected(estimators):
    """The views of the outer ring are black, those of the next one have a third of the light."""
    light_field = plane(grid=(9, 9), size=(16, 16))
    ring = np.abs(np.indices((9, 9)) - 4).max(0)
    gain = np.select([ring == 4, ring == 3], [0.0, 0.4], 1.0).astype(np.float32)
    dimmed = dataclasses.replace(light_field, views=light_field.views * gain[..., None, None, None])
    inputs = estimators["proposal_small"].prepare(dimmed, (-1.0, 1.0))
    used = {divmod(int(index), 9) for index in inputs.view_indices}
    assert {(1, 1), (1, 4), (2, 4), (7, 7)} <= used
    assert all(ring[index] < 4 for index in used)
    assert any("32 of 81 views are too dark" in note for note in inputs.notes)
    np.testing.assert_allclose(inputs.views.mean((0, 2, 3)), 0.5, atol=0.1)


def test_occcasnet_refuses_unusable_views(estimators, scene):
    usable = np.ones((3, 3), bool)
    usable[0, 1] = False
    with pytest.raises(InputError, match=r"1 of its 3x3 views .*; use the model proposal"):
        estimators["tiny"].prepare(dataclasses.replace(scene, usable=usable), None)


@pytest.mark.slow
def test_strips_give_the_map_of_the_whole_image(monkeypatch):
    """Long paths and the noise level differ; a wrong row would be wrong by 0.003 in all columns."""
    light_field = plane(grid=(1, 3), size=(96, 40), slope=(0.003, 0.0))
    estimator = make_estimator("photometric")
    whole = run_estimator(estimator, light_field, disparity_range=(0.0, 2.0))
    config = StripConfig(max_bytes=64 * 40 * 560, context_rows=16)
    monkeypatch.setattr(
        "occjax.estimators.proposal.plan_strips",
        lambda *arguments: plan_strips(*arguments, config),
    )
    parts = estimator.prepare(light_field, (0.0, 2.0)).arguments[-1]
    assert len(parts.rows) > 1
    result = run_estimator(estimator, light_field, disparity_range=(0.0, 2.0))
    assert any("strips of rows" in note for note in result.notes)
    difference = np.abs(result.disparity - whole.disparity)
    assert np.mean(difference > 0.01) < 0.02
    assert np.median(difference) < 1e-3


@pytest.mark.slow
def test_a_vignetted_plenoptic_camera(shared):
    folder = shared / "data/cases/vignetted_15x15"
    result = estimate(load(folder / "tiled_15x15.jpg", grid=(15, 15)))
    assert evaluate(result.disparity, read_pfm(folder / "truth.pfm")).badpix[0.07] < 2.0
