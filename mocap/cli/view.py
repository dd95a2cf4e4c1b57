"""``mocap view`` and ``mocap share``."""

from pathlib import Path
from typing import Annotated

import typer

from mocap.cli.console import errors, say
from mocap.cli.options import Force, Out

Run = Annotated[Path, typer.Argument(help="Folder that track or demo wrote, or a .rrd file.")]


def view(
    run: Run,
    frames: Annotated[
        str | None,
        typer.Option(help="Frames FIRST:LAST (from 1) of a result that was tracked in blocks, all of them."),
    ] = None,
    web: Annotated[bool, typer.Option("--web", help="Show it in the browser instead of a window.")] = False,
) -> None:
    """Open a result in rerun, on 127.0.0.1 only."""
    import webbrowser
    from tempfile import TemporaryDirectory

    from mocap.rerun.stored import recording_file
    from mocap.rerun.viewer import open_viewer

    with TemporaryDirectory() as folder:
        if frames is None:
            shown = recording_file(with_recording(run, Path(folder)))
        else:
            shown = detail(run, frames, Path(folder) / "recording.rrd")
        viewer = open_viewer(shown, web=web)
        try:
            if viewer.url:
                errors.print(f"{viewer.url}\nCtrl-C to stop.", highlight=False, soft_wrap=True)
                webbrowser.open(viewer.url)
            viewer.wait()
        except KeyboardInterrupt:
            pass
        finally:
            viewer.close()


def with_recording(run: Path, folder: Path) -> Path:
    """A run, or, where its result has no recording for the viewer (as ``mocap batch`` writes it), one made of it."""
    import mocap
    from mocap.io.manifest import current

    if not run.is_dir() or current(run, "recording.rrd").is_file() or not current(run, "recording.nc").is_file():
        return run
    made = folder / run.resolve().name
    mocap.load(run).write_recording(made)
    return made


def detail(run: Path, frames: str, out: Path) -> Path:
    """Some frames of one result, as a recording.

    Raises:
        MocapError: it was not tracked in blocks, or has no such frames.
    """
    from mocap.errors import MocapError
    from mocap.rerun.record import write_recording
    from mocap.results.blocks import is_long, load_range

    first, _, last = frames.partition(":")
    if not (first.isdecimal() and last.isdecimal() and 0 < int(first) <= int(last)):
        raise MocapError(f"--frames {frames}: expected FIRST:LAST, as 1001:2000")
    if not is_long(run):
        raise MocapError("--frames shows a part of a result that was tracked in blocks")
    write_recording(load_range(run, range(int(first) - 1, int(last))), out, first=int(first))
    return out


def share(
    run: Run,
    out: Out,
    force: Force = False,
) -> None:
    """Write one page that holds the recording and its viewer: it opens with a double click and contacts no server."""
    from tempfile import TemporaryDirectory

    from mocap.io.output import result_folder
    from mocap.rerun.share import PAGE, write_page

    with result_folder(out, "share", replace=force, inputs=[run], tell=say) as folder, TemporaryDirectory() as place:
        write_page(with_recording(run, Path(place)), folder)
    size_mb = (out / PAGE).stat().st_size / 1e6
    errors.print(
        f"Wrote {out / PAGE} ({size_mb:.0f} MB): open it in a browser, send it, or put it on any web server.",
        highlight=False,
        soft_wrap=True,
    )
