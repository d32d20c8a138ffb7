"""Scenes for the viewer, from folders of results or estimates in memory, and how to open it."""

from __future__ import annotations

import importlib.util
import inspect
import os
import sys
import webbrowser
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from occjax.data.bundled_sample import sample
from occjax.errors import InputError, warn
from occjax.estimators.driver import with_report
from occjax.estimators.protocol import Estimate
from occjax.io.loading import load
from occjax.io.maps import SUMMARY, map_of_results, read_map
from occjax.layout import registered
from occjax.lightfield import LightField, view_name, whole_grid
from occjax.results.summary import read_summary, stored_calibration
from occjax.viewer.config import LOOPBACK, ViewerConfig
from occjax.viewer.scene import ViewedResult, ViewedScene

if TYPE_CHECKING:
    from occjax.viewer.server import Viewer


def open_viewer(
    scene: ViewedScene,
    *,
    host: str = LOOPBACK,
    port: int | None = None,
    open_browser: bool = True,
    config: ViewerConfig | None = None,
) -> Viewer:
    """Open a page in the browser that shows a scene and its estimates.

    Args:
        scene: What is shown.
        host: Address to listen at; by default only this computer can reach the page.
        port: Port to listen at; None for a free one.
        open_browser: Whether to open the page in the user's browser, if there is a display.
        config: Settings.

    Returns:
        The viewer. It runs in the background until it is closed. ``wait()`` returns when it is
        closed; a ``with`` block closes it at its end.

    Raises:
        InputError: If viser is missing or the port is taken.

    Example:
        >>> import numpy as np
        >>> scene = ViewedScene((ViewedResult("plane", np.zeros((8, 8))),))
        >>> with open_viewer(scene, open_browser=False) as viewer:
        ...     viewer.url.startswith("http://127.0.0.1:")
        True
    """
    check_viser()
    from occjax.viewer.server import Viewer

    viewer = Viewer(scene, host=host, port=port, config=config)
    if open_browser and _has_display():
        webbrowser.open(viewer.url)
    return viewer


def check_viser() -> None:
    """Raise an :class:`InputError` if viser, which makes the page, is missing."""
    if importlib.util.find_spec("viser") is None:
        raise InputError("the viewer needs viser; run pip install 'occjax[view]'")


def read_scene(folders: Sequence[str | Path], light_field: LightField | None = None) -> ViewedScene:
    """Read results of one scene, and its views if they are found.

    Args:
        folders: Folders of results, or disparity maps. In place of a folder of results, its parent
            can be given if it contains no other one.
        light_field: The views. By default they are read from where the results say that they came
            from, if they are still there.

    Returns:
        The scene.

    Raises:
        InputError: If a result cannot be read, or results and views do not belong together.

    Warns:
        UserWarning: If there are no views to show.

    Example:
        >>> import tempfile, numpy as np
        >>> path = Path(tempfile.mkdtemp()) / "disparity.npy"
        >>> np.save(path, np.zeros((4, 5), np.float32))
        >>> light_field = LightField(np.zeros((1, 3, 4, 5), np.uint8))
        >>> read_scene([path], light_field).image_size
        (4, 5)
    """
    paths = [_result_folder(Path(folder)) for folder in folders]
    if not paths:
        raise InputError("pass at least one folder that occjax estimate wrote")
    summaries = [
        read_summary(path / SUMMARY) if (path / SUMMARY).is_file() else None for path in paths
    ]
    results = tuple(
        ViewedResult(name, read_map(_map_of(path), quantity="disparity").values)
        if summary is None
        else _viewed(name, Estimate.load(path))
        for name, path, summary in zip(short_names(paths), paths, summaries, strict=True)
    )
    first = summaries[0] or {}
    for path, summary in zip(paths, summaries, strict=True):
        if summary is not None and summary.get("view") != first.get("view"):
            raise InputError(
                f"{path}: is of the {view_name(summary.get('view'))}, but {paths[0]}: is of the "
                f"{view_name(first.get('view'))}; show results of one view"
            )
    if light_field is None:
        try:
            light_field = _views_of(first)
        except InputError as error:
            reason = f"the page has no views: {error}; --scene SCENE and its options name them"
            warn(reason)
    if light_field is not None:
        light_field = _around(light_field, first.get("view"))
    name = first.get("scene") or (light_field.name if light_field else paths[0].name)
    return ViewedScene(results, light_field, name, stored_calibration(first) if first else None)


