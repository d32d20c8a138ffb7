"""Batches made in a thread while the network trains on the ones before."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator
from concurrent.futures import Future, ThreadPoolExecutor

import jax

from occjax.training.step import Batch, BatchSource


def prefetch(
    source: BatchSource,
    first: int,
    end: int,
    *,
    ahead: int = 2,
    sharding: jax.sharding.Sharding | None = None,
) -> Generator[tuple[int, Batch], None, None]:
    """Steps ``first`` to ``end - 1`` with their batches.

    Args:
        source: Makes the batches, one after the other, in one other thread.
        first: First step.
        end: Step after the last.
        ahead: Batches made ahead of the one in use.
        sharding: Where to put them.

    Yields:
        Number of the step and its batch.
    """

    def make(step: int) -> Batch:
        batch = source(step)
        return batch if sharding is None else jax.device_put(batch, sharding)

    pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="batches")
    waiting: deque[Future[Batch]] = deque()
    try:
        for step in range(first, end):
            while len(waiting) <= ahead and step + len(waiting) < end:
                waiting.append(pool.submit(make, step + len(waiting)))
            yield step, waiting.popleft().result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
