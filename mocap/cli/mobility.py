"""``mocap mobility``."""

import json
from pathlib import Path
from typing import Annotated

import typer

from mocap.cli.console import program, say, show_text, typed
from mocap.cli.options import AsJson, Force


def mobility(
    runs: Annotated[Path, typer.Argument(help="Folder of tracked runs, at any depth; each is one trial.")],
    joint: Annotated[
        str, typer.Option(help="Joint with three angles: between two bodies, or with axes of both segments.")
    ],
    within_mm: Annotated[
        float | None,
        typer.Option(help="Count translations, too: radius in mm of the ball that they are a share of.", min=1e-6),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder to write: report, figure and rerun recording.")] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Measure what share of all rotations a joint visits, with an interval, whatever its axes are."""
    from mocap.io.output import result_folder
    from mocap.results.joint_mobility import mobility as measured

    found = measured(runs, joint=joint, within_mm=within_mm)
    if out is not None:
        with result_folder(out, "mobility", replace=force, inputs=[runs], tell=say) as folder:
            found.write(folder)
    if as_json:
        print(json.dumps(found.report()))  # noqa: T201
        return
    show_text("\n".join(found.lines()))
    if out is not None:
        say("", f"Wrote {out}/: report, figure, recording.rrd", f"Look at it: {typed(*program(), 'view', out)}")
