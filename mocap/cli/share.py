"""``mocap share``."""

from pathlib import Path
from typing import Annotated

import typer

from mocap.cli.console import errors, say
from mocap.cli.options import Force, Out


def share(
    runs: Annotated[
        list[Path],
        typer.Argument(help="Folder that track or demo wrote, or a .rrd file; two to four are shown side by side."),
    ],
    out: Out,
    force: Force = False,
) -> None:
    """Write one page that holds the recording and its viewer: it opens by a double click, and reaches no host."""
    from tempfile import TemporaryDirectory

    from mocap.cli.view import with_recording
    from mocap.io.output import result_folder
    from mocap.rerun.share import PAGE, write_page

    with result_folder(out, "share", replace=force, inputs=runs, tell=say) as folder, TemporaryDirectory() as place:
        write_page([with_recording(run, Path(place) / str(i)) for i, run in enumerate(runs)], folder)
    size_mb = (out / PAGE).stat().st_size / 1e6
    errors.print(
        f"Wrote {out / PAGE} ({size_mb:.0f} MB): open it in a browser, send it, or put it on any web server.",
        highlight=False,
        soft_wrap=True,
    )
