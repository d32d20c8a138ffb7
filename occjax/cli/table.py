"""Summary table of the scenes of one command: ``scenes.csv`` and ``scenes.json``."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from occjax.io.atomic import atomic_path

COLUMNS = (
    *("scene", "state", "source", "model", "weights", "rows", "columns", "height", "width"),
    *("range_minimum", "range_maximum", "mse_x100", "badpix_0.07", "badpix_0.03", "badpix_0.01"),
    *("q25_x100", "seconds", "notes", "error"),
)
"""Columns of the table. ``scene`` is the folder of the results; ``seconds`` is the sum of all
phases except writing; scores are empty without a ground truth."""

Row = dict[str, Any]


def row(
    scene: str, source: Path, summary: Mapping[str, Any] | None, error: str | None = None
) -> Row:
    """Return the row of a scene.

    Args:
        scene: Name of its folder in the folder of the results.
        source: Where it is read from.
        summary: Content of ``summary.json`` if the scene is complete.
        error: Why it failed, if it did.

    Example:
        >>> found = row("boxes", Path("hci/boxes"), None, "no images")
        >>> found["state"], found["seconds"]
        ('failed', None)
    """
    entry: Row = dict.fromkeys(COLUMNS)
    state = "failed" if error is not None else "missing" if summary is None else "complete"
    entry |= {"scene": scene, "state": state, "source": str(source), "error": error}
    if summary is not None and error is None:
        scores = summary["metrics"] or {}
        entry |= {name: summary[name] for name in ("model", "weights", "notes")}
        entry["rows"], entry["columns"] = summary["grid"]
        entry["height"], entry["width"] = summary["image_size"]
        entry["range_minimum"], entry["range_maximum"] = summary["searched_disparity_range"]
        entry |= {name: scores.get(name) for name in ("mse_x100", "q25_x100")}
        for threshold, percentage in scores.get("badpix", {}).items():
            if f"badpix_{threshold}" in entry:
                entry[f"badpix_{threshold}"] = percentage
        entry["seconds"] = round(sum(summary["seconds"].values()), 3)
    return entry


def stored_failures(folder: Path) -> dict[str, str]:
    """Return the reasons of the failures in an existing table, by the name of the scene.

    Example:
        >>> stored_failures(Path("nowhere"))
        {}
    """
    try:
        rows = json.loads((folder / "scenes.json").read_text(encoding="utf-8"))
        return {entry["scene"]: entry["error"] for entry in rows if entry["state"] == "failed"}
    except (OSError, ValueError, KeyError, TypeError):
        return {}  # there is none, or it is damaged and will be replaced


def write_table(folder: Path, rows: Callable[[], list[Row]]) -> list[Row]:
    """Write the table as CSV and JSON.

    Several processes that share the scenes may end at the same time. The last one that writes has
    to know what all of them have written, so the rows are collected again after writing.

    Args:
        folder: Folder of the results.
        rows: Collects the rows.

    Returns:
        The rows that were written.

    Raises:
        InputError: If the files cannot be written.
    """
    written: list[Row] | None = None
    while (current := rows()) != written:
        with atomic_path(folder / "scenes.json") as temporary:
            temporary.write_text(json.dumps(current, indent=1) + "\n", encoding="utf-8")
        with (
            atomic_path(folder / "scenes.csv") as temporary,
            temporary.open("w", encoding="utf-8", newline="") as file,
        ):
            writer = csv.DictWriter(file, COLUMNS)
            writer.writeheader()
            for entry in current:
                writer.writerow(entry | {"notes": "; ".join(entry["notes"] or ())})
        written = current
    return current
