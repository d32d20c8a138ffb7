"""Placement of batches and states on the devices of all processes that train together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from jax.experimental import multihost_utils
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from occjax.data.sources import ALL_ROWS
from occjax.errors import InputError

DATA_AXIS = "data"
"""Name of the mesh axis along which devices share a batch."""


@dataclass(frozen=True)
class Placement:
    """Devices that share every batch, and how they hold the state.

    Attributes:
        mesh: All devices, along one axis, ``"data"``; those of one process follow each other.
        shard_state: Whether the devices share parameters, their moving average and the state of the
            optimiser too: each array is divided along its largest axis that the number of devices
            divides. Otherwise every device holds a copy.
    """

    mesh: Mesh
    shard_state: bool = False

    @property
    def batch(self) -> NamedSharding:
        """Sharding of a batch."""
        return NamedSharding(self.mesh, PartitionSpec(DATA_AXIS))

    def state(self, state: Any) -> Any:
        """Return the sharding of each array of a state, or of its ``jax.ShapeDtypeStruct``."""

        def sharding(array):
            divided = [axis for axis, size in enumerate(array.shape) if size % self.mesh.size == 0]
            if not (self.shard_state and divided):
                return NamedSharding(self.mesh, PartitionSpec())
            largest = max(divided, key=lambda axis: array.shape[axis])
            return NamedSharding(self.mesh, PartitionSpec(*[None] * largest, DATA_AXIS))

        return jax.tree.map(sharding, state)

    def rows(self, batch_size: int) -> slice:
        """Return the rows of a batch that lie on the devices of this process."""
        if self.batch.is_fully_addressable:
            return ALL_ROWS
        indices = self.batch.addressable_devices_indices_map((batch_size,)).values()
        parts = [range(batch_size)[index[0]] for index in indices if index is not None]
        return slice(min(part.start for part in parts), max(part.stop for part in parts))

    def place_batch(self, batch: Any) -> Any:
        """Return a batch on all devices, given the rows of this process."""
        if self.batch.is_fully_addressable:
            return jax.device_put(batch, self.batch)
        return jax.tree.map(
            lambda field: jax.make_array_from_process_local_data(self.batch, np.asarray(field)),
            batch,
        )

    def place_state(self, state: Any) -> Any:
        """Return a state on all devices, given the same state in every process."""
        if self.batch.is_fully_addressable:
            return jax.device_put(state, self.state(state))

        def place(array, sharding):
            values = np.asarray(array)
            return jax.make_array_from_callback(values.shape, sharding, values.__getitem__)

        return jax.tree.map(place, state, self.state(state))


def make_placement(
    batch_size: int, *, devices: int | None = None, accumulate: int = 1, shard_state: bool = False
) -> Placement:
    """Return the placement with which devices share every batch equally.

    Args:
        batch_size: Number of examples in a batch of all processes together.
        devices: Number of devices; by default all devices of all processes.
        accumulate: Number of micro-batches per step.
        shard_state: Whether the devices share the state too.

    Raises:
        InputError: If there are fewer devices, or if the devices or the micro-batches cannot share
            a batch equally; the message says which batch sizes can be shared.

    Example:
        >>> make_placement(4, devices=1).mesh.axis_names
        ('data',)
    """
    # Processes hold consecutive rows of a batch.
    available = sorted(jax.devices(), key=lambda device: (device.process_index, device.id))
    if devices is not None and devices != len(available):
        if jax.process_count() > 1:
            raise InputError(
                f"devices is {devices}, but several processes use all of their {len(available)} "
                "devices; leave it out"
            )
        if devices > len(available):
            raise InputError(f"devices is {devices}, but there are {len(available)}; pass fewer")
    used = available[:devices]
    parts = len(used) * accumulate
    if batch_size % parts:
        below, above = batch_size // parts * parts, (batch_size // parts + 1) * parts
        sizes = f"{below} or {above}" if below else str(above)
        shared = f"{len(used)} devices" + (f" x {accumulate} micro-batches" * (accumulate > 1))
        fewer = [n for n in range(1, len(used)) if batch_size % (n * accumulate) == 0]
        hint = f", or --devices {' or '.join(map(str, fewer))}" if fewer else ""
        raise InputError(
            f"a batch of {batch_size} cannot be shared equally by {shared}; pass "
            f"--data.batch-size {sizes} (a multiple of {parts}){hint}"
        )
    return Placement(Mesh(np.array(used), (DATA_AXIS,)), shard_state)


def gather(tree: Any) -> Any:
    """Return arrays, wherever their parts are, as NumPy arrays in every process.

    Args:
        tree: Arrays on the devices of all processes; all processes call this together.
    """
    return multihost_utils.process_allgather(tree, tiled=True)
