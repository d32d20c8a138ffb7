"""The commands ``evaluate`` and ``check``."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import OmitArgPrefixes, Positional, arg

from occjax.cli.options import ViewOrderOptions, numbers, option
from occjax.errors import InputError
from occjax.evaluation.metrics import BORDER, THRESHOLDS
from occjax.layout.orientation import Orientation, declared_orientation

if TYPE_CHECKING:
    from occjax.layout import ViewOrderReport


def evaluate_command(
    estimate: Annotated[
        Path, Positional, arg(help="Disparity map (PFM, NPY or PNG) or folder of results.")
    ],
    ground_truth: Annotated[
        Path,
        Positional,
        arg(
            help="True disparity (PFM, NPY or PNG), folder of the scene (with "
            "gt_disp_lowres.pfm), or HDF5 file of the scene. A scene folder may also be the first "
            "argument."
        ),
    ],
    metrics: Annotated[
        str | None,
        option(
            "Measures of the HCI benchmark by region of the scene: all, or a comma-separated list "
            "such as discontinuities,bumpiness_planes. The scene folder must contain the masks.",
            "all|NAMES",
        ),
    ] = None,
    thresholds: Annotated[
        tuple[float, ...] | None,
        numbers(float, meaning="one or more numbers", any_count=True),
        option(
            "BadPix thresholds, in pixels per view step; "
            f"{', '.join(f'{threshold:g}' for threshold in THRESHOLDS)} by default. With --metrics "
            "NAMES, write the threshold into the name: badpix_0.07.",
            "FLOAT...",
        ),
    ] = None,
    border: Annotated[
        int | None,
        option(
            f"Width of the border that is ignored, in pixels. By default {BORDER}; without "
            "--metrics at most an eighth of the shorter side.",
            "INT",
        ),
    ] = None,
    json_: Annotated[bool, arg(name="json", help="Print JSON.")] = False,
) -> int:
    """Compare a disparity map with the ground truth, as a whole or by region of the scene."""
    # SciPy and JAX are imported here, so that a wrong argument is reported without them.
    from occjax.evaluation import Metrics, SceneScores, evaluate_files, evaluate_scene, is_scene

    if is_scene(estimate) and not is_scene(ground_truth):
        estimate, ground_truth = ground_truth, estimate
    if metrics is not None and not is_scene(ground_truth):
        raise InputError(
            f"neither {estimate} nor {ground_truth} is the folder of a scene (with "
            "gt_disp_lowres.pfm); --metrics needs one"
        )
    names = None if metrics is None else _names(metrics)
    if names is not None and thresholds is not None:
        raise InputError(
            "--thresholds cannot be combined with named measures; add "
            f"{','.join(f'badpix_{threshold:g}' for threshold in thresholds)} to --metrics instead"
        )
    thresholds = THRESHOLDS if thresholds is None else thresholds
    scores: Metrics | SceneScores
    if metrics is None:
        scores = evaluate_files(estimate, ground_truth, thresholds=thresholds, border=border)
    else:
        scores = evaluate_scene(
            ground_truth,
            estimate,
            names=names,
            thresholds=thresholds,
            border=BORDER if border is None else border,
        )
    print(json.dumps(scores.as_dict(), indent=2) if json_ else scores.table())
    return 0


def _names(metrics: str) -> tuple[str, ...] | None:
    """Return the names in a comma-separated list; None stands for all measures."""
    names = tuple(name.strip() for name in metrics.split(",") if name.strip())
    if not names:
        raise InputError("--metrics names no measure; pass all or a comma-separated list")
    return None if names == ("all",) else names


def check_command(
    path: Annotated[
        Path, Positional, arg(help="Folder of views, image of all views, or array file.")
    ],
    view_order: OmitArgPrefixes[ViewOrderOptions] = ViewOrderOptions(),
) -> int:
    """Measure the view order and the disparity range of the scene."""
    from occjax.io import ViewOrderWarning
    from occjax.layout import check

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ViewOrderWarning)  # the report says it
        light_field = view_order.load(path)
    v, u = light_field.grid
    h, w = light_field.image_size
    print(f"{light_field.name}: {v}x{u} views of {h}x{w} pixels (rows x columns)")
    declared = declared_orientation(view_order.order, view_order.flip)
    print(format_report(check(light_field), declared))
    return 0


def format_report(report: ViewOrderReport, declared: Orientation) -> str:
    """Format the consistency of the eight view orders, the best one and the disparity range."""
    lines = ["", "  mean grey difference from the centre view at the best disparity of each pixel:"]
    for name, score in sorted(report.scores.items(), key=lambda item: item[1]):
        lines.append(f"    {255 * score:7.3f} / 255  {name}{' *' * (name == report.best.name)}")
    lines.append("")
    correct, notes = declared.then(report.best), list(report.position_notes)
    if report.disorder in ("serpentine", "grid"):
        lines.append(f"view order: {notes.pop(0)}")
    elif report.clearly_worse:
        flip = f" --flip {correct.flip}" if correct.flip else ""
        lines.append(f"view order: {report.best.name}; pass --order {correct.order}{flip}")
    elif report.conclusive:
        lines.append("view order: as declared")
    elif report.plausible:
        lines.append("view order: unknown, the views have too little texture or disparity")
    else:
        lines.append(
            "view order: unknown, none is clearly more consistent than the others; check the "
            "grid and the file layout, or pass a larger --max-disparity"
        )
    if report.nearer_in_front is not None:
        fraction = f"{report.nearer_in_front:.0%}"
        lines.append(f"  in {fraction} of the occlusions the nearer surface is in front")
    if report.conclusive and not report.sign_known:
        lines.append(
            "  too few occlusions to determine the sign of disparity: with rows and columns\n"
            "  flipped in addition, the views would be equally consistent"
        )
    lines += [f"views: {note}" for note in notes]
    low, high = report.disparity_range
    measured = report.measured_fraction
    source = f"from {measured:.0%} of the pixels" if measured else "not measurable, default range"
    lines.append(f"disparity: {low:.2f} to {high:.2f} pixels per view step ({source})")
    if report.at_limit:
        lines.append(
            f"  the search ended at {report.max_disparity:.2f}; if the scene has larger "
            "disparities, pass --max-disparity"
        )
    lines += [f"views: {note}" for note in report.brightness.notes]
    return "\n".join(lines)
