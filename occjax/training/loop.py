"""The training loop: steps, log, validation, checkpoints and interrupts."""

from __future__ import annotations

import dataclasses
import math
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from tqdm import tqdm

from occjax.data.sources import ALL_ROWS
from occjax.errors import InputError
from occjax.io.atomic import check_writable
from occjax.lightfield import LightField
from occjax.models import save_weights
from occjax.models.bundled import find_weights
from occjax.training.checkpoints import Checkpoints, open_training_folder
from occjax.training.config import RunConfig, TrainConfig
from occjax.training.hosts import Votes, agreed_values, is_first_process, on_first_process
from occjax.training.initial import NO_SELECTION, initial_variables
from occjax.training.logging import Log, read_log
from occjax.training.optimiser import learning_rate
from occjax.training.placement import gather, make_placement
from occjax.training.prefetch import prefetch
from occjax.training.replay import NONFINITE, keep_step
from occjax.training.step import (
    Batch,
    BatchSource,
    TrainState,
    init_state,
    state_from_variables,
    train_step,
)
from occjax.training.validation import SELECTION_METRIC, check_scenes, validate

WEIGHTS_FILE = "weights.safetensors"
BEST_FILE = "best.safetensors"
PICTURES = "pictures"


class Trained(NamedTuple):
    """Result of :func:`train`.

    Attributes:
        state: State after the last step.
        finished: Whether all steps are done; otherwise the time was up, or the process was asked to
            terminate.
        weights: File of the averaged weights.
    """

    state: TrainState
    finished: bool
    weights: Path


