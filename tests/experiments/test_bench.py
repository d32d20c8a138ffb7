"""Agreement of the peers with occjax, and smoke tests of the benchmark."""

import dataclasses
import importlib
import json

import jax
import numpy as np
import pytest

from experiments.bench import __main__ as bench, ours, processes
from experiments.bench.candidates import (
    Candidate,
    compare_disparities,
    inference_candidates,
    matrix_product_candidate,
    training_candidates,
)
from experiments.bench.curves import with_candidates
from experiments.bench.exchange import (
    configure,
    describe,
    inference_problem,
    training_problem,
    unflatten,
)
from experiments.bench.peers.description import load, save
from experiments.bench.processes import Timing, check_answers
from experiments.flops import count_flops
from experiments.networks import SCORE_SCALE, small_form
from occjax.errors import InputError
from occjax.models import AggregationConfig, OccCasNet, preset, variable_shapes

SMALL = dataclasses.replace(
    small_form(preset("occcasnet")),
    stages=tuple(
        dataclasses.replace(
            stage, aggregation=AggregationConfig(4, 1), candidates=stage.candidates[::4]
        )
        for stage in preset("occcasnet").stages
    ),
)


PEERS = pytest.mark.parametrize("framework", ["torch", "tensorflow"])


@pytest.fixture(scope="module")
def problem():
    """Light field and network whose disparities spread over a pixel."""
    problem = inference_problem(SMALL, 18, score_scale=1000 * SCORE_SCALE)
    return problem._replace(views=problem.views[:, :, :, :, :15])


@pytest.fixture(scope="module")
def batch():
    """Two training patches for the same network."""
    return training_problem(SMALL, 12, 2)


def variables_of(problem):
    return unflatten(problem.variables, variable_shapes(SMALL))


def peer(framework):
    pytest.importorskip(framework)
    return importlib.import_module(f"experiments.bench.peers.in_{framework}")


def answer(program):
    return program.fetch(program.run())


@PEERS
def test_peer_has_the_same_answer(framework, problem, tmp_path, tolerance):
    build = peer(framework).build
    outputs = jax.jit(OccCasNet(SMALL).apply)(variables_of(problem), problem.views[0])
    assert np.std(outputs[-1].disparity) > 0.1
    save(tmp_path, problem)
    found = answer(build(load(tmp_path)))
    np.testing.assert_allclose(found, outputs[-1].disparity, **tolerance("convolution"))


@PEERS
def test_peer_has_the_same_training_steps(framework, batch):
    theirs, own = peer(framework).train(batch, rate=1e-3), ours.train(batch, rate=1e-3)
    for _ in range(3):  # later steps use the updated weights
        np.testing.assert_allclose(answer(theirs), answer(own), rtol=2e-3)


def test_problem_is_unchanged_by_saving(batch, tmp_path):
    save(tmp_path, batch)
    read = load(tmp_path)
    assert configure(read.network) == SMALL
    np.testing.assert_array_equal(read.views, batch.views)
    np.testing.assert_array_equal(read.truth, batch.truth)
    jax.tree.map(np.testing.assert_array_equal, variables_of(read), variables_of(batch))


@pytest.mark.parametrize("name", ["cas_2_occ_gt", "cas_2_share"])
def test_unsupported_networks_are_rejected(name):
    with pytest.raises(InputError, match="choose such a network"):
        describe(preset(name))


def test_candidates_of_a_curve_have_the_same_range():
    first, second = with_candidates(preset("occcasnet"), 5).stages
    assert first.candidates == (-4.0, -2.0, 0.0, 2.0, 4.0)
    assert second == preset("occcasnet").stages[1]


def test_table_compares_with_the_fastest_peer_and_the_matrix_product():
    differences = {"median difference": 3e-6, "largest difference": 2e-5}
    timings = [
        Timing("matrix product", 64, 1.0, (2.0, 1.0, 3.0), 10**9, 4e9),
        Timing("torch", 64, 9.0, (8.0, 8.0, 8.0), 10**9, 8e9, differences),
        Timing("tensorflow", 64, 9.0, (5.0, 4.0, 3.0), 10**9, 8e9, differences),
        Timing("proposal", 64, 9.0, (1.0, 1.0, 1.0), 10**9, None),
        Timing("occjax", 64, 9.0, (2.0, 2.0, 7.0), 2 * 10**9, 8e9, differences),
    ]
    *_, proposal, last = (
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in bench.table(timings).splitlines()
    )
    # 8 GFLOP in 2 s, compared with 4 GFLOP of the product in 2 s.
    assert last == [
        *("64", "occjax", "2", "2", "7", "0.50", "9", "2.00 GB", "4", "200 %", "3e-06", "2e-05")
    ]
    assert proposal == ["64", "proposal", "1", "1", "1", "", "9", "1.00 GB", "", "", "", ""]


