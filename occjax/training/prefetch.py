"""Batches that are prepared in a thread while the model trains."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator
from concurrent.futures import Future, ThreadPoolExecutor

from occjax.data.sources import ALL_ROWS
from occjax.training.step import Batch, BatchSource


def prefetch(
    source: BatchSource,
    first: int,
    end: int,
    *,
    ahead: int = 2,
    rows: slice = ALL_ROWS,
    place: Callable[[Batch], Batch] = lambda batch: batch,
) -> Generator[tuple[int, Batch], None, None]:
    """Yield the steps ``first`` to ``end - 1`` with their batches.

    Args:
        source: Source of the batches; one other thread calls it, one batch after the other.
        first: First step.
        end: Step after the last.
        ahead: Number of batches prepared ahead of the one in use.
        rows: Rows of the batches that this process makes.
        place: Puts a batch, of these rows, on the devices.

    Yields:
        Number of the step and its batch.
    """

    def make(step: int) -> Batch:
        return place(source(step) if rows == ALL_ROWS else source(step, rows))

    pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="batches")
    waiting: deque[Future[Batch]] = deque()
    try:
        for step in range(first, end):
            while len(waiting) <= ahead and step + len(waiting) < end:
                waiting.append(pool.submit(make, step + len(waiting)))
            yield step, waiting.popleft().result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
