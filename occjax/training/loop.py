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

from occjax.errors import InputError
from occjax.io.atomic import check_writable
from occjax.lightfield import LightField
from occjax.models import load_weights, save_weights
from occjax.models.bundled import find_weights
from occjax.training.checkpoints import Checkpoints, open_training_folder
from occjax.training.config import RunConfig, TrainConfig
from occjax.training.logging import Log
from occjax.training.optimiser import learning_rate
from occjax.training.prefetch import prefetch
from occjax.training.step import (
    Batch,
    BatchSource,
    TrainState,
    init_state,
    shardings,
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
        finished: Whether all steps are done; otherwise the time was up.
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
    initial_weights: str | Path | None = None,
    say: Callable[[str], None] = tqdm.write,
) -> Trained:
    """Train a model, or resume its training.

    The folder gets ``config.json``; ``log.jsonl`` and, with tensorboardX, ``tensorboard``;
    ``checkpoints`` of the whole state; with every checkpoint ``weights.safetensors``; after each
    validation ``pictures``, and ``best.safetensors`` if it is the best so far. Both weights files
    contain the exponential moving average of the weights, for ``occjax estimate --weights``.

    If the folder already contains a checkpoint of this run, training resumes from it. The result is
    that of an uninterrupted training. On an interrupt (Ctrl-C) or a request to terminate, the
    current step is finished and saved.

    Args:
        config: Settings of the training.
        source: Source of the batches.
        folder: Folder of the training.
        run: Settings of this process.
        validation: Light fields with ground truth to validate on, with different names.
        data: Description of the source, which must be the same when training is resumed.
        initial_weights: Initial weights: a file, or a name that ``occjax weights list`` prints;
            random weights by default. They are validated before the first step.
        say: Function that is called with lines for the user.

    Returns:
        The final state, whether training is finished, and the file of the weights.

    Raises:
        InputError: If the folder contains something else, if the data or the weights do not fit the
            model, or if the loss is no longer finite.
        KeyboardInterrupt: If interrupted, after the state is saved.

    Example:
        ::

            from occjax.training import RunConfig, make_source, recipe, train

            tiny = recipe("tiny")
            source = make_source(tiny.data, tiny.train.network)
            train(tiny.train, source, "runs/tiny", run=RunConfig(minutes=5))
    """
    folder, run = Path(folder), run or RunConfig()
    check_writable(folder)
    check_scenes(validation, config.network)
    initial_file = None if initial_weights is None else find_weights(initial_weights)
    say(f"{folder}: preparing the first batch")
    first = source(0)
    batch_sharding, state_sharding = shardings(first.disparity.shape[0])
    described = {"initial_weights": initial_weights and str(initial_weights), "data": data}
    open_training_folder(folder, {**dataclasses.asdict(config), **described})

    with Checkpoints(folder, keep=run.keep) as checkpoints:
        if checkpoints.latest_step is not None:
            like = jax.eval_shape(partial(init_state, config), first)
            placed = jax.tree.map(lambda leaf: leaf.update(sharding=state_sharding), like)
            state = checkpoints.restore(placed)
            say(f"{folder}: resuming after step {checkpoints.latest_step}")
        else:
            state = _first_state(config, first, initial_file)
            state = jax.device_put(state, state_sharding)
        start = int(state.step)
        with (
            Log(folder, first_step=start) as log,
            _interruption() as interrupted,
            closing(
                prefetch(source, start, config.steps, ahead=run.prefetch, sharding=batch_sharding)
            ) as batches,
            tqdm(total=config.steps, initial=start, unit="step", disable=None) as bar,
        ):
            keeper = _Keeper(config, run, folder, validation, checkpoints, log, say)
            meter = _Meter(config, log, bar, say)
            if start == 0 and initial_file is not None and validation:
                keeper.validate(state, 0)
            deadline = math.inf if run.minutes is None else time.monotonic() + 60.0 * run.minutes
            for step, batch in meter.waiting(batches):
                if step == start:
                    state, metrics = _first_step(state, batch, config, folder, say)
                else:
                    state, metrics = train_step(state, batch, config=config)
                done = step + 1
                meter.add(metrics)
                stopping = interrupted.is_set() or time.monotonic() >= deadline
                last = done == config.steps
                keeping = last or stopping or keeper.is_due(done)
                if keeping or done % run.log_every == 0:
                    meter.report(done)
                if keeping:
                    keeper.keep(state, done, validating=last or not stopping)
                    meter.restart()
                if stopping:
                    break
            if interrupted.is_set():
                say(f"{folder}: interrupted after step {int(state.step)}; start again to resume")
                raise KeyboardInterrupt
    return Trained(state, int(state.step) >= config.steps, folder / WEIGHTS_FILE)


