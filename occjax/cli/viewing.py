"""The command ``view``."""

from __future__ import annotations

import getpass
import socket
from pathlib import Path
from typing import Annotated

from tyro.conf import FlagCreatePairsOff, OmitArgPrefixes, Positional, arg

from occjax.cli.options import ViewOrderOptions, option
from occjax.errors import InputError


def view_command(
    results: Annotated[
        tuple[Path, ...],
        Positional,
        option(
            "Folders that occjax estimate wrote, or disparity maps, of one scene.", "RESULTS..."
        ),
    ],
    scene: Annotated[
        Path | None,
        option(
            "The light field that was estimated. By default it is read from where it was then.",
            "SCENE",
        ),
    ] = None,
    port: Annotated[
        int | None, option("Port of the page. By default any free port.", "PORT")
    ] = None,
    host: Annotated[
        str,
        option(
            "Address to listen at: 0.0.0.0 lets other computers see the page. By default only "
            "this computer can.",
            "ADDRESS",
        ),
    ] = "127.0.0.1",
    no_open: Annotated[
        bool, FlagCreatePairsOff, arg(help="Print the address only; open no browser.")
    ] = False,
    view_order: OmitArgPrefixes[ViewOrderOptions] = ViewOrderOptions(),
) -> int:
    """Look at results in the browser: points in space, views, refocusing, single pixels."""
    if not results:
        raise InputError("pass at least one folder that occjax estimate wrote")
    if port is not None and not 0 < port < 65536:
        raise InputError(f"--port is {port}; pass 1 to 65535")
    if scene is None and view_order != ViewOrderOptions():
        raise InputError("options of the scene need --scene; pass the scene that was estimated")
    # The rest imports JAX. A wrong argument is reported without it.
    from occjax.viewer import open_viewer
    from occjax.viewer.opening import check_viser, read_scene

    check_viser()
    light_field = None if scene is None else view_order.load(scene)
    viewed = read_scene(results, light_field)
    with open_viewer(viewed, host=host, port=port, open_browser=not no_open) as viewer:
        print(
            f"{viewer.url}\n"
            f"  from another computer: ssh -L {viewer.port}:localhost:{viewer.port} "
            f"{getpass.getuser()}@{socket.gethostname()}, "
            f"then open http://localhost:{viewer.port} there\n"
            "  Ctrl-C ends the viewer",
            flush=True,
        )
        viewer.wait()
    return 0