def train(
    config: TrainConfig,
    source: BatchSource,
    folder: str | Path,
    *,
    run: RunConfig | None = None,
    validation: Sequence[LightField] = (),
    data: Mapping[str, Any] | None = None,
    batch_size: int | None = None,
    initial_weights: str | Path | None = None,
    say: Callable[[str], None] = tqdm.write,
) -> Trained:
    """Train a model, or resume its training.

    The folder gets ``config.json``; ``log.jsonl`` and, with tensorboardX, ``tensorboard``;
    ``checkpoints`` of the whole state; with every checkpoint ``weights.safetensors``; after each
    validation ``pictures``, and ``best.safetensors`` if it is the best so far. Both weights files
    contain the exponential moving average of the weights, for ``occjax estimate --weights``.

    If the folder already contains a checkpoint of this run, training resumes from it. The result is
    that of an uninterrupted training. If the latest checkpoint is damaged, the one before it is
    used. On an interrupt (Ctrl-C) or a request to terminate (SIGTERM), the current step is finished
    and saved.

    All devices of all processes (:mod:`occjax.training.hosts`) share every batch. A checkpoint of
    any number of devices and processes can be resumed with any other. Several processes need one
    folder that all of them see.

    A step whose loss or gradient is not finite changes nothing. Its batch and state are stored in
    the folder ``nonfinite`` (:mod:`occjax.training.replay`).

    Args:
        config: Settings of the training.
        source: Source of the batches.
        folder: Folder of the training.
        run: Settings of this process.
        validation: Light fields with ground truth to validate on, with different names.
        data: Description of the source, which must be the same when training is resumed.
        batch_size: Number of examples in the batch of a step. With several processes, each requests
            its rows only; by default one batch is requested to find it.
        initial_weights: Initial weights: a file, or a name that ``occjax weights list`` prints;
            random weights by default, from which the residual cannot be trained. They are validated
            before the first step.
        say: Function that is called with lines for the user.

    Returns:
        The final state, whether training is finished, and the file of the weights.

    Raises:
        InputError: If the folder contains something else or can no longer be written, if the data
            or the weights do not fit the model, if the devices cannot share a batch equally, or if
            the loss is no longer finite.
        KeyboardInterrupt: If interrupted, after the state is saved.

    Example:
        ::

            from occjax.training import RunConfig, make_source, recipe, train

            tiny = recipe("tiny")
            source = make_source(tiny.data, tiny.train.network)
            train(tiny.train, source, "runs/tiny", run=RunConfig(minutes=5))
    """
    folder, run = Path(folder), run or RunConfig()
    if config.trained == "residual" and initial_weights is None:
        raise InputError(NO_SELECTION)
    if not is_first_process():
        say = _quiet
    on_first_process(lambda: check_writable(folder))
    check_scenes(validation, config.network)
    initial_file = None if initial_weights is None else find_weights(initial_weights)
    say(f"{folder}: preparing the first batch")
    first = None
    if batch_size is None:
        first = source(0)
        batch_size = first.disparity.shape[0]
    placement = make_placement(
        batch_size, devices=run.devices, accumulate=config.accumulate, shard_state=run.shard_state
    )
    rows = placement.rows(batch_size)
    if first is None:
        first = source(0) if rows == ALL_ROWS else source(0, rows)
    described = {"initial_weights": initial_weights and str(initial_weights), "data": data}
    settings = {**dataclasses.asdict(config), **described}
    on_first_process(lambda: open_training_folder(folder, settings))

    with Checkpoints(folder, keep=run.keep) as checkpoints:
        if checkpoints.latest_step is not None:
            like = jax.eval_shape(partial(init_state, config), first)
            placed = jax.tree.map(
                lambda leaf, sharding: leaf.update(sharding=sharding), like, placement.state(like)
            )
            state = checkpoints.restore(placed)
            say(f"{folder}: resuming after step {int(state.step)}")
        else:
            state = placement.place_state(_first_state(config, first, initial_file))
        start = int(state.step)
        batches_from = partial(prefetch, source, start, config.steps, ahead=run.prefetch)
        with (
            Log(folder, finished_steps=start, enabled=is_first_process()) as log,
            _requests_to_stop() as requests,
            closing(batches_from(rows=rows, place=placement.place_batch)) as batches,
            tqdm(
                total=config.steps,
                initial=start,
                unit="step",
                disable=None if is_first_process() else True,
            ) as bar,
        ):
            keeper = _Keeper(config, run, folder, validation, checkpoints, log, say)
            meter = _Meter(config, log, bar, say)
            steps = _Steps(config, run, placement, folder, log, say)
            votes = Votes(placement)
            if start == 0 and initial_file is not None and validation:
                keeper.validate(gather(state.ema), 0)
            deadline = math.inf if run.minutes is None else time.monotonic() + 60.0 * run.minutes
            for step, batch in meter.waiting(batches):
                state, metrics = steps.take(state, step, batch)
                done = step + 1
                meter.add(metrics)
                stopping, late = votes(
                    bool(requests) or time.monotonic() >= deadline, keeper.is_late()
                )
                last = done == config.steps
                keeping = last or stopping or late or keeper.is_due(done)
                if keeping or done % run.log_every == 0:
                    state = steps.settle(state)
                    meter.report(done)
                if keeping:
                    keeper.keep(state, done, validating=last or not stopping)
                    meter.restart()
                    votes.restart()
                if stopping:
                    break
            if steps.refused:
                say(f"{folder}: {steps.refused} steps were skipped, see {folder / NONFINITE}")
            if signal.SIGINT in requests:
                say(f"{folder}: interrupted after step {int(state.step)}; start again to resume")
                raise KeyboardInterrupt
    return Trained(state, int(state.step) >= config.steps, folder / WEIGHTS_FILE)


def _quiet(line: str) -> None:
    """Print nothing: process 0 speaks."""


def _first_state(config: TrainConfig, batch: Batch, weights: str | Path | None) -> TrainState:
    if weights is None:
        return init_state(config, batch)
    return state_from_variables(initial_variables(config.network, weights), config)


