"""The commands ``evaluate`` and ``check``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

from tyro.conf import OmitArgPrefixes, Positional, arg

from occjax.cli.options import Stored, option
from occjax.errors import InputError
from occjax.evaluation import (
    BORDER,
    THRESHOLDS,
    Metrics,
    SceneScores,
    evaluate_files,
    evaluate_scene,
    is_scene,
)
from occjax.io import Orientation, OrientationReport, check
from occjax.io.orientation import declared_orientation


def evaluate_command(
    estimate: Positional[
        Annotated[Path, arg(help="Disparity map, PFM, NPY or PNG, or folder of results.")]
    ],
    ground_truth: Positional[
        Annotated[
            Path,
            arg(
                help="True disparity, PFM, NPY or PNG, or the scene's folder (with "
                "gt_disp_lowres.pfm), which may also come first."
            ),
        ]
    ],
    metrics: Annotated[
        str | None,
        option(
            "Measures of the HCI benchmark in the regions of the scene: all, or names with commas "
            "between, such as discontinuities,bumpiness_planes. Masks are those in its folder.",
            "all|NAMES",
        ),
    ] = None,
    thresholds: Annotated[
        tuple[float, ...] | None,
        option(
            "BadPix thresholds, in pixels per view step; "
            f"{', '.join(f'{threshold:g}' for threshold in THRESHOLDS)} by default. NAMES have "
            "them in themselves: badpix_0.07.",
            "FLOAT...",
        ),
    ] = None,
    border: Annotated[int, arg(help="Pixels left out at each side.")] = BORDER,
    json_: Annotated[bool, arg(name="json", help="Print JSON.")] = False,
) -> int:
    """Compare a disparity map with the ground truth, everywhere or by regions of the scene."""
    if is_scene(estimate) and not is_scene(ground_truth):
        estimate, ground_truth = ground_truth, estimate
    if metrics is not None and not is_scene(ground_truth):
        raise InputError(
            f"neither {estimate} nor {ground_truth} is a scene's folder (with gt_disp_lowres.pfm), "
            "which --metrics needs; name one"
        )
    names = None if metrics is None else _names(metrics)
    if names is not None and thresholds is not None:
        raise InputError(
            "--thresholds does not go with named measures; add "
            f"{','.join(f'badpix_{threshold:g}' for threshold in thresholds)} to --metrics instead"
        )
    thresholds = THRESHOLDS if thresholds is None else thresholds
    scores: Metrics | SceneScores
    if metrics is None:
        scores = evaluate_files(estimate, ground_truth, thresholds=thresholds, border=border)
    else:
        scores = evaluate_scene(
            ground_truth, estimate, names=names, thresholds=thresholds, border=border
        )
    print(json.dumps(scores.as_dict(), indent=2) if json_ else scores.table())
    return 0


def _names(metrics: str) -> tuple[str, ...] | None:
    """Names of the measures that are asked for; None is all of them."""
    names = tuple(name.strip() for name in metrics.split(",") if name.strip())
    if not names:
        raise InputError("--metrics names no measure; pass all, or names with commas between")
    return None if names == ("all",) else names


def check_command(
    path: Positional[
        Annotated[Path, arg(help="Folder of views, image of all views, or array file.")]
    ],
    stored: OmitArgPrefixes[Stored] = Stored(),
) -> int:
    """Measure which way round the grid of views is, and the scene's disparity range."""
    light_field = stored.load(path, check_orientation=False)
    v, u = light_field.grid
    h, w = light_field.image_size
    print(f"{light_field.name}: {v}x{u} views of {h}x{w} pixels (rows x columns)")
    print(_layout_report(check(light_field), declared_orientation(stored.order, stored.flip)))
    return 0


def _layout_report(report: OrientationReport, declared: Orientation) -> str:
    """The eight layouts by their consistency, which of them is right, and the disparity range."""
    lines = [
        "",
        "  mean grey difference from the centre view at each pixel's best disparity:",
    ]
    for name, score in sorted(report.scores.items(), key=lambda item: item[1]):
        lines.append(f"    {255 * score:7.3f} / 255  {name}{' *' * (name == report.best.name)}")
    lines.append("")
    right = declared.then(report.best)
    if report.clearly_worse:
        flip = f" --flip {right.flip}" if right.flip else ""
        lines.append(f"layout: {report.best.name}; pass --order {right.order}{flip}")
    elif report.conclusive:
        lines.append("layout: as declared")
    else:
        lines.append(
            "layout: cannot tell, none is clearly more consistent than the others; are grid and "
            "layout right?"
            if not report.fits
            else "layout: cannot tell, too little texture or disparity"
        )
    if report.nearer_in_front is not None:
        share = f"{report.nearer_in_front:.0%}"
        lines.append(f"  in {share} of the occlusions the nearer surface is in front")
    if report.conclusive and not report.sign_known:
        lines.append(
            "  too few occlusions to tell the sign of disparity: with rows and columns flipped "
            "besides,\n  the views would be as consistent"
        )
    low, high = report.disparity_range
    source = f"from {report.measured:.0%} of the pixels" if report.measured else "nothing measured"
    lines.append(f"disparity: {low:.2f} to {high:.2f} pixels per view step ({source})")
    return "\n".join(lines)
