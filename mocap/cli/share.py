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
    """Write a folder for any web server: the recording together with its viewer."""
    from mocap.io.output import result_folder
    from mocap.rerun.share import write_site

    with result_folder(out, "share", replace=force, inputs=runs, tell=say) as folder:
        write_site(runs, folder)
    size_mb = sum(path.stat().st_size for path in out.iterdir()) / 1e6
    errors.print(
        f"Wrote {out}/ ({size_mb:.0f} MB): put it on any web server and open its index.html.\n"
        f"To try it here: python -m http.server --bind 127.0.0.1 --directory {out} 8000, then http://127.0.0.1:8000/",
        highlight=False,
        soft_wrap=True,
    )