class _Steps:
    """The steps; those whose loss or gradient is not finite are refused.

    The metrics of a step are read when the next one has been started. If a step is refused, the
    next one therefore returns the state before both.

    Attributes:
        refused: Number of steps that were skipped, in this and earlier starts.
    """

    def __init__(self, config, run, placement, folder, log, say) -> None:
        self.config, self.run, self.placement = config, run, placement
        self.folder, self.log, self.say = folder, log, say
        self.refused = sum(entry["kind"] == "nonfinite" for entry in read_log(folder))
        self._unread: tuple[int, Batch, dict[str, jax.Array]] | None = None
        self._successive, self._compiled = 0, False

    def take(
        self, state: TrainState, step: int, batch: Batch
    ) -> tuple[TrainState, dict[str, jax.Array]]:
        """Start a step, and wait for the one before: at most two batches are in use.

        Returns:
            State after the step, and its metrics.
        """
        after, metrics = self._start(state, step, batch)
        before = self.settle(after)
        if before is not after:
            after, metrics = self._start(before, step, batch)
        self._unread = (step, batch, metrics)
        return after, metrics

    def settle(self, state: TrainState) -> TrainState:
        """Wait for the last step; return its state, or if it is refused, the state before it."""
        unread, self._unread = self._unread, None
        if unread is None:
            return state
        if not unread[2]["applied"]:
            return self._refuse(state, *unread)
        self._successive = 0
        return state

    def _start(
        self, state: TrainState, step: int, batch: Batch
    ) -> tuple[TrainState, dict[str, jax.Array]]:
        """Start a step; compile the first one and tell the user, who sees no progress meanwhile."""
        run_step = partial(
            train_step, config=self.config, number=np.int32(step), placement=self.placement
        )
        if self._compiled:
            return run_step(state, batch)
        self._compiled, begin = True, time.monotonic()
        self.say(
            f"{self.folder}: compiling the training step; on a CPU this takes one to several "
            "minutes"
        )
        result = run_step(state, batch)
        self.say(f"{self.folder}: compiled in {time.monotonic() - begin:.0f} s")
        return result

    def _refuse(
        self, state: TrainState, step: int, batch: Batch, metrics: dict[str, jax.Array]
    ) -> TrainState:
        """Store a step that was refused; skip it, or stop.

        Raises:
            InputError: If no more steps may be skipped.
        """
        keep_step(self.folder, step, state, batch)
        done = step + 1
        numbers = {name: float(metrics[name]) for name in ("loss", "gradient_norm")}
        self.log.write("nonfinite", done, numbers)
        self.refused, self._successive = self.refused + 1, self._successive + 1
        wrong = (
            "the loss is no longer finite"
            if not math.isfinite(numbers["loss"])
            else "the gradient of the loss is no longer finite"
        )
        if self._successive > self.run.skip_nonfinite:
            raise InputError(
                f"{wrong} at step {done}; batch and state are in {self.folder / NONFINITE}: add "
                f"--replay {step} to the command to examine them. Pass --skip-nonfinite N, or "
                "train in another folder with a lower optimiser.peak_rate, a longer "
                "optimiser.warm_up or with optimiser.clip"
            )
        self.say(f"{wrong} at step {done}: skipped, {self.refused} so far; --replay {step}")
        return state._replace(step=state.step + np.int32(1))


