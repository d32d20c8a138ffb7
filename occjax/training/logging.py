"""The log of a training: one JSON object a line, and TensorBoard where it is installed."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from occjax.io.atomic import atomic_path

LOG_FILE = "log.jsonl"
TENSORBOARD = "tensorboard"


class Log:
    """Writes ``log.jsonl`` and, if tensorboardX is installed, the folder ``tensorboard``.

    Lines have ``kind`` (``"train"`` or ``"validation"``), ``step`` and numbers by name. Numbers
    that are not finite become null, which JSON knows.

    Attributes:
        path: The file.
    """

    def __init__(self, folder: Path, *, first_step: int = 0) -> None:
        """Open the log, forgetting what was logged after the checkpoint that is gone on from.

        Args:
            folder: Of the training.
            first_step: Number of steps done.
        """
        self.path = folder / LOG_FILE
        kept = [entry for entry in read_log(folder) if entry["step"] <= first_step]
        with atomic_path(self.path) as temporary:
            temporary.write_text("".join(_line(entry) for entry in kept), encoding="utf-8")
        self._file = self.path.open("a", encoding="utf-8")
        self._board = _tensorboard(folder / TENSORBOARD, first_step)

    def __enter__(self) -> Log:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()
        if self._board is not None:
            self._board.close()

    def write(self, kind: str, step: int, values: Mapping[str, float]) -> None:
        """Log numbers of a step.

        Args:
            kind: What they are about.
            step: Number of steps done.
            values: Numbers by name.
        """
        numbers = {name: float(value) for name, value in values.items()}
        self._file.write(_line({"kind": kind, "step": step, **numbers}))
        self._file.flush()
        if self._board is not None:
            for name, value in numbers.items():
                self._board.add_scalar(f"{kind}/{name}", value, step)


def read_log(folder: str | Path) -> list[dict[str, Any]]:
    """Lines of a training's log.

    A last line that a crash left incomplete is passed over.

    Args:
        folder: Of the training.

    Returns:
        The entries, oldest first; none if there is no log.
    """
    path = Path(folder) / LOG_FILE
    entries = []
    for line in path.read_text(encoding="utf-8").splitlines() if path.is_file() else ():
        try:
            entries.append(json.loads(line))
        except ValueError:
            continue
    return entries


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
