"""The log of a training: one JSON object per line, and TensorBoard if it is installed."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from occjax.io.atomic import CannotWriteError, atomic_path
from occjax.io.files import decoding

LOG_FILE = "log.jsonl"
"""Name of the log in the training folder."""


class Log:
    """Writer of ``log.jsonl`` and, if tensorboardX is installed, of the folder ``tensorboard``.

    Each line has ``kind``, ``step`` and numbers by name. The kind is ``"train"``, ``"validation"``
    or ``"nonfinite"``, a step whose loss or gradient was not finite. Numbers that are not finite
    become null, since JSON has no such numbers.
    """

    def __init__(self, folder: Path, *, finished_steps: int = 0, enabled: bool = True) -> None:
        """Open the log, and remove the lines after the checkpoint from which training resumes.

        Args:
            folder: Training folder.
            finished_steps: Number of steps that were finished before; later lines are removed.
            enabled: False in all processes but the first, which then write nothing.
        """
        self._path, self._file, self._tensorboard = folder / LOG_FILE, None, None
        if not enabled:
            return
        kept = [entry for entry in read_log(folder) if entry["step"] <= finished_steps]
        with atomic_path(self._path) as temporary:
            temporary.write_text("".join(_line(entry) for entry in kept), encoding="utf-8")
        # Unbuffered: a full disk is then reported with the line, not at the end of the training.
        self._file = self._path.open("ab", buffering=0)
        with suppress(ImportError):  # tensorboardX is optional
            self._tensorboard = _TensorBoardWriter(folder / "tensorboard", finished_steps)

    def __enter__(self) -> Log:
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            self._file.close()
        if self._tensorboard is not None:
            self._tensorboard.close()

    def write(self, kind: str, step: int, values: Mapping[str, float]) -> None:
        """Write one line.

        Args:
            kind: ``"train"``, ``"validation"`` or ``"nonfinite"``.
            step: Number of finished steps.
            values: Numbers by name.
        """
        if self._file is None:
            return
        numbers = {name: float(value) for name, value in values.items()}
        try:
            self._file.write(_line({"kind": kind, "step": step, **numbers}).encode())
            if self._tensorboard is not None:
                self._tensorboard.write(kind, step, numbers)
        except OSError as error:
            raise CannotWriteError(self._path, (error.strerror or str(error)).lower()) from error


def read_log(folder: str | Path) -> list[dict[str, Any]]:
    """Read the log of a training.

    Lines that a crash left incomplete or damaged are skipped.

    Args:
        folder: Training folder.

    Returns:
        The entries, oldest first; none if there is no log.

    Example:
        >>> import tempfile
        >>> folder = Path(tempfile.mkdtemp())
        >>> _ = (folder / "log.jsonl").write_text('{"kind": "train", "step": 50, "loss": 0.3}')
        >>> read_log(folder)
        [{'kind': 'train', 'step': 50, 'loss': 0.3}]
    """
    path = Path(folder) / LOG_FILE
    if not path.is_file() or path.stat().st_size == 0:
        return []
    with decoding(path, "the log of a training", remedy="remove it") as file:
        lines = file.read().decode(errors="replace").splitlines()
    entries = []
    for line in lines:
        try:
            entry = json.loads(line)
        except (ValueError, RecursionError):
            continue
        if _is_entry(entry):
            entries.append(entry)
    return entries


def _is_entry(entry: Any) -> bool:
    """Return whether a value from JSON is a line of the log: kind, step and numbers."""
    if not isinstance(entry, dict) or not isinstance(entry.get("step"), int):
        return False
    numbers = (value for name, value in entry.items() if name != "kind" and value is not None)
    return isinstance(entry.get("kind"), str) and all(isinstance(n, int | float) for n in numbers)


def _line(entry: Mapping[str, Any]) -> str:
    """Return an entry as one line of JSON, with null for numbers that are not finite."""

    def finite(value):
        return None if isinstance(value, float) and not math.isfinite(value) else value

    return json.dumps({name: finite(value) for name, value in entry.items()}) + "\n"


class _TensorBoardWriter:
    """Writer of an event file for TensorBoard.

    Events are written in the calling thread. ``tensorboardX.SummaryWriter`` uses another thread; if
    the disk is full, that thread ends and training hangs.
    """

    def __init__(self, folder: Path, finished_steps: int) -> None:
        from tensorboardX.event_file_writer import EventsWriter
        from tensorboardX.proto.event_pb2 import Event, SessionLog
        from tensorboardX.summary import scalar

        folder.mkdir(exist_ok=True)
        self._event, self._scalar = Event, scalar
        self._file = EventsWriter(str(folder / "events"))
        if finished_steps:
            # TensorBoard then hides the later steps that an interrupted run has written.
            start = SessionLog(status=SessionLog.START)
            self._file.write_event(Event(step=finished_steps + 1, session_log=start))

    def write(self, kind: str, step: int, numbers: Mapping[str, float]) -> None:
        finite = {name: value for name, value in numbers.items() if math.isfinite(value)}
        for name, value in finite.items():
            summary = self._scalar(f"{kind}/{name}", value)
            self._file.write_event(self._event(wall_time=time.time(), step=step, summary=summary))
        self._file.flush()

    def close(self) -> None:
        with suppress(OSError):  # every line is written already
            self._file.close()
