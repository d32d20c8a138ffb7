"""The commands ``estimate`` and ``demo``."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

from tyro.conf import FlagCreatePairsOff, OmitArgPrefixes, Positional, arg

from occjax.cli.options import CameraOptions, ViewOrderOptions, choice, option, pair
from occjax.errors import InputError
from occjax.models.bundled import find_weights, ready_models
from occjax.models.occcasnet.config import Warp
from occjax.models.registry import Precision, preset
from occjax.results.groups import DEFAULT_GROUPS, GROUPS


def estimate_command(
    scenes: Annotated[
        tuple[Path, ...],
        Positional,
        option(
            "Folders of views, images of all views, array files; folders of these; or patterns in "
            "quotes, such as 'hci/*'.",
            "SCENE...",
        ),
    ],
    output: Annotated[
        Path, arg(aliases=["-o"], metavar="FOLDER", help="Results are written to FOLDER/<scene>/.")
    ],
    model: Annotated[
        str | None,
        option(
            f"{' or '.join(ready_models())}; any other name from 'occjax weights list' needs "
            "--weights. By default the model of the weights, or proposal.",
            "MODEL",
        ),
    ] = None,
    weights: Annotated[
        Path | None,
        option(
            "Weights: .safetensors, the published .h5 / .hdf5, or a name from 'occjax weights "
            "list'. By default those of the model.",
            "FILE",
        ),
    ] = None,
    warp: Annotated[
        Warp | None,
        choice(Warp),
        option("correct or transposed, instead of the warp of the weights.", "WARP"),
    ] = None,
    disparity_range: Annotated[
        tuple[float, float] | None,
        pair(float),
        option("Disparities to search, in pixels per view step.", "MIN MAX"),
    ] = None,
    view: Annotated[
        tuple[int, int] | None,
        pair(int),
        option(
            "Estimate the view in this row and column, counted from 0, instead of the centre view.",
            "V U",
        ),
    ] = None,
    all_views: Annotated[
        bool,
        arg(
            help="Estimate all views too, compare their maps, and write them and their common "
            "point cloud: views.npz, views/ and views.ply."
        ),
    ] = False,
    precision: Annotated[Precision, arg(help="Type of a network's convolutions.")] = "float32",
    save: Annotated[
        str,
        option(
            f"What to write: all, or a comma-separated list of {', '.join(GROUPS)}. By default "
            f"{','.join(DEFAULT_GROUPS)}.",
            "NAMES",
        ),
    ] = ",".join(DEFAULT_GROUPS),
    min_confidence: Annotated[
        float | None,
        option(
            "Leave points of lower confidence, and flying pixels at depth edges, out of the cloud.",
            "FLOAT",
        ),
    ] = None,
    report: Annotated[
        bool,
        FlagCreatePairsOff,
        option(
            "Also write the occlusion maps, and FOLDER/report.html, a page on all scenes (extra "
            "report)."
        ),
    ] = False,
    scenes_from: Annotated[
        Path | None, option("Text file with one more scene or pattern on each line.", "FILE")
    ] = None,
    overwrite: Annotated[
        bool,
        arg(help="Estimate again what is complete with the same settings."),
    ] = False,
    share: Annotated[
        tuple[int, int] | None,
        pair(int),
        option(
            "Estimate only every COUNT-th scene from number INDEX, counted from 0: one of COUNT "
            "processes, on any machines, that write to the same folder.",
            "INDEX COUNT",
        ),
    ] = None,
    video: Annotated[
        bool,
        arg(
            help="The scenes are the frames of one video, in this order: one disparity range, one "
            "numbered folder for each frame, and disparity.mp4."
        ),
    ] = False,
    fps: Annotated[float, arg(metavar="RATE", help="Frames per second of disparity.mp4.")] = 25.0,
    camera: OmitArgPrefixes[CameraOptions] = CameraOptions(),
    view_order: OmitArgPrefixes[ViewOrderOptions] = ViewOrderOptions(),
) -> int:
    """Estimate disparity maps and write them, with pictures, to one folder per scene."""
    if not scenes and scenes_from is None:
        raise InputError("pass at least one scene: a folder of views, an image or an array file")
    if model is not None:
        preset(model)
    if weights is not None:
        find_weights(weights)
    if view is not None and all_views:
        raise InputError("pass --view or --all-views, not both")
    index, count = share or (0, 1)
    if not 0 <= index < count:
        raise InputError(
            f"the share is {index} {count}; pass the number of this process, from 0 to "
            f"{max(count, 1) - 1}, and the number of processes"
        )
    # The rest imports JAX. A wrong argument is reported without it.
    from occjax.cli.scene_lists import listed_scenes
    from occjax.cli.scenes import EstimateRun, estimate_scenes
    from occjax.estimators import make_estimator
    from occjax.estimators.ranges import check_range
    from occjax.io.atomic import check_writable
    from occjax.io.naming.patterns import is_in_subfolders
    from occjax.io.video import check_video
    from occjax.results.outputs import output_options

    view_order.check()
    if disparity_range is not None:
        check_range(disparity_range)
    nested = is_in_subfolders(view_order.pattern)
    scenes = listed_scenes(scenes, scenes_from, expand_folders=not nested, grid=view_order.grid)
    options = output_options(save, min_confidence)
    if report:
        from occjax.report.page import check_report

        check_report()
        options = dataclasses.replace(options, save=(*options.save, "occlusion"))
    if video:
        check_video(output / "disparity.mp4", fps)
        if "maps" not in options.save:
            raise InputError("a video is made of the maps; add maps to --save")
    run = EstimateRun(
        output,
        make_estimator(model, weights=weights, warp=warp, precision=precision),
        view_order,
        camera,
        disparity_range,
        options,
        overwrite=overwrite,
        share=(index, count),
        fps=fps if video else None,
        view=view,
        all_views=all_views,
        report=report,
    )
    check_writable(output)
    return estimate_scenes(scenes, run)


def demo_command(
    output: Annotated[
        Path, arg(aliases=["-o"], metavar="FOLDER", help="Folder of the results.")
    ] = Path("occjax-demo"),
    view: Annotated[
        bool, FlagCreatePairsOff, arg(help="Then open the viewer (extra view).")
    ] = False,
) -> int:
    """Estimate the bundled sample light field and compare it with its ground truth."""
    if view:
        from occjax.viewer.opening import check_viser

        check_viser()
    from occjax.cli.running import command_line, phase_reporter
    from occjax.cli.scenes import result_text
    from occjax.data.bundled_sample import sample
    from occjax.estimators import make_estimator, run_estimator
    from occjax.io.atomic import check_writable
    from occjax.results.outputs import output_options, write_outputs

    light_field = sample()
    check_writable(output)
    v, u = light_field.grid
    h, w = light_field.image_size
    print(f"the bundled sample: {v}x{u} views of {h}x{w} pixels, with exact ground truth")
    estimate = run_estimator(
        make_estimator(),
        light_field,
        occlusion=True,
        report_phase=phase_reporter(None, light_field.name),
    )
    options = output_options("all", None)
    outputs = write_outputs(estimate, light_field, output, options, command=command_line())
    print(result_text(light_field.name, estimate, outputs))
    if view:
        from occjax.cli.viewing import view_command

        return view_command((output,))
    return 0
