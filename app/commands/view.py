"""``mocap view``."""

import signal
from pathlib import Path
from typing import Annotated

import typer

from app.commands.console import errors
from mocap.errors import MocapError


def view(
    run: Annotated[Path, typer.Argument(help="Folder that track or demo wrote, or a .rrd file.")],
    web: Annotated[bool, typer.Option("--web", help="In the browser instead of a window.")] = False,
) -> None:
    """Open a run in rerun, on 127.0.0.1 only."""
    import webbrowser

    from app.view.viewer import open_viewer

    path = run / "recording.rrd" if run.is_dir() else run
    if not path.is_file():
        raise MocapError(f"{path}: there is no recording: give a folder that mocap track or mocap demo wrote")
    viewer = open_viewer(path, web=web)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # a terminated command ends its viewer too
    try:
        if viewer.url:
            errors.print(f"{viewer.url}\nCtrl-C to stop.", highlight=False, soft_wrap=True)
            webbrowser.open(viewer.url)
        viewer.wait()
    except KeyboardInterrupt:
        pass
    finally:
        viewer.close()
