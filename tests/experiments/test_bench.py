"""The peers are the same network, and the benchmark says which candidate was how fast."""

import dataclasses
import importlib
import json

import jax
import numpy as np
import pytest

from experiments.bench import __main__ as bench
from experiments.bench.curves import with_candidates
from experiments.bench.exchange import configure, describe, flatten, unflatten
from experiments.bench.peers.description import load, save
from experiments.bench.processes import Timing
from experiments.inference_work import random_light_field
from experiments.networks import small_form
from occjax.errors import InputError
from occjax.models import OccCasNet, Residual, preset, variable_shapes

SMALL = dataclasses.replace(
    small_form(preset("occcasnet")),
    stages=tuple(
        dataclasses.replace(stage, aggregation=Residual(4, 1), candidates=stage.candidates[::4])
        for stage in preset("occcasnet").stages
    ),
)


@pytest.fixture(scope="module")
def light_field():
    """Weights and views, and the disparity of the network as written: of one pixel's range."""
    variables, views = random_light_field(SMALL, 21, 18)
    for part in ("aggregation_0", "aggregation_1"):
        score = variables["params"][part]["score"]
        score["kernel"] = 1000 * score["kernel"]
    disparity = jax.jit(OccCasNet(SMALL).apply)(variables, views)[-1].disparity
    assert np.std(disparity) > 0.1
    return variables, np.asarray(views), np.asarray(disparity)


@pytest.mark.parametrize("framework", ["torch", "tensorflow"])
def test_a_peer_has_the_same_answer(framework, light_field, tmp_path):
    pytest.importorskip(framework)
    variables, views, disparity = light_field
    save(tmp_path, describe(SMALL), flatten(variables), views)
    network, values, views = load(tmp_path)
    peer = importlib.import_module(f"experiments.bench.peers.in_{framework}")
    np.testing.assert_allclose(peer.build(network, values)(views), disparity, atol=1e-5)


def test_networks_and_variables_come_back_from_the_file(light_field, tmp_path):
    variables, views, _ = light_field
    save(tmp_path, describe(SMALL), flatten(variables), views)
    network, values, read = load(tmp_path)
    assert configure(network) == SMALL
    np.testing.assert_array_equal(read, views)
    back = unflatten(values, variable_shapes(SMALL))
    jax.tree.map(np.testing.assert_array_equal, back, variables)


@pytest.mark.parametrize("name", ["light", "cas_2_occ_gt", "cas_2_share"])
def test_networks_that_the_peers_are_not_are_refused(name):
    with pytest.raises(InputError, match="choose such a network"):
        describe(preset(name))


def test_candidates_of_a_curve_span_the_same_range():
    first, second = with_candidates(preset("occcasnet"), 5).stages
    assert first.candidates == (-4.0, -2.0, 0.0, 2.0, 4.0)
    assert second == preset("occcasnet").stages[1]


def test_the_table_compares_with_the_fastest_peer_and_the_product():
    timings = [
        Timing("matrix product", 64, 1.0, (2.0, 1.0, 3.0), 10**9, 4e9),
        Timing("torch", 64, 9.0, (8.0, 8.0, 8.0), 10**9, 8e9, 1e-5, 1e-6),
        Timing("tensorflow", 64, 9.0, (5.0, 4.0, 3.0), 10**9, 8e9, 1e-5, 1e-6),
        Timing("occjax", 64, 9.0, (2.0, 2.0, 7.0), 2 * 10**9, 8e9, 2e-5, 3e-6),
    ]
    last = bench.table(timings).splitlines()[-1]
    cells = [cell.strip() for cell in last.strip("|").split("|")]
    # 8 GFLOP in 2 s; the product's 4 in 2 s.
    assert cells == [
        *("64", "occjax", "2", "2", "7", "0.50", "9", "2.00 GB", "4", "200 %", "2e-05", "3e-06")
    ]


def test_the_small_form_writes_table_and_numbers(script, tmp_path):
    code, printed, _ = script(bench.run, "--small", "--peers", "--output", tmp_path)
    assert code == 0
    assert printed == (tmp_path / "benchmark.md").read_text()
    numbers = json.loads((tmp_path / "benchmark.json").read_text())
    assert [each["name"] for each in numbers] == ["matrix product", "written", "occjax"]
    ours = numbers[-1]
    assert 0 <= ours["largest"] < 1e-4
    assert ours["first"] > ours["typical"] > 0
    assert ours["memory"] > 1e7


def test_wrong_options_are_one_line(script):
    code, _, said = script(bench.run, "--small", "--peers", "theano")
    assert (code, said.count("\n")) == (2, 1)
    assert "there is no theano" in said
    code, _, said = script(bench.run, "--repeats", "0")
    assert (code, said.count("\n")) == (2, 1)
    code, _, said = script(bench.run, "--small", "--peers", "torch", "--peer-python", "nowhere")
    assert (code, said.count("\n")) == (2, 1)
    assert "nowhere cannot be run" in said
