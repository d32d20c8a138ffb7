"""The page of a report, made from a template."""

from __future__ import annotations

import base64
import importlib.util
from collections.abc import Callable, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import Colormap

from occjax.errors import InputError
from occjax.evaluation.metrics import BAD_PIXEL_THRESHOLD
from occjax.io.atomic import atomic_path
from occjax.lightfield import whole_grid
from occjax.report.scenes import ReportScene
from occjax.viz.colour import NO_VALUE_COLOUR, confidence_colours, disparity_colours
from occjax.viz.pictures import error_scale


def check_report() -> None:
    """Verify that the extra ``report`` is installed.

    Raises:
        InputError: If it is not.
    """
    if importlib.util.find_spec("jinja2") is None:
        raise InputError("a report needs Jinja2; run pip install 'occjax[report]'")


def write_report(path: str | Path, scenes: Sequence[ReportScene]) -> None:
    """Write a report as one HTML file, atomically.

    Args:
        path: File to write; an existing file is replaced.
        scenes: Scenes to show, from :mod:`occjax.report.scenes`, at least one.

    Raises:
        InputError: If there is no scene, the extra ``report`` is missing, or the file cannot be
            written.
    """
    check_report()
    import jinja2

    if not scenes:
        raise InputError(f"{path}: there is no scene to report on; pass folders of results")
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("occjax.report", "page_files"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters["number"] = _number
    files = resources.files("occjax.report") / "page_files"
    text = environment.get_template("report.html").render(
        scenes=scenes,
        style=(files / "report.css").read_text("utf-8"),
        script=(files / "report.js").read_text("utf-8"),
        colours=_colours(),
        columns=[column for column in COLUMNS if any(column[1](s.summary) for s in scenes)],
        whole_grid=_whole_grid,
    )
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _score(name: str) -> Callable[[dict[str, Any]], Any]:
    return lambda summary: (summary.get("metrics") or {}).get(name)


def _whole_grid(summary: dict[str, Any]) -> tuple[int, int]:
    return whole_grid(summary["grid"], summary.get("view"))


def _badpix(summary: dict[str, Any]) -> float | None:
    return (_score("badpix")(summary) or {}).get(f"{BAD_PIXEL_THRESHOLD:g}")


COLUMNS: tuple[tuple[str, Callable[[dict[str, Any]], Any]], ...] = (
    ("model", lambda summary: summary["model"]),
    ("views", lambda summary: "x".join(map(str, _whole_grid(summary)))),
    ("pixels", lambda summary: "x".join(map(str, summary["image_size"]))),
    (f"BadPix {BAD_PIXEL_THRESHOLD:g} [%]", _badpix),
    ("MSE x100", _score("mse_x100")),
    ("Q25 x100", _score("q25_x100")),
    ("seconds", lambda summary: sum(summary["seconds"].values()) or None),
    ("memory [MB]", lambda summary: summary.get("peak_memory_mb")),
    ("notes", lambda summary: len(summary["notes"])),
)
"""Columns of the table of all scenes: heading and value; a column without any value is left out."""


def _number(value: Any) -> str:
    """Return a number with four digits, a word as it is, and nothing for None."""
    if value is None:
        return ""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _colours() -> dict[str, Any]:
    """Return the colours of each map as bytes in text, and the range of the error."""
    norm, error, ticks = error_scale()
    maps = {"disparity": disparity_colours(), "confidence": confidence_colours(), "error": error}
    return {
        **{name: _table(colours) for name, colours in maps.items()},
        "error_limits": [norm.vmin, norm.vmax],
        "error_ticks": ticks,
        "none": NO_VALUE_COLOUR,
    }


def _table(colours: Colormap) -> str:
    """Return ``3 N`` bytes: red, green and blue from the lowest to the highest value."""
    table = colours(np.linspace(0.0, 1.0, colours.N), bytes=True)[:, :3]
    return base64.b64encode(table.tobytes()).decode("ascii")