def test_missing_gpu_is_reported_before_any_output(tmp_path, monkeypatch):
    monkeypatch.setitem(processes.PLATFORMS, "gpu", "no such platform")
    with pytest.raises(InputError, match="JAX finds none on this machine"):
        bench.run(device="gpu", output=tmp_path / "table")
    assert not (tmp_path / "table").exists()


def test_candidates_on_a_gpu():
    config = preset("occcasnet")
    candidates = inference_candidates(config, 256, "gpu", "bfloat16", ("torch", "torch compiled"))
    assert [each.name for each in candidates] == [
        *("occjax float32", "torch", "torch compiled", "occjax"),
        *("proposal float32", "proposal"),
    ]
    assert matrix_product_candidate("gpu", "bfloat16").flops == 2 * 8192**3
    assert candidates[2].options == {"compiled": True, "device": "cuda", "precision": "bfloat16"}
    peer, own = training_candidates(config, 32, 32, "gpu", "bfloat16", ("torch",))
    # 32 patches of 32x32 pixels have half as many pixels as 256x256.
    assert own.flops == peer.flops == pytest.approx(3 * candidates[0].flops / 2, rel=1e-3)
    with pytest.raises(InputError, match="tensorflow computes in float32"):
        inference_candidates(config, 256, "gpu", "bfloat16", ("tensorflow",))


@pytest.mark.parametrize("measure", ["median difference", "largest difference"])
def test_deviating_answer_is_reported(tmp_path, measure):
    """The answers differ by 1/16 of a pixel everywhere and by one pixel in one place."""
    np.save(tmp_path / "reference.npy", np.zeros((4, 5)))
    np.save(tmp_path / "occjax.npy", np.pad([[1.0]], ((0, 3), (0, 4)), constant_values=1 / 16))
    found = {"median difference": 1 / 16, "largest difference": 1.0}

    def check(bounds):
        reference = Candidate("reference", "ours", "build")
        ours = Candidate("occjax", "ours", "build", reference="reference", bounds=bounds)
        return check_answers((reference, ours), tmp_path, compare_disparities)

    assert check(found)["occjax"].items() >= found.items()
    with pytest.raises(RuntimeError, match=f"occjax differs from reference: {measure}"):
        check({**found, measure: 0.9 * found[measure]})


def smoke_test(script, folder, *options):
    """Return the output of a smoke test and its numbers."""
    code, printed, _ = script(bench.run, "--small", "--peers", *options, "--output", folder)
    assert code == 0
    (table,), (numbers,) = (list(folder.glob(ending)) for ending in ("*.md", "*.json"))
    assert printed == table.read_text()
    return printed, json.loads(numbers.read_text())


@pytest.mark.slow
def test_smoke_test_writes_table_and_numbers(script, tmp_path):
    _, numbers = smoke_test(script, tmp_path)
    assert [each["name"] for each in numbers] == ["matrix product", "materialised", "occjax"]
    own = numbers[-1]
    assert 0 < own["differences"]["largest difference"] < 1e-4
    assert own["first"] > own["typical"] > 0
    assert own["memory"] > 1e7


@pytest.mark.slow
def test_smoke_test_in_bfloat16_reports_the_change_of_accuracy(script, tmp_path):
    printed, numbers = smoke_test(script, tmp_path, "--precision", "bfloat16")
    lost = {each["name"]: each["differences"] for each in numbers}
    assert 1e-5 < lost["occjax"]["median difference"] < 0.01
    scores = lost["sample bfloat16"]
    assert scores["largest difference"] > 1e-5
    assert abs(scores["bfloat16"] - scores["float32"]) < 1
    assert printed.splitlines()[-1].endswith(f"{scores['bfloat16']:.2f} % in bfloat16.")


@pytest.mark.slow
def test_smoke_test_of_training(script, tmp_path):
    printed, numbers = smoke_test(script, tmp_path, "--train")
    assert [each["name"] for each in numbers] == ["matrix product", "occjax"]
    assert "fastest peer" not in printed
    assert numbers[1]["flops"] == 2 * 3 * count_flops(small_form(preset("occcasnet")), (16, 16))


@pytest.mark.slow
def test_wrong_options_give_one_line(script):
    code, _, said = script(bench.run, "--small", "--peers", "theano")
    assert (code, said.count("\n")) == (2, 1)
    assert "theano is unknown" in said
    code, _, said = script(bench.run, "--repeats", "0")
    assert (code, said.count("\n")) == (2, 1)
    code, _, said = script(
        bench.run, "--small", "--train", "--peers", "torch", "--peer-python", "nowhere"
    )
    assert (code, said.count("\n")) == (2, 1)
    assert "nowhere cannot be run" in said
