"""The thread that does the newest work of each kind."""

import threading

from occjax.viewer.worker import LatestWorker


def test_a_newer_task_replaces_a_waiting_one_of_its_kind_only():
    done, gate = [], threading.Event()
    with LatestWorker() as worker:
        worker.submit("first", gate.wait)
        for number in range(5):
            worker.submit("slider", lambda number=number: done.append(number))
        worker.submit("other", lambda: done.append("other"))
        gate.set()
        worker.wait_until_idle()
    assert done == [4, "other"]


def test_a_running_task_learns_that_a_newer_one_is_waiting():
    answers = []
    with LatestWorker() as worker:
        started = threading.Event()

        def task():
            started.set()
            answers.append(worker.superseded("slider", 10.0))

        worker.submit("slider", task)
        assert started.wait(10.0)
        worker.submit("slider", lambda: answers.append(worker.superseded("slider", 0.0)))
        worker.wait_until_idle()
    assert answers == [True, False]


def test_a_task_that_fails_does_not_end_the_thread(capsys):
    done = []
    with LatestWorker() as worker:
        worker.submit("bad", lambda: 1 / 0)
        worker.wait_until_idle()
        worker.submit("good", lambda: done.append(1))
        worker.wait_until_idle()
    assert done == [1]
    assert "ZeroDivisionError" in capsys.readouterr().err
