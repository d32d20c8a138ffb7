"""Several processes that train together, on one or several hosts.

JAX connects them (``jax.distributed``). Every process runs the same program on its rows of each
batch; process 0 alone writes the log, the weights files and the pictures, and prints.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import jax
import numpy as np
from jax.experimental import multihost_utils
from jax.sharding import NamedSharding, PartitionSpec

from occjax.errors import InputError
from occjax.training.config import HostConfig
from occjax.training.placement import Placement

_T = TypeVar("_T")


def join_processes(config: HostConfig) -> None:
    """Connect to the other processes, before JAX is used; return at once if there are none.

    Raises:
        InputError: If they are not found or not reached.
    """
    if not config.distributed and config.coordinator is None:
        return
    try:
        jax.distributed.initialize(config.coordinator, config.processes, config.process)
    except (ValueError, RuntimeError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(
            f"the processes that train together are not found ({reason}); pass --coordinator "
            "HOST:PORT --processes N --process I, the same HOST:PORT to all of them"
        ) from error
    # On CPUs, the first exchange waits at most 30 s for the others. It is made before any of them
    # compiles.
    multihost_utils.sync_global_devices("joined")


def is_first_process() -> bool:
    """Return whether this process writes and prints."""
    return jax.process_index() == 0


def on_first_process(action: Callable[[], object]) -> None:
    """Run an action in process 0 while the others wait.

    Args:
        action: The action; it needs no other process.

    Raises:
        InputError: In every process, if the action raises it.
    """
    error = None
    if is_first_process():
        try:
            action()
        except InputError as raised:
            error = raised
    if jax.process_count() > 1:
        failed = multihost_utils.broadcast_one_to_all(np.bool_(error is not None))
        if failed and error is None:
            raise InputError("process 0 has stopped; its message says why")
    if error is not None:
        raise error


def agreed_values(values: Sequence[float]) -> list[float]:
    """Return the values of process 0 in every process."""
    return multihost_utils.broadcast_one_to_all(np.array(values, np.float32)).tolist()


def first_process_first(make: Callable[[], _T]) -> _T:
    """Return the result of a function that process 0 calls before the others.

    Process 0 then creates the folders that all of them use.
    """
    made: list[_T] = []
    on_first_process(lambda: made.append(make()))
    return made[0] if made else make()


class Votes:
    """Decisions that all processes take at the same step.

    With several processes, the votes of a step are counted on the devices, and the count is read in
    the next step: no process waits for another one.
    """

    def __init__(self, placement: Placement) -> None:
        mesh = placement.mesh
        self._sharding = placement.batch
        self._any = jax.jit(
            lambda votes: votes.any(0), out_shardings=NamedSharding(mesh, PartitionSpec())
        )
        self.restart()

    def restart(self) -> None:
        """Forget the votes of the step before; all processes do this at the same step."""
        self._before: jax.Array | None = None

    def __call__(self, *votes: bool) -> tuple[bool, ...]:
        """Return, for each vote, whether any process has voted for it.

        With several processes, the votes are those of the step before.
        """
        if self._sharding.is_fully_addressable:
            return votes
        mine = np.tile(np.array(votes), (jax.local_device_count(), 1))
        counted = self._any(jax.make_array_from_process_local_data(self._sharding, mine))
        before, self._before = self._before, counted
        return (False,) * len(votes) if before is None else tuple(map(bool, np.asarray(before)))
