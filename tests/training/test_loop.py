"""The training loop: resuming, interrupts, files and errors."""

import dataclasses
import json
import os
import signal

import jax
import numpy as np
import pytest
from safetensors import safe_open

from occjax.errors import InputError
from occjax.models import load_weights, save_weights
from occjax.training import (
    RunConfig,
    TrainConfig,
    loop as training_loop,
    read_log,
    scenes_from_batch,
    train,
)
from occjax.training.checkpoints import Checkpoints
from tests.reference.variables import random_variables
from tests.training.conftest import PROPOSAL_NETWORK, planes, prepared_batch

RUN = RunConfig(log_every=2, validate_every=2, prefetch=1, devices=1)


def one_plane(step):
    """Return a batch of one plane; devices do not share it, which saves a compilation."""
    return planes(step, count=1)


def quiet(line):
    """Print nothing."""


@pytest.fixture(scope="module")
def begin(six_steps, tmp_path_factory):
    """Return ``train`` with given weights: compiling the random ones takes as long as a test."""
    weights = tmp_path_factory.mktemp("given") / "given.safetensors"
    save_weights(weights, random_variables(six_steps.network), six_steps.network)

    def begin(config, source, folder, **options):
        options = {"run": RUN, "say": quiet, "initial_weights": weights, **options}
        return train(config, source, folder, **options)

    return begin


def assert_same(one, other):
    for ours, theirs in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        np.testing.assert_array_equal(ours, theirs)


@pytest.fixture(scope="module")
def uninterrupted(six_steps, begin, tmp_path_factory):
    """Train six steps without interruption; return the result and the folder."""
    folder = tmp_path_factory.mktemp("training") / "run"
    return begin(six_steps, one_plane, folder), folder


@pytest.fixture(scope="module")
def validated(six_steps, begin, tmp_path_factory):
    """Train six steps with three validations, of which the second is the best."""
    folder = tmp_path_factory.mktemp("validated") / "run"
    scores = iter([40.0, 30.0, 10.0, 20.0])  # the first of the initial weights
    lines = []

    def scored(*arguments, **options):
        return {**real(*arguments, **options), "badpix_0.07": next(scores)}

    real, training_loop.validate = training_loop.validate, scored
    try:
        scenes = scenes_from_batch(planes(1000))
        run = dataclasses.replace(RUN, keep=1)
        begin(six_steps, one_plane, folder, run=run, validation=scenes, say=lines.append)
    finally:
        training_loop.validate = real
    return folder, lines


def test_an_interrupted_training_ends_like_an_uninterrupted_one(
    uninterrupted, six_steps, begin, tmp_path
):
    """After Ctrl-C the current step is finished and saved; the next start resumes from it."""

    def interrupting(step):
        if step == 2:
            os.kill(os.getpid(), signal.SIGINT)
        return one_plane(step)

    with pytest.raises(KeyboardInterrupt):
        begin(six_steps, interrupting, tmp_path)
    with Checkpoints(tmp_path, keep=2) as checkpoints:
        assert 1 <= checkpoints.latest_step < 6
    lines = []
    resumed = begin(six_steps, one_plane, tmp_path, say=lines.append)
    assert any("resuming after step" in line for line in lines)
    assert resumed.finished
    assert_same(resumed.state, uninterrupted[0].state)
    assert [entry["step"] for entry in read_log(tmp_path)][-1] == 6


def test_a_killed_training_repeats_the_steps_after_the_checkpoint(
    uninterrupted, six_steps, begin, tmp_path
):
    class Killed(Exception):
        pass

    def dying(step):
        if step == 5:
            raise Killed
        return one_plane(step)

    run = dataclasses.replace(RUN, checkpoint_steps=3, log_every=1, prefetch=1)
    with pytest.raises(Killed):
        begin(six_steps, dying, tmp_path, run=run)
    assert [entry["step"] for entry in read_log(tmp_path)] == [1, 2, 3, 4, 5]
    with Checkpoints(tmp_path, keep=2) as checkpoints:
        assert checkpoints.latest_step == 3
    resumed = begin(six_steps, one_plane, tmp_path, run=run)
    assert_same(resumed.state, uninterrupted[0].state)
    assert [entry["step"] for entry in read_log(tmp_path)] == [1, 2, 3, 4, 5, 6]


def test_training_stops_with_a_checkpoint_when_its_time_is_up(six_steps, begin, tmp_path):
    run = dataclasses.replace(RUN, minutes=1e-9)
    first = begin(six_steps, one_plane, tmp_path, run=run)
    assert (first.finished, int(first.state.step)) == (False, 1)
    second = begin(six_steps, one_plane, tmp_path, run=run)
    assert int(second.state.step) == 2


def test_a_finished_training_is_left_unchanged(uninterrupted, six_steps, begin):
    first, folder = uninterrupted
    log = (folder / "log.jsonl").read_text()
    again = begin(six_steps, one_plane, folder)
    assert_same(again.state, first.state)
    assert (folder / "log.jsonl").read_text() == log


def test_the_weights_file_contains_the_moving_average(uninterrupted, six_steps):
    trained, _ = uninterrupted
    variables, config = load_weights(trained.weights)
    assert config == six_steps.network
    assert_same(variables, trained.state.ema)


