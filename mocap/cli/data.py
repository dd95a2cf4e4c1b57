"""``mocap data``: recordings whose truth is known, and where real ones are."""

import json
from typing import Annotated

import typer
from rich.table import Table

from mocap.cli.console import errors, output, progress, say
from mocap.cli.offered import offered
from mocap.cli.options import AsJson, Command, Force, Out

data = typer.Typer(no_args_is_help=True, help="Synthetic recordings with known ground truth, and where real ones are.")


@data.command("list", cls=Command)
def list_data(as_json: AsJson = False) -> None:
    """List what can be made, and which real recordings are known and there."""
    from mocap.datasets.catalogue import ENTRIES
    from mocap.datasets.real import REAL, VARIABLE, folder

    where = folder()
    real = [{**vars(r), "there": (where / r.name).is_dir()} for r in REAL]
    if as_json:
        print(json.dumps({"make": {e.name: e.what for e in ENTRIES}, "real": real, "folder": str(where)}))  # noqa: T201
        return
    console = output
    made = Table(
        "mocap data make",
        "",
        box=None,
        title="Synthetic, with known ground truth (made from a random seed)",
        title_justify="left",
    )
    for entry in ENTRIES:
        made.add_row(entry.name, entry.what)
    console.print(made)
    recordings = Table(
        "mocap data path", "", "there", box=None, title=f"\nReal, in {where} ({VARIABLE})", title_justify="left"
    )
    for recording in real:
        recordings.add_row(recording["name"], recording["what"], "yes" if recording["there"] else "-")
    console.print(recordings)


@data.command("make", cls=Command)
def make_data(
    name: Annotated[str, typer.Argument(help="What to make: see mocap data list.", autocompletion=offered("made"))],
    out: Out,
    seed: Annotated[int, typer.Option(min=0, help="Random seed: the same seed gives the same files.")] = 0,
    force: Force = False,
) -> None:
    """Make a recording, a calibration session or a pendulum with its truth, as files of the programs people use."""
    from mocap.datasets.catalogue import make
    from mocap.io.manifest import MANIFEST
    from mocap.progress import Stages

    with progress() as tell, Stages(tell=tell).stage(name) as share:
        make(name, out, seed=seed, replace=force, progress=share, tell=say)
    size = sum(path.stat().st_size for path in out.rglob("*") if path.is_file())
    names = sorted(path.name + ("/" if path.is_dir() else "") for path in out.iterdir() if path.name != MANIFEST)
    errors.print(
        f"wrote {out} ({size / 1e6:.1f} MB): {', '.join(names)}", highlight=False, soft_wrap=True, markup=False
    )


@data.command("path", cls=Command)
def data_path(
    name: Annotated[str, typer.Argument(help="A real recording: see mocap data list.", autocompletion=offered("real"))],
) -> None:
    """Print the folder of a real recording that you have."""
    from mocap.datasets.real import real_path

    print(real_path(name))  # noqa: T201
