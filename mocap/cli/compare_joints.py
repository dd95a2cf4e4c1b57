"""``mocap compare-joints``."""

import json
from pathlib import Path
from typing import Annotated

import typer

from mocap.cli.console import program, say, show_text, typed
from mocap.cli.options import AsJson, Force


def compare_joints(
    runs_a: Annotated[Path, typer.Argument(help="Folder of tracked runs, at any depth.")],
    runs_b: Annotated[
        Path,
        typer.Argument(help="Folder of the runs to compare with; the same folder to compare two joints of each run."),
    ],
    joint: Annotated[
        str,
        typer.Option(
            help="Name of the joint; without a side (elbow): both sides; two (elbow_l,elbow_r): one for each group."
        ),
    ],
    out: Annotated[Path | None, typer.Option(help="Folder to write: report, figure and rerun recording.")] = None,
    animals: Annotated[
        bool,
        typer.Option(
            "--animals",
            help="Permute animals, not trials: the runs in one folder are of one animal. An animal with runs in both "
            "groups is compared with itself.",
        ),
    ] = False,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Test whether a joint moves differently in two groups of runs: p value, effect in degrees, and where."""
    from mocap.io.output import result_folder
    from mocap.results import joint_comparison

    found = joint_comparison.compare_joints(runs_a, runs_b, joint=joint, by="animal" if animals else "trial")
    if out is not None:
        with result_folder(out, "compare-joints", replace=force, inputs=[runs_a, runs_b], tell=say) as folder:
            joint_comparison.write_comparison(found, folder)
    if as_json:
        print(json.dumps(joint_comparison.report(found)))  # noqa: T201
        return
    show_text(joint_comparison.readable(found, (runs_a, runs_b)))
    if out is not None:
        say("", f"Wrote {out}/: report, figure, recording.rrd", f"Look at it: {typed(program(), 'view', out)}")
