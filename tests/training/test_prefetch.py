"""Batches that are prepared ahead."""

import threading
import time

import pytest

from occjax.data.samples import LightFieldSample
from occjax.training.prefetch import prefetch


def numbered(step):
    """Return a stand-in for the batch of a step."""
    return LightFieldSample(*[step] * len(LightFieldSample._fields))


def test_batches_come_in_order():
    made = []

    def source(step):
        made.append(step)
        return numbered(step)

    batches = list(prefetch(source, 3, 8))
    assert batches == [(step, numbered(step)) for step in range(3, 8)]
    assert made == [3, 4, 5, 6, 7]


def test_batches_are_made_ahead_in_another_thread_up_to_the_limit():
    made = []

    def source(step):
        made.append((step, threading.current_thread()))
        return numbered(step)

    batches = prefetch(source, 0, 100, ahead=2)
    next(batches)
    time.sleep(0.2)
    assert [step for step, _ in made] == [0, 1, 2]
    assert threading.main_thread() not in {thread for _, thread in made}
    batches.close()
    assert len(made) == 3


def test_an_error_of_the_source_is_raised_at_its_step():
    def source(step):
        if step == 2:
            raise ValueError("torn")
        return numbered(step)

    batches = prefetch(source, 0, 5)
    assert [next(batches)[0], next(batches)[0]] == [0, 1]
    with pytest.raises(ValueError, match="torn"):
        next(batches)
