"""``mocap compare-joints``."""

import json
from pathlib import Path
from typing import Annotated

import typer

from mocap.cli.console import program, say, show_text, typed
from mocap.cli.offered import offered
from mocap.cli.options import AsJson, Force


def compare_joints(
    runs_a: Annotated[Path, typer.Argument(help="Folder of tracked runs, at any depth.")],
    runs_b: Annotated[
        Path,
        typer.Argument(help="Folder of the runs to compare with; the same folder to compare two joints of each run."),
    ],
    joint: Annotated[
        list[str],
        typer.Option(
            help="Name of the joint; without a side (elbow): both sides; two (elbow_l,elbow_r): one for each group. "
            "Several times, or all: several joints at once.",
            autocompletion=offered("joints"),
        ),
    ],
    out: Annotated[Path | None, typer.Option(help="Folder to write: report, figure and rerun recording.")] = None,
    animals: Annotated[
        bool | None,
        typer.Option(
            "--animals/--trials",
            help="Permute animals (the runs in one folder are of one animal; an animal with runs in both groups is "
            "compared with itself), or trials (the result holds within these animals).  [default: animals, where a "
            "summary of mocap batch or folders tell them]",
            show_default=False,
        ),
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Test whether a joint moves differently in two groups of runs: p value, effect in degrees, and where."""
    from mocap.io.output import result_folder
    from mocap.results import joint_comparison

    by = None if animals is None else "animal" if animals else "trial"
    found = joint_comparison.compare_several(runs_a, runs_b, joints=joint, by=by)
    only = next(iter(found.values())) if len(found) == 1 else None
    if out is not None:
        with result_folder(out, "compare-joints", replace=force, inputs=[runs_a, runs_b], tell=say) as folder:
            if only is not None:
                joint_comparison.write_comparison(only, folder)
            else:
                joint_comparison.write_several(found, folder)
    if as_json:
        several = {name: joint_comparison.report(one) for name, one in found.items()}
        print(json.dumps(several if only is None else joint_comparison.report(only)))  # noqa: T201
        return
    show_text(joint_comparison.readable(found, (runs_a, runs_b)))
    if out is not None:
        say("", f"Wrote {out}/: report, figure, recording.rrd", f"Look at it: {typed(*program(), 'view', out)}")