def scene_of(estimates: Sequence[Estimate], light_field: LightField | None = None) -> ViewedScene:
    """Return the scene of estimates in memory.

    Args:
        estimates: Estimates of one light field.
        light_field: The light field; by default that of the first estimate.

    Returns:
        The scene.

    Raises:
        InputError: If the maps have different sizes.

    Example:
        >>> flat = np.zeros((4, 5), np.float32)
        >>> estimate = Estimate(flat, flat, flat, (-1.0, 1.0), "photometric")
        >>> [result.name for result in scene_of((estimate, estimate)).results]
        ['photometric (1)', 'photometric (2)']
    """
    names = _distinct([estimate.weights or estimate.model for estimate in estimates])
    results = tuple(_viewed(*named) for named in zip(names, estimates, strict=True))
    light_field = light_field or estimates[0].light_field
    if light_field is None:
        return ViewedScene(results)
    estimated = estimates[0].light_field
    light_field = _around(light_field, None if estimated is None else estimated.view)
    return ViewedScene(results, light_field, light_field.name)


def _viewed(name: str, estimate: Estimate) -> ViewedResult:
    known = np.isfinite(estimate.confidence).any()
    return ViewedResult(
        name,
        estimate.disparity,
        estimate.confidence if known else None,
        estimate.occlusion,
        estimate.disparity_range,
    )


def short_names(paths: Sequence[Path]) -> list[str]:
    """Return the parts of paths in which they differ.

    Example:
        >>> short_names([Path("a/photometric/sample"), Path("a/proposal/sample")])
        ['photometric', 'proposal']
    """
    parts = [path.resolve().parts for path in paths]
    while len({own[0] for own in parts}) == 1 and min(map(len, parts)) > 1:
        parts = [own[1:] for own in parts]
    while len({own[-1] for own in parts}) == 1 and min(map(len, parts)) > 1:
        parts = [own[:-1] for own in parts]
    return _distinct([str(Path(*own)) for own in parts])


def _distinct(names: list[str]) -> list[str]:
    """Return names with a number after those that occur more than once."""
    return [
        name if names.count(name) == 1 else f"{name} ({number})"
        for number, name in enumerate(names, 1)
    ]


def _result_folder(path: Path) -> Path:
    """Return the path of a map or a folder of results, or the only folder of results in it."""
    if not path.exists():
        raise InputError(f"{path}: does not exist; pass a folder that occjax estimate wrote")
    if not path.is_dir() or any((path / f"disparity.{kind}").is_file() for kind in ("npy", "pfm")):
        return path
    inside = sorted(file.parent for file in path.glob("*/disparity.[np][pf][ym]"))
    inside = list(dict.fromkeys(inside))
    if len(inside) == 1:
        return inside[0]
    return map_of_results(path).parent  # says what the folder contains


def _map_of(path: Path) -> Path:
    """Return the map in a folder without a summary."""
    array = path / "disparity.npy"
    return array if array.is_file() else path


def _around(light_field: LightField, view: Sequence[int] | None) -> LightField:
    """Return the views, where the measurement found them, around the view that was estimated."""
    if view is not None and light_field.view is None:
        v, u = view
        light_field = with_report(light_field).around((v, u))
    return registered(light_field)[0]


def _views_of(summary: dict[str, Any]) -> LightField:
    """Read the views that were estimated, from the stored path and with the stored options."""
    source = summary.get("source")
    if source is not None:
        light_field = load(source, **_reading_options(summary))
    elif summary.get("scene") == "sample":
        light_field = sample()
    else:
        raise InputError("the results do not say where they are")
    if light_field.image_size != tuple(summary["image_size"]):
        raise InputError(f"those of {light_field.name} have another size")
    # The estimate used only these views.
    return light_field.central(*whole_grid(summary["grid"], summary.get("view")))


def _reading_options(summary: dict[str, Any]) -> dict[str, Any]:
    """Return the options with which ``occjax estimate`` read the views, as far as known."""
    options = (summary.get("settings") or {}).get("options", {})
    accepted = inspect.signature(load).parameters
    return {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in options.items()
        if name in accepted
    }


def _has_display() -> bool:
    """Return whether a browser with graphics can open on this computer."""
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
