"""The peers are the same network, and the benchmark says which candidate was how fast."""

import dataclasses
import importlib
import json

import jax
import numpy as np
import pytest

from experiments.bench import __main__ as bench
from experiments.bench import ours, processes
from experiments.bench.candidates import Candidate, for_inference, for_training, of_disparity
from experiments.bench.curves import with_candidates
from experiments.bench.exchange import (
    configure,
    describe,
    inference_problem,
    training_problem,
    unflatten,
)
from experiments.bench.peers.description import load, save
from experiments.bench.processes import Timing, take_turns
from experiments.networks import SCORES, small_form
from occjax.errors import InputError
from occjax.models import OccCasNet, Residual, preset, variable_shapes
from occjax.models.work import count_flops

SMALL = dataclasses.replace(
    small_form(preset("occcasnet")),
    stages=tuple(
        dataclasses.replace(stage, aggregation=Residual(4, 1), candidates=stage.candidates[::4])
        for stage in preset("occcasnet").stages
    ),
)


PEERS = pytest.mark.parametrize("framework", ["torch", "tensorflow"])


@pytest.fixture(scope="module")
def problem():
    """A light field and a network whose disparity spreads over a pixel."""
    problem = inference_problem(SMALL, 18, scores=1000 * SCORES)
    return problem._replace(views=problem.views[:, :, :, :, :15])


@pytest.fixture(scope="module")
def batch():
    """Two patches to train the same network on."""
    return training_problem(SMALL, 12, 2)


def variables_of(problem):
    return unflatten(problem.variables, variable_shapes(SMALL))


def peer(framework):
    pytest.importorskip(framework)
    return importlib.import_module(f"experiments.bench.peers.in_{framework}")


def answer(program):
    return program.fetch(program.run())


@PEERS
def test_a_peer_has_the_same_answer(framework, problem, tmp_path):
    build = peer(framework).build
    outputs = jax.jit(OccCasNet(SMALL).apply)(variables_of(problem), problem.views[0])
    assert np.std(outputs[-1].disparity) > 0.1
    save(tmp_path, problem)
    found = answer(build(load(tmp_path)))
    np.testing.assert_allclose(found, outputs[-1].disparity, atol=1e-5)


@PEERS
def test_a_peer_trains_alike(framework, batch):
    theirs, own = peer(framework).train(batch, rate=1e-3), ours.train(batch, rate=1e-3)
    for _ in range(3):  # the later ones with what the first have changed
        np.testing.assert_allclose(answer(theirs), answer(own), rtol=2e-3)


def test_inference_in_bfloat16_is_near(problem):
    full = answer(ours.build(problem))
    with jax.numpy_dtype_promotion("standard"):  # BatchNorm's statistics are float32
        half = answer(ours.build(problem, precision="bfloat16"))
    measures = of_disparity(half, full)
    assert 1e-5 < measures["median difference"] < 0.02
    assert full.dtype == half.dtype == np.float32


def test_problems_come_back_from_the_file(batch, tmp_path):
    save(tmp_path, batch)
    read = load(tmp_path)
    assert configure(read.network) == SMALL
    np.testing.assert_array_equal(read.views, batch.views)
    np.testing.assert_array_equal(read.truth, batch.truth)
    jax.tree.map(np.testing.assert_array_equal, variables_of(read), variables_of(batch))


@pytest.mark.parametrize("name", ["light", "cas_2_occ_gt", "cas_2_share"])
def test_networks_that_the_peers_are_not_are_refused(name):
    with pytest.raises(InputError, match="choose such a network"):
        describe(preset(name))


def test_candidates_of_a_curve_span_the_same_range():
    first, second = with_candidates(preset("occcasnet"), 5).stages
    assert first.candidates == (-4.0, -2.0, 0.0, 2.0, 4.0)
    assert second == preset("occcasnet").stages[1]


def test_the_table_compares_with_the_fastest_peer_and_the_product():
    apart = {"median difference": 3e-6, "largest difference": 2e-5}
    timings = [
        Timing("matrix product", 64, 1.0, (2.0, 1.0, 3.0), 10**9, 4e9),
        Timing("torch", 64, 9.0, (8.0, 8.0, 8.0), 10**9, 8e9, apart),
        Timing("tensorflow", 64, 9.0, (5.0, 4.0, 3.0), 10**9, 8e9, apart),
        Timing("light", 64, 9.0, (1.0, 1.0, 1.0), 10**9, None),
        Timing("occjax", 64, 9.0, (2.0, 2.0, 7.0), 2 * 10**9, 8e9, apart),
    ]
    *_, light, last = (
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in bench.table(timings).splitlines()
    )
    # 8 GFLOP in 2 s; the product's 4 in 2 s.
    assert last == [
        *("64", "occjax", "2", "2", "7", "0.50", "9", "2.00 GB", "4", "200 %", "3e-06", "2e-05")
    ]
    assert light == ["64", "light", "1", "1", "1", "", "9", "1.00 GB", "", "", "", ""]


