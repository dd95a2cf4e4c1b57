"""``mocap view``."""

import signal
from pathlib import Path
from typing import Annotated

import typer

from mocap.cli.console import errors


def view(
    runs: Annotated[
        list[Path],
        typer.Argument(help="Folder that track or demo wrote, or a .rrd file; two to four are shown side by side."),
    ],
    web: Annotated[bool, typer.Option("--web", help="Show it in the browser instead of a window.")] = False,
) -> None:
    """Open a run, or compare several, in rerun, on 127.0.0.1 only."""
    import webbrowser
    from tempfile import TemporaryDirectory

    import mocap
    from mocap.io.manifest import current
    from mocap.rerun.compare import recording_of
    from mocap.rerun.viewer import open_viewer

    with TemporaryDirectory() as folder:
        for i, run in enumerate(runs):  # mocap batch leaves the recording to be made where one looks at it
            if run.is_dir() and current(run, "run.nc").is_file() and not current(run, "recording.rrd").is_file():
                made = Path(folder) / str(i) / run.resolve().name
                mocap.load(run).write_recording(made)
                runs[i] = made
        viewer = open_viewer(recording_of(runs, Path(folder)), web=web)
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