class _Keeper:
    """Validation and saving, when they are due."""

    def __init__(self, config, run, folder, validation, checkpoints, log, say) -> None:
        self.config, self.run, self.folder = config, run, folder
        self.validation, self.checkpoints, self.log, self.say = validation, checkpoints, log, say
        self.saved = time.monotonic()

    def is_due(self, done: int) -> bool:
        """Return whether the state after this step is to be saved."""
        every = self.run.checkpoint_steps
        return self._validates(done) or (every is not None and done % every == 0)

    def is_late(self) -> bool:
        """Return whether the longest time between two checkpoints has passed."""
        return time.monotonic() - self.saved >= 60.0 * self.run.checkpoint_minutes

    def keep(self, state: TrainState, done: int, *, validating: bool) -> None:
        """Validate if it is due, and save."""
        average, score = gather(state.ema), None
        if validating and self._validates(done):
            scores = self.validate(average, done)
            score, best = scores[SELECTION_METRIC], self.checkpoints.best_score
            if best is None or score < best:
                self._save_weights(average, BEST_FILE, done)
        self.checkpoints.save(state, score=score)
        self._save_weights(average, WEIGHTS_FILE, done)
        self.saved = time.monotonic()

    def _validates(self, done: int) -> bool:
        at_end = done == self.config.steps
        return bool(self.validation) and (done % self.run.validate_every == 0 or at_end)

    def validate(self, average: dict[str, Any], done: int) -> dict[str, float]:
        """Validate the averaged weights in every process, and write the scores to the log."""
        scores = validate(
            average,
            self.validation,
            self.config.network,
            pictures=self.folder / PICTURES if is_first_process() else None,
        )
        if jax.process_count() > 1:  # all processes must choose the same checkpoint as the best
            scores = dict(zip(scores, agreed_values([*scores.values()]), strict=True))
        self.log.write("validation", done, scores)
        means = ", ".join(
            f"{name} {value:.3f}" for name, value in scores.items() if "/" not in name
        )
        self.say(f"step {done}: {means}")
        return scores

    def _save_weights(self, average: dict[str, Any], name: str, done: int) -> None:
        variables = {kind: tree for kind, tree in average.items() if tree}
        on_first_process(
            lambda: save_weights(
                self.folder / name, variables, self.config.network, {"step": str(done)}
            )
        )


class _Meter:
    """Means of the metrics of several steps, for the log and the progress bar.

    Where there is no progress bar, in a pipe or a file, lines are printed instead.
    """

    def __init__(
        self, config: TrainConfig, log: Log, bar: tqdm, say: Callable[[str], None]
    ) -> None:
        self.rate = learning_rate(config.optimiser, config.steps)
        self.log, self.bar, self.say = log, bar, say
        self.restart()

    def restart(self) -> None:
        """Restart the means and the measurement of time."""
        self.pending: list[dict[str, jax.Array]] = []
        self.begin, self.waited = time.monotonic(), 0.0

    def waiting(self, batches: Iterator) -> Iterator:
        """Yield the batches and measure the time spent waiting for them."""
        while True:
            begin = time.monotonic()
            item = next(batches, None)
            self.waited += time.monotonic() - begin
            if item is None:
                return
            yield item

    def add(self, metrics: dict[str, jax.Array]) -> None:
        """Add the metrics of a step without waiting for the step to end."""
        self.pending.append(metrics)
        self.bar.update()

    def report(self, done: int) -> None:
        """Log the means since the last report, without the steps that were refused."""
        count = len(self.pending)
        steps = [one for one in jax.device_get(self.pending) if one.pop("applied")]
        if not steps:
            return
        means = {name: float(np.mean([one[name] for one in steps])) for name in steps[0]}
        seconds = time.monotonic() - self.begin
        means["learning_rate"] = float(self.rate(done - 1))
        means["seconds_per_step"] = seconds / count
        means["waiting_for_data"] = self.waited / max(seconds, 1e-9)
        self.log.write("train", done, means)
        self.bar.set_postfix(loss=f"{means['loss']:.4f}", badpix=f"{means['badpix']:.1f}%")
        if self.bar.disable:
            self.say(
                f"step {done} of {self.bar.total}: loss {means['loss']:.4f}, badpix "
                f"{means['badpix']:.1f}%, {means['seconds_per_step']:.2f} s per step"
            )
        self.restart()


@contextmanager
def _requests_to_stop() -> Iterator[list[int]]:
    """Yield the list of received SIGINT and SIGTERM; a second signal raises KeyboardInterrupt."""
    received: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield received
        return

    def note(number, frame):
        if received:
            raise KeyboardInterrupt
        received.append(number)

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
