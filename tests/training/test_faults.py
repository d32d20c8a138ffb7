"""Faults during training: full disks, damaged checkpoints, losses that are not finite, signals."""

import dataclasses
import gc
import os
import resource
import shutil
import signal
import sys
import warnings
from contextlib import contextmanager

import jax
import numpy as np
import pytest

from occjax.errors import InputError
from occjax.models import save_weights
from occjax.training import RunConfig, read_log, train
from occjax.training.checkpoints import Checkpoints
from occjax.training.logging import Log
from occjax.training.placement import make_placement
from occjax.training.replay import replay_step
from occjax.training.step import state_from_variables, train_step
from tests.reference.variables import random_variables
from tests.training.conftest import planes

RUN = RunConfig(log_every=2, prefetch=1, devices=1)


def one_plane(step):
    return planes(step, count=1)


@pytest.fixture(scope="module")
def begin(six_steps, tmp_path_factory):
    """Return ``train`` with given weights: compiling the random ones takes as long as a test."""
    weights = tmp_path_factory.mktemp("given") / "given.safetensors"
    save_weights(weights, random_variables(six_steps.network), six_steps.network)

    def begin(folder, source=one_plane, *, run=RUN, say=lambda line: None):
        return train(six_steps, source, folder, run=run, initial_weights=weights, say=say)

    return begin


@pytest.fixture(scope="module")
def trained(begin, tmp_path_factory):
    """Train six steps with checkpoints after 2, 4 and 6; return the result and the folder."""
    folder = tmp_path_factory.mktemp("trained") / "run"
    run = dataclasses.replace(RUN, checkpoint_steps=2, keep=3)
    return begin(folder, run=run), folder


@pytest.fixture
def unawaited(monkeypatch):
    """Ignore the coroutines of a failed restoration, which Python reports when it removes them."""
    monkeypatch.setattr(sys, "unraisablehook", lambda _: None)
    yield
    gc.collect()


def truncate(file):
    """Cut a file in half."""
    os.truncate(file, file.stat().st_size // 2)


def files_of(folder):
    return sorted(path for path in folder.rglob("*") if path.is_file())


def assert_same(one, other):
    for ours, theirs in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        np.testing.assert_array_equal(ours, theirs)


def flip_a_bit(file):
    """Change one bit in the middle of a file."""
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)


@pytest.mark.parametrize("damage", [truncate, flip_a_bit])
@pytest.mark.usefixtures("unawaited")
def test_a_damaged_checkpoint_is_named_and_the_one_before_it_is_used(
    damage, trained, begin, tmp_path
):
    (result, folder), copy = trained, tmp_path / "run"
    shutil.copytree(folder, copy)
    damage(max(files_of(copy / "checkpoints" / "6"), key=lambda file: file.stat().st_size))
    with pytest.warns(UserWarning, match=r"checkpoints/6: is damaged.* step 4, 2 steps are lost"):
        again = begin(copy)
    assert_same(again.state, result.state)
    assert sorted(path.name for path in (copy / "damaged_checkpoints").iterdir()) == ["6"]


@pytest.mark.slow
@pytest.mark.usefixtures("unawaited")
def test_whatever_file_of_a_checkpoint_is_cut_or_missing_training_resumes(trained, tmp_path):
    """No other exception comes out, and no wrong state: that of step 6 or, with a warning, 4.

    The files are in turn missing, cut, and changed in one bit.
    """
    result, folder = trained
    like = jax.tree.map(
        lambda leaf: jax.ShapeDtypeStruct(leaf.shape, leaf.dtype, sharding=leaf.sharding),
        result.state,
    )
    files = files_of(folder / "checkpoints" / "6")
    assert len(files) >= 10
    for number, file in enumerate(files):
        copy = tmp_path / str(number)
        shutil.copytree(folder / "checkpoints", copy / "checkpoints")
        damage = (os.unlink, truncate, flip_a_bit)[number % 3]
        damage(copy / file.relative_to(folder))
        with warnings.catch_warnings(action="ignore"), Checkpoints(copy, keep=3) as found:
            state = found.restore(like)
        assert int(state.step) in (4, 6)
        if int(state.step) == 6:
            assert_same(state, result.state)


def test_a_damaged_score_is_removed_and_the_state_kept(trained, begin, tmp_path):
    (result, folder), copy = trained, tmp_path / "run"
    shutil.copytree(folder, copy)
    score = copy / "checkpoints" / "6" / "metrics" / "metrics"
    for text in ('{"score": 1.', '{"points": 1.0}', '{"score": "low"}', "3"):
        score.write_text(text)
        with pytest.warns(UserWarning, match=r"6/metrics/metrics: is damaged and removed"):
            again = begin(copy)
        assert_same(again.state, result.state)
        assert not score.exists()


