"""``mocap learn``."""

import json
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from mocap.cli.console import program, progress, say, show, show_text, typed
from mocap.cli.options import Jobs, PrintOptions, RecordingOptions, with_records
from mocap.progress import Stages


@with_records
def learn(
    trials: Annotated[list[Path], typer.Argument(help="Recordings in any supported format.")],
    out: Annotated[Path, typer.Option(help="Model to write (.npz).")],
    options: RecordingOptions,
    printed: PrintOptions,
    seed: Annotated[
        int,
        typer.Option(min=0, help="Random seed of the gaps that are hidden to choose the model and set its intervals."),
    ] = 0,
    joints: Annotated[
        bool,
        typer.Option(
            "--joints",
            help="Also a model of joint angles of rigid segments: better where bones are rigid and animals differ in "
            "size; tracking takes 1.5 to 2.3 times as long. Needs bones in the skeleton.",
        ),
    ] = False,
    jobs: Jobs = None,
) -> None:
    """Learn a motion model from several recordings that share cameras and skeleton, to track others with.

    Example: mocap learn trial1.csv trial2.csv --skeleton bat.toml --out bat.npz

    Then: mocap track trial3.csv --model bat.npz --skeleton bat.toml --out out/trial3
    """
    import mocap
    from mocap.io.output import result_file
    from mocap.reading.reading import of_session

    recordings = []
    with progress() as tell, Stages(tell=tell).stage(options.stage) as share:
        for recording in of_session(partial(options.read, tracks) for tracks in trials):
            recordings.append(recording)
            share(len(recordings) / len(trials))
    inputs = [path for recording in recordings for path in recording.inputs]
    with result_file(out, replace=printed.force, inputs=inputs, tell=say) as file:
        with progress() as tell, mocap.processes(jobs):
            model = mocap.learn(recordings, joints=joints, seed=seed, progress=tell, tell=say)
        model.write(file)
    if printed.as_json:
        print(json.dumps({"out": str(out), "scores": model.scores}))  # noqa: T201
        return
    show_text(f"Result: {out}\nUse it: {typed(*program(), 'track', 'FILE', '--model', out, '--out', 'FOLDER')}\n")
    show(model.report_text if printed.verbose else model.scores_text)