def test_every_line_of_the_log_is_json_with_numbers(uninterrupted, tolerance):
    _, folder = uninterrupted
    lines = (folder / "log.jsonl").read_text().splitlines()
    entries = [json.loads(line) for line in lines]
    assert [entry["step"] for entry in entries] == [2, 4, 6]
    for entry in entries:
        assert entry["kind"] == "train"
        for name in ("loss", "badpix", "disparity_0", "learning_rate", "seconds_per_step"):
            assert entry[name] > 0.0
        assert 0.0 <= entry["waiting_for_data"] <= 1.0
    # Peak 3e-3 reached by a warm-up of two steps, then a cosine that ends at a hundredth.
    np.testing.assert_allclose(entries[0]["learning_rate"], 3e-3, **tolerance("relative"))
    np.testing.assert_allclose(entries[2]["learning_rate"], 3e-5, **tolerance("relative"))


def test_tensorboard_is_written_if_it_is_installed(uninterrupted):
    pytest.importorskip("tensorboardX")
    _, folder = uninterrupted
    assert list((folder / "tensorboard").glob("events.*"))


def test_the_best_checkpoint_and_the_last_are_kept(validated):
    folder, _ = validated
    assert sorted(int(path.name) for path in (folder / "checkpoints").iterdir()) == [4, 6]
    with Checkpoints(folder, keep=1) as checkpoints:
        assert checkpoints.best_score == 10.0


def test_the_best_weights_are_those_of_the_best_validation(validated):
    folder, _ = validated
    with safe_open(folder / "best.safetensors", framework="numpy") as file:
        assert file.metadata()["step"] == "4"


def test_validations_are_logged_reported_and_drawn(validated):
    folder, lines = validated
    entries = [entry for entry in read_log(folder) if entry["kind"] == "validation"]
    assert [entry["step"] for entry in entries] == [0, 2, 4, 6]
    (line,) = [line for line in lines if line.startswith("step 4: ")]
    assert "badpix_0.07 10.000" in line
    assert entries[0]["mse_x100"] == pytest.approx(
        np.mean([entries[0]["sample_0/mse_x100"], entries[0]["sample_1/mse_x100"]])
    )
    names = sorted(path.name for path in (folder / "pictures").iterdir())
    assert names == ["sample_0.png", "sample_1.png"]


def test_compiling_is_announced_and_without_a_terminal_each_line_of_the_log_is_printed(validated):
    _, lines = validated
    first, compiling, compiled = (
        next(number for number, line in enumerate(lines) if text in line)
        for text in ("preparing the first batch", "compiling the training step", "compiled in")
    )
    assert first < compiling < compiled
    progress = [line for line in lines if "s per step" in line]
    assert [line.partition(":")[0] for line in progress] == [f"step {n} of 6" for n in (2, 4, 6)]


def test_a_folder_of_other_settings_is_refused(uninterrupted, six_steps, begin):
    _, folder = uninterrupted
    other = dataclasses.replace(
        six_steps, optimiser=dataclasses.replace(six_steps.optimiser, peak_rate=1.0)
    )
    with pytest.raises(InputError, match=r"optimiser.peak_rate is 0.003, not 1.0; choose another"):
        begin(other, one_plane, folder)
    with pytest.raises(InputError, match=r"data.seed is absent, not 1"):
        begin(six_steps, one_plane, folder, data={"seed": 1})


def test_a_file_in_place_of_the_folder_is_refused(six_steps, begin, tmp_path):
    (tmp_path / "run").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        begin(six_steps, one_plane, tmp_path / "run")


def test_a_loss_that_is_not_finite_stops_before_it_is_saved(six_steps, begin, tmp_path):
    def broken(step):
        batch = one_plane(step)
        return batch._replace(views=batch.views * np.nan) if step >= 2 else batch

    run = dataclasses.replace(RUN, checkpoint_steps=1)
    with pytest.raises(InputError, match="no longer finite at step 3"):
        begin(six_steps, broken, tmp_path, run=run)
    with Checkpoints(tmp_path, keep=2) as checkpoints:
        assert checkpoints.latest_step == 2
    assert read_log(tmp_path)[-1]["loss"] is None


def test_training_starts_from_the_given_weights(uninterrupted, six_steps, begin, tmp_path):
    """Adam's first step moves no weight by more than the learning rate, here 1.5e-3."""
    given = random_variables(six_steps.network, seed=5)
    weights = tmp_path / "given.safetensors"
    save_weights(weights, given, six_steps.network)
    run = dataclasses.replace(RUN, minutes=1e-9)
    started = begin(six_steps, one_plane, tmp_path / "run", run=run, initial_weights=weights)
    for ours, theirs in zip(
        jax.tree.leaves(started.state.params), jax.tree.leaves(given["params"]), strict=True
    ):
        assert 0.0 < np.abs(ours - theirs).max() < 1.51e-3
    with pytest.raises(InputError, match="light_tiny: is neither a file nor the name of weights"):
        begin(six_steps, one_plane, tmp_path / "named", initial_weights="light_tiny")
    assert not (tmp_path / "named").exists()
    # The name of weights in the package is found; they are of another model.
    with pytest.raises(InputError, match=r"proposal\.safetensors: was made for another model"):
        begin(six_steps, one_plane, tmp_path / "named", initial_weights="light")
    with pytest.raises(InputError, match=r"initial_weights is .*, not None"):
        begin(six_steps, one_plane, tmp_path / "run", initial_weights=None)


def test_a_residual_without_a_selection_leaves_no_folder(tmp_path):
    config = TrainConfig(PROPOSAL_NETWORK, trained="residual")
    with pytest.raises(InputError, match="of a trained selection; pass its weights"):
        train(config, lambda step: prepared_batch(), tmp_path / "run")
    assert not (tmp_path / "run").exists()
