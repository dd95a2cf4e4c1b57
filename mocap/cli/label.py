"""``mocap label``."""

import json
from pathlib import Path
from typing import Annotated

import typer

from mocap.cli.console import say
from mocap.cli.options import AsJson, FileOptions, Force, Fps, Tracks, Unit, with_records


@with_records
def label(
    tracks: Tracks,
    model: Annotated[Path, typer.Option(help="A model that mocap learn wrote of this kind of animal and markers.")],
    options: FileOptions,
    out: Annotated[
        Path | None, typer.Option(help="File to write; if not given, FILE_labelled beside where you are.")
    ] = None,
    unit: Unit = None,
    fps: Fps = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Name unlabelled trajectories of an optical system; what is unsure stays unnamed (U_1, U_2, ...)."""
    import mocap
    from mocap.io.output import result_file

    target = out or Path(f"{tracks.stem}_labelled{tracks.suffix}")
    with result_file(target, replace=force, inputs=[tracks, model], tell=say) as file:
        found = mocap.label(tracks, model=model, unit=unit, fps=fps, hints=options.hints())
        remarks = found.write(file)
    if as_json:
        print(json.dumps({"out": str(target), **found.summary}))  # noqa: T201
        return
    for remark in remarks:
        say(remark)
    summary = found.summary
    total = summary["named_samples"] + summary["unnamed_samples"]
    say(
        f"named {summary['named_samples']} of {total} samples ({summary['named_segments']} of "
        f"{summary['named_segments'] + summary['unnamed_segments']} pieces of trajectories); the others are U_1, ...",
        f"wrote {target}",
    )