def test_a_gpu_that_is_not_there_is_told_before_anything_is_made(tmp_path, monkeypatch):
    monkeypatch.setitem(processes.PLATFORMS, "gpu", "no such platform")
    with pytest.raises(InputError, match="JAX sees none on this machine"):
        bench.run(device="gpu", output=tmp_path / "table")
    assert not (tmp_path / "table").exists()


def test_who_takes_part_on_a_gpu():
    config = preset("occcasnet")
    candidates = for_inference(config, 256, "gpu", "bfloat16", ("torch", "torch compiled"))
    assert [each.name for each in candidates] == [
        *("matrix product", "occjax float32", "torch", "torch compiled", "occjax"),
        *("light float32", "light"),
    ]
    assert candidates[0].flops == 2 * 8192**3
    assert candidates[3].options == {"compiled": True, "device": "cuda", "precision": "bfloat16"}
    _, peer, own = for_training(config, 32, 32, "gpu", "bfloat16", ("torch",))
    # The features of 32 patches of 32x32 pixels are as many as those of a quarter of 256x256.
    assert own.flops == peer.flops == pytest.approx(3 * candidates[1].flops / 2, rel=1e-3)
    with pytest.raises(InputError, match="tensorflow computes in float32"):
        for_inference(config, 256, "gpu", "bfloat16", ("tensorflow",))


@pytest.mark.parametrize("measure", ["median difference", "largest difference"])
def test_another_answer_is_not_timed(problem, measure):
    bounds = {"median difference": 1.0, "largest difference": 10.0, measure: 1e-6}
    options = {"precision": "bfloat16"}
    half = Candidate("occjax", "ours", "build", options, reference="written", bounds=bounds)
    written = Candidate("written", "ours", "build_written")
    with pytest.raises(RuntimeError, match=f"occjax is not written: {measure}"):
        take_turns(problem, (written, half), repeats=1)


def small_form_of(script, folder, *options):
    """What a small form prints, and its numbers."""
    code, printed, _ = script(bench.run, "--small", "--peers", *options, "--output", folder)
    assert code == 0
    (table,), (numbers,) = (list(folder.glob(ending)) for ending in ("*.md", "*.json"))
    assert printed == table.read_text()
    return printed, json.loads(numbers.read_text())


def test_the_small_form_writes_table_and_numbers(script, tmp_path):
    _, numbers = small_form_of(script, tmp_path)
    assert [each["name"] for each in numbers] == ["matrix product", "written", "occjax"]
    own = numbers[-1]
    assert 0 < own["apart"]["largest difference"] < 1e-4
    assert own["first"] > own["typical"] > 0
    assert own["memory"] > 1e7


def test_the_small_form_in_bfloat16_tells_what_is_lost(script, tmp_path):
    printed, numbers = small_form_of(script, tmp_path, "--precision", "bfloat16")
    lost = {each["name"]: each["apart"] for each in numbers}
    assert 1e-5 < lost["occjax"]["median difference"] < 0.01
    scores = lost["sample bfloat16"]
    assert scores["largest difference"] > 1e-5
    assert abs(scores["bfloat16"] - scores["float32"]) < 1
    assert printed.splitlines()[-1].endswith(f"{scores['bfloat16']:.2f} % in bfloat16.")


def test_the_small_form_of_training(script, tmp_path):
    printed, numbers = small_form_of(script, tmp_path, "--train")
    assert [each["name"] for each in numbers] == ["matrix product", "occjax"]
    assert "fastest peer" not in printed
    assert numbers[1]["flops"] == 2 * 3 * count_flops(small_form(preset("occcasnet")), (16, 16))


def test_wrong_options_are_one_line(script):
    code, _, said = script(bench.run, "--small", "--peers", "theano")
    assert (code, said.count("\n")) == (2, 1)
    assert "there is no theano" in said
    code, _, said = script(bench.run, "--repeats", "0")
    assert (code, said.count("\n")) == (2, 1)
    code, _, said = script(bench.run, "--small", "--peers", "torch", "--peer-python", "nowhere")
    assert (code, said.count("\n")) == (2, 1)
    assert "nowhere cannot be run" in said
