"""The log of a training: one JSON object per line, and TensorBoard if it is installed."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from occjax.io.atomic import atomic_path
from occjax.io.files import decoding

LOG_FILE = "log.jsonl"
TENSORBOARD = "tensorboard"


class Log:
    """Writer of ``log.jsonl`` and, if tensorboardX is installed, of the folder ``tensorboard``.

    Each line has ``kind`` (``"train"`` or ``"validation"``), ``step`` and numbers by name. Numbers
    that are not finite become null, since JSON has no such numbers.
    """

    def __init__(self, folder: Path, *, first_step: int = 0) -> None:
        """Open the log, and remove the lines after the checkpoint from which training resumes.

        Args:
            folder: Training folder.
            first_step: Number of finished steps.
        """
        path = folder / LOG_FILE
        kept = [entry for entry in read_log(folder) if entry["step"] <= first_step]
        with atomic_path(path) as temporary:
            temporary.write_text("".join(_line(entry) for entry in kept), encoding="utf-8")
        self._file = path.open("a", encoding="utf-8")
        self._board = _tensorboard(folder / TENSORBOARD, first_step)

    def __enter__(self) -> Log:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()
        if self._board is not None:
            self._board.close()

    def write(self, kind: str, step: int, values: Mapping[str, float]) -> None:
        """Write one line.

        Args:
            kind: ``"train"`` or ``"validation"``.
            step: Number of finished steps.
            values: Numbers by name.
        """
        numbers = {name: float(value) for name, value in values.items()}
        self._file.write(_line({"kind": kind, "step": step, **numbers}))
        self._file.flush()
        if self._board is not None:
            for name, value in numbers.items():
                self._board.add_scalar(f"{kind}/{name}", value, step)


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
    def finite(value):
        return None if isinstance(value, float) and not math.isfinite(value) else value

    return json.dumps({name: finite(value) for name, value in entry.items()}) + "\n"


def _tensorboard(folder: Path, first_step: int) -> Any:
    try:
        from tensorboardX import SummaryWriter
    except ImportError:
        return None
    return SummaryWriter(str(folder), purge_step=first_step + 1 if first_step else None)
