"""Steps whose loss is not finite: batch and state are kept, so that the step can be repeated."""

from __future__ import annotations

import shutil
from functools import partial
from pathlib import Path

import jax
import numpy as np
import orbax.checkpoint as ocp

from occjax.data.samples import LightFieldSample
from occjax.errors import InputError
from occjax.models.proposal.residual import ResidualVolume
from occjax.training.checkpoints import decoding_checkpoint, writing_checkpoint
from occjax.training.config import TrainConfig
from occjax.training.hosts import is_first_process
from occjax.training.placement import make_placement
from occjax.training.prepared import PackedProposals, PreparedSample
from occjax.training.step import Batch, TrainState, init_state, train_step

NONFINITE = "nonfinite"
"""Folder of the steps, in the training folder."""


def keep_step(folder: Path, step: int, state: TrainState, batch: Batch) -> None:
    """Store a step, in a folder of its number; all processes call this together.

    Only the latest two steps are kept.

    Args:
        folder: Training folder.
        step: Number of the step, from 0.
        state: State before the step.
        batch: Its batch.

    Raises:
        InputError: If the folder cannot be written.
    """
    folder = folder / NONFINITE
    with writing_checkpoint(folder), ocp.StandardCheckpointer() as checkpointer:
        stored = {"state": state, "batch": batch}
        checkpointer.save((folder / str(step)).absolute(), stored, force=True)
    if is_first_process():
        for number in sorted(kept_steps(folder))[:-2]:
            shutil.rmtree(folder / str(number), ignore_errors=True)


def replay_step(config: TrainConfig, folder: str | Path, step: int) -> list[str]:
    """Repeat a step that training stored, on one device, and say which numbers are not finite.

    With the environment variable ``JAX_DEBUG_NANS=True``, JAX stops at the operation that gives the
    first NaN and shows where it is in the code.

    Args:
        config: Settings of the training.
        folder: Training folder.
        step: Number of the step, from 0.

    Returns:
        Lines for the user: the fields of the batch, the parameters and the statistics that are not
        finite, and the metrics of the step.

    Raises:
        InputError: If that step is not stored.
    """
    path = Path(folder) / NONFINITE / str(step)
    if not path.is_dir():
        stored = ", ".join(map(str, kept_steps(path.parent))) or "none"
        raise InputError(f"{path}: step {step} is not stored; stored are: {stored}")
    with decoding_checkpoint(path):
        state, batch = _load_step(path, config)
    lines = []
    for title, tree in (
        ("batch", batch._asdict()),
        ("parameter", state.params),
        ("statistic", state.batch_stats),
    ):
        for place, array in jax.tree_util.tree_leaves_with_path(tree):
            values = np.asarray(array, np.float64)
            wrong = int((~np.isfinite(values)).sum())
            if wrong:
                name = jax.tree_util.keystr(place, simple=True, separator="/")
                lines.append(f"{title} {name}: {wrong} of {values.size} values are not finite")
    placement = make_placement(len(batch.valid), devices=1, accumulate=config.accumulate)
    state, batch = placement.place_state(state), placement.place_batch(batch)
    metrics = train_step(state, batch, number=np.int32(step), config=config, placement=placement)[1]
    numbers = ", ".join(f"{name} {float(value):.6g}" for name, value in metrics.items())
    return [*lines, f"step {step}: {numbers}"]


def kept_steps(folder: Path) -> list[int]:
    """Return the numbers of the stored steps in a folder, in ascending order."""
    names = [path.name for path in folder.iterdir()] if folder.is_dir() else []
    return sorted(int(name) for name in names if name.isdecimal())


def _load_step(path: Path, config: TrainConfig) -> tuple[TrainState, Batch]:
    """Read a stored step onto one device."""
    with ocp.StandardCheckpointer() as checkpointer:
        stored = checkpointer.metadata(path.absolute()).item_metadata.tree["batch"]
        fields = jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape, leaf.dtype), stored)
        if "packed" in fields:
            kind = ResidualVolume if "relative" in fields["packed"] else PackedProposals
            fields["packed"] = kind(**fields["packed"])
            batch: Batch = PreparedSample(**fields)
        else:
            batch = LightFieldSample(**fields)
        like = {"state": jax.eval_shape(partial(init_state, config), batch), "batch": batch}
        device = jax.sharding.SingleDeviceSharding(jax.devices()[0])
        like = jax.tree.map(lambda leaf: leaf.update(sharding=device), like)
        restored = checkpointer.restore(path.absolute(), like)
    return restored["state"], restored["batch"]