@pytest.mark.usefixtures("unawaited")
def test_without_an_intact_checkpoint_nothing_is_moved(trained, tmp_path):
    result, folder = trained
    shutil.copytree(folder / "checkpoints", tmp_path / "checkpoints")
    for step in (2, 4, 6):
        shutil.rmtree(tmp_path / "checkpoints" / str(step) / "default")
    with Checkpoints(tmp_path, keep=3) as found, pytest.raises(InputError, match="not a complete"):
        found.restore(result.state)
    assert {path.name for path in (tmp_path / "checkpoints").iterdir()} == {"2", "4", "6"}


@contextmanager
def full_disk():
    """Let no file grow."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, limits[1]))
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def test_a_full_disk_is_named_by_the_writers_of_weights_and_log(six_steps, tmp_path):
    variables = random_variables(six_steps.network)
    with Log(tmp_path) as log, full_disk():
        with pytest.raises(InputError, match=r"weights.safetensors: cannot be written \(file too"):
            save_weights(tmp_path / "weights.safetensors", variables, six_steps.network)
        with pytest.raises(InputError, match=r"log.jsonl: cannot be written \(file too large"):
            log.write("train", 1, {"loss": 1.0})


@pytest.mark.parametrize("log_every", [1, 100])
def test_a_disk_that_fills_up_stops_training_in_one_line(begin, tmp_path, log_every):
    """No file may grow from step 3 on: the log or, if there is none, the checkpoint fails."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)

    def filling(step):
        if step == 4:  # made while step 3 runs, at the earliest
            resource.setrlimit(resource.RLIMIT_FSIZE, (0, limits[1]))
        return one_plane(step)

    run = dataclasses.replace(RUN, log_every=log_every, checkpoint_steps=2)
    try:
        with pytest.raises(InputError, match=r"cannot be written \(file too large\)") as caught:
            begin(tmp_path, filling, run=run)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert "\n" not in str(caught.value)
    with Checkpoints(tmp_path, keep=2) as checkpoints:
        assert checkpoints.latest_step in (2, 4)
    assert begin(tmp_path, run=run).finished


def broken_at(*steps):
    """Return a source whose batches of some steps are not finite."""

    def source(step):
        batch = one_plane(step)
        return batch._replace(views=batch.views * np.nan) if step in steps else batch

    return source


def test_skipped_steps_leave_the_state_as_it_was(begin, six_steps, tmp_path):
    lines = []
    run = dataclasses.replace(RUN, skip_nonfinite=2)
    result = begin(tmp_path, broken_at(1, 2, 5), run=run, say=lines.append)
    placement = make_placement(1, devices=1)
    state = placement.place_state(
        state_from_variables(random_variables(six_steps.network), six_steps)
    )
    for step in range(5):
        if step in (1, 2):
            state = state._replace(step=state.step + np.int32(1))
            continue
        batch = placement.place_batch(one_plane(step))
        state, _ = train_step(
            state, batch, config=six_steps, number=np.int32(step), placement=placement
        )
    assert_same(result.state._replace(step=0), state._replace(step=0))
    assert int(result.state.step) == 6
    skipped = [entry["step"] for entry in read_log(tmp_path) if entry["kind"] == "nonfinite"]
    assert skipped == [2, 3, 6]
    assert any("3 steps were skipped" in line for line in lines)


def test_more_skipped_steps_in_a_row_than_allowed_stop_training(begin, tmp_path):
    run = dataclasses.replace(RUN, skip_nonfinite=1)
    with pytest.raises(InputError, match=r"no longer finite at step 4.*--replay 3"):
        begin(tmp_path, broken_at(2, 3), run=run)


def test_a_stored_step_is_repeated(begin, six_steps, tmp_path):
    with pytest.raises(InputError, match="no longer finite at step 4"):
        begin(tmp_path, broken_at(3))
    *lines, metrics = replay_step(six_steps, tmp_path, 3)
    assert lines == ["batch views: 1512 of 1512 values are not finite"]
    assert metrics.startswith("step 3: applied 0, ")
    assert metrics.endswith("loss nan")
    with pytest.raises(InputError, match="step 2 is not stored; stored are: 3"):
        replay_step(six_steps, tmp_path, 2)


def test_a_request_to_terminate_saves_and_returns(begin, tmp_path):
    def terminating(step):
        if step == 2:
            os.kill(os.getpid(), signal.SIGTERM)
        return one_plane(step)

    result = begin(tmp_path, terminating)
    assert not result.finished
    with Checkpoints(tmp_path, keep=2) as checkpoints:
        assert checkpoints.latest_step == int(result.state.step) < 6
