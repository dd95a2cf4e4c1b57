"""``mocap triangulate``."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from mocap.cli.console import say
from mocap.cli.options import AsJson, FitLens, Force, RecordingOptions, Views, with_records


@with_records
def triangulate(
    tracks: Views,
    out: Annotated[Path, typer.Option(help="xyzpts file to write.")],
    stated: RecordingOptions,
    refine: Annotated[
        bool,
        typer.Option(
            "--refine",
            help="Minimise the reprojection error, reject outlying cameras, and add _sd columns (standard deviations).",
        ),
    ] = False,
    fit_lens: FitLens = False,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Pixels to 3D points: linear least squares as in DLTdv, without cleaning; --refine for better."""
    import mocap
    from mocap.io.output import result_file
    from mocap.pipeline.triangulate_file import triangulate_file

    # points of a frame each: no rate is needed
    recording = mocap.read(tracks, **{**stated.stated(), "fps": stated.fps or 1.0}, fit_lens=fit_lens)
    with result_file(out, replace=force, inputs=recording.inputs, tell=say) as file:
        summary = triangulate_file(recording, file, refine=refine)
    told = [str(finding) for finding in summary.findings]
    if as_json:
        print(json.dumps({"out": str(out), **asdict(summary), "findings": told}))  # noqa: T201
        return
    say(*told)
    say(f"{out}: {summary.points} of {summary.samples} samples triangulated, residual {summary.residual_px:.2f} px")
