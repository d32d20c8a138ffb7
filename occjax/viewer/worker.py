"""A thread that keeps only the newest waiting task of each kind."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable


class LatestWorker:
    """One thread that runs tasks; a newer task of the same kind replaces a waiting one.

    A slider sends values faster than pictures can be computed. Only the newest value counts.

    Example:
        >>> done = []
        >>> with LatestWorker() as worker:
        ...     worker.submit("picture", lambda: done.append(1))
        ...     worker.wait_until_idle()
        >>> done
        [1]
    """

    def __init__(self) -> None:
        self._tasks: dict[str, Callable[[], object]] = {}
        self._changed = threading.Condition()
        self._running = False
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="occjax viewer", daemon=True)
        self._thread.start()

    def submit(self, kind: str, task: Callable[[], object]) -> None:
        """Queue a task; it replaces a waiting task of the same kind."""
        with self._changed:
            self._tasks[kind] = task
            self._changed.notify_all()

    def superseded(self, kind: str, seconds: float) -> bool:
        """Wait for the next task, and return whether it replaces the running one.

        A running task calls this before slow work. A task of another kind ends the wait too.

        Args:
            kind: Kind of the running task.
            seconds: Time to wait, at most.

        Returns:
            Whether a newer task of this kind is waiting, or the worker is closed.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._tasks or self._closed, seconds)
            return kind in self._tasks or self._closed

    def wait_until_idle(self) -> None:
        """Wait until no task is running or waiting, or the worker is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or not (self._tasks or self._running))

    def close(self) -> None:
        """Drop waiting tasks and end the thread after the running one."""
        with self._changed:
            self._closed = True
            self._tasks.clear()
            self._changed.notify_all()
        self._thread.join()

    def __enter__(self) -> LatestWorker:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._running = False
                self._changed.notify_all()
                self._changed.wait_for(lambda: self._tasks or self._closed)
                if self._closed:
                    return
                kind = next(iter(self._tasks))  # the one that has waited longest
                task = self._tasks.pop(kind)
                self._running = True
            try:
                task()
            except Exception:  # a failed task must not stop the viewer
                traceback.print_exc()
