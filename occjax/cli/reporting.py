"""The command ``report``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from occjax.cli.options import option
from occjax.errors import InputError


def report_command(
    results: Annotated[
        tuple[Path, ...],
        Positional,
        option("Folders of results, each of one scene or of several scenes.", "RESULT_FOLDER..."),
    ],
    output: Annotated[Path, arg(aliases=["-o"], metavar="FILE", help="Page to write.")] = Path(
        "report.html"
    ),
) -> int:
    """Write one HTML file on results, which any browser opens without a server or network.

    It shows maps with the values under the pointer, the error and the scores if there is ground
    truth, occlusion maps if they were saved (occjax estimate --save all), a point cloud, notes,
    seconds, memory and settings.

    $ occjax report results -o report.html
    """
    if not results:
        raise InputError("pass at least one folder of results, which occjax estimate writes")
    if output.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{output}: a report is a page; use the suffix .html")
    from occjax.report.page import check_report, write_report
    from occjax.report.scenes import read_scenes

    check_report()
    scenes = read_scenes(results)
    write_report(output, scenes)
    print(f"{output}: {len(scenes)} scene{'s' * (len(scenes) > 1)}")
    return 0