def _first_state(config: TrainConfig, batch: Batch, weights: str | Path | None) -> TrainState:
    if weights is None:
        return init_state(config, batch)
    return state_from_variables(load_weights(weights, config.network)[0], config)


def _first_step(
    state: TrainState, batch: Batch, config: TrainConfig, folder: Path, say: Callable[[str], None]
) -> tuple[TrainState, dict[str, jax.Array]]:
    """Compile and start the first step, and tell the user, who sees no progress meanwhile."""
    say(f"{folder}: compiling the training step; on a CPU this takes one to several minutes")
    begin = time.monotonic()
    result = train_step(state, batch, config=config)
    say(f"{folder}: compiled in {time.monotonic() - begin:.0f} s")
    return result


class _Keeper:
    """Validation and saving, when they are due."""

    def __init__(self, config, run, folder, validation, checkpoints, log, say) -> None:
        self.config, self.run, self.folder = config, run, folder
        self.validation, self.checkpoints, self.log, self.say = validation, checkpoints, log, say
        self.saved = time.monotonic()

    def is_due(self, done: int) -> bool:
        """Return whether the state after this step is to be saved."""
        every = self.run.checkpoint_steps
        late = time.monotonic() - self.saved >= 60.0 * self.run.checkpoint_minutes
        return late or self._validates(done) or (every is not None and done % every == 0)

    def keep(self, state: TrainState, done: int, *, validating: bool) -> None:
        """Validate if it is due, and save."""
        if done == self.checkpoints.latest_step:
            return
        score = None
        if validating and self._validates(done):
            scores = self.validate(state, done)
            score, best = scores[SELECTION_METRIC], self.checkpoints.best_score
            if best is None or score < best:
                self._save_weights(state, BEST_FILE, done)
        self.checkpoints.save(state, score=score)
        self._save_weights(state, WEIGHTS_FILE, done)
        self.saved = time.monotonic()

    def _validates(self, done: int) -> bool:
        at_end = done == self.config.steps
        return bool(self.validation) and (done % self.run.validate_every == 0 or at_end)

    def validate(self, state: TrainState, done: int) -> dict[str, float]:
        """Validate, and write the scores to the log."""
        scores = validate(
            jax.device_get(state.ema),
            self.validation,
            self.config.network,
            pictures=self.folder / PICTURES,
        )
        self.log.write("validation", done, scores)
        means = ", ".join(
            f"{name} {value:.3f}" for name, value in scores.items() if "/" not in name
        )
        self.say(f"step {done}: {means}")
        return scores

    def _save_weights(self, state: TrainState, name: str, done: int) -> None:
        variables = {kind: jax.device_get(tree) for kind, tree in state.ema.items() if tree}
        save_weights(self.folder / name, variables, self.config.network, {"step": str(done)})


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
        if self.pending:  # wait for the step before: at most two batches are in use
            jax.block_until_ready(self.pending[-1])
        self.pending.append(metrics)
        self.bar.update()

    def report(self, done: int) -> None:
        """Log the means since the last report.

        Raises:
            InputError: If the loss is not finite.
        """
        if not self.pending:
            return
        steps = jax.device_get(self.pending)
        means = {name: float(np.mean([one[name] for one in steps])) for name in steps[0]}
        seconds = time.monotonic() - self.begin
        means["learning_rate"] = float(self.rate(done - 1))
        means["seconds_per_step"] = seconds / len(steps)
        means["waiting_for_data"] = self.waited / max(seconds, 1e-9)
        self.log.write("train", done, means)
        self.bar.set_postfix(loss=f"{means['loss']:.4f}", badpix=f"{means['badpix']:.1f}%")
        if self.bar.disable:
            self.say(
                f"step {done} of {self.bar.total}: loss {means['loss']:.4f}, badpix "
                f"{means['badpix']:.1f}%, {means['seconds_per_step']:.2f} s per step"
            )
        self.restart()
        if not math.isfinite(means["loss"]):
            raise InputError(
                f"the loss is no longer finite at step {done}; train in another folder with a "
                "lower optimiser.peak_rate, a longer optimiser.warm_up or with optimiser.clip"
            )


@contextmanager
def _interruption() -> Iterator[threading.Event]:
    """Give an event that SIGINT or SIGTERM sets; a second signal interrupts at once."""
    event = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield event
        return

    def note(number, frame):
        if event.is_set():
            raise KeyboardInterrupt
        event.set()

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield event
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
