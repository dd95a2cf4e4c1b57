"""``mocap learn``."""

import json
from pathlib import Path
from typing import Annotated

import typer

from mocap.cli.console import program, say, show, typed
from mocap.cli.options import AsJson, Force, Jobs, RecordingOptions
from mocap.cli.records import with_records


@with_records
def learn(
    trials: Annotated[list[Path], typer.Argument(help="Recordings, in any format that mocap info knows.")],
    out: Annotated[Path, typer.Option(help="Model to write (.npz).")],
    stated: RecordingOptions,
    seed: Annotated[
        int,
        typer.Option(
            min=0, help="Random seed of the gaps that are hidden to choose the model and to set its intervals."
        ),
    ] = 0,
    joints: Annotated[
        bool,
        typer.Option(
            "--joints",
            help="Joint angles of rigid segments as one more model: nearer where bones are rigid, and on animals of "
            "other sizes; tracking takes 1.5 to 2.3 times as long. Needs bones in the skeleton.",
        ),
    ] = False,
    jobs: Jobs = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Learn a motion model from several recordings, to track others with: mocap track FILE --model MODEL.

    Cameras, profile and skeleton are those of all the recordings. How the model fills gaps is measured on samples that
    were hidden from it, and printed.
    """
    import mocap
    from mocap.io.output import result_file

    recordings = [stated.read(tracks) for tracks in trials]
    inputs = [path for recording in recordings for path in recording.inputs]
    with result_file(out, replace=force, inputs=inputs, tell=say) as file:
        with mocap.processes(jobs):
            model = mocap.learn(recordings, joints=joints, seed=seed, progress=say)
        model.write(file)
    if as_json:
        print(json.dumps({"out": str(out), "scores": model.scores}))  # noqa: T201
        return
    show(model.report_text)
    say(
        "",
        f"Wrote {out}. Track another recording with it: {typed(program(), 'track', 'FILE')} ... --model {typed(out)}",
    )
