"""The short form of ``python -m tests.training.several_devices``."""

import numpy as np
import pytest

from tests.training.several_devices import (
    ARRANGEMENTS,
    BATCH_SIZE,
    Run,
    difference,
    half_of,
    train_in,
    work,
)

LOSS_TOLERANCE, WEIGHT_TOLERANCE = 1e-4, 5e-5
"""Relative difference of a loss, and difference of a weight. In 20 steps weights move by 2e-3."""

STEPS, OPTIONS = 6, ("--checkpoint-steps", "3")


@pytest.mark.slow
def test_one_device_two_processes_and_eight_devices_train_alike(tmp_path):
    """The eight devices resume the two processes at half the steps."""
    work(["--worker", str(tmp_path / "one"), "--steps", str(STEPS), *OPTIONS], devices=1)
    with np.load(tmp_path / "one.npz") as result:
        one = Run(result["losses"], result["weights"], [])
    two = train_in(ARRANGEMENTS["2 processes"], tmp_path / "two", STEPS, *OPTIONS)
    half = half_of(tmp_path / "two", tmp_path / "half", STEPS)
    eight = train_in(ARRANGEMENTS["8 devices"], half, STEPS, *OPTIONS)
    for run in (two, eight):
        assert len(run.losses) == STEPS
        losses, weights = difference(run, one)
        assert losses < LOSS_TOLERANCE
        assert weights < WEIGHT_TOLERANCE
    # Each process makes its half of each batch, and nothing else.
    for process, made in enumerate(two.made):
        rows = range(process * BATCH_SIZE // 2, (process + 1) * BATCH_SIZE // 2)
        assert {number % BATCH_SIZE for number in made} == set(rows)
