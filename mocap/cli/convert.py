"""``mocap convert`` and ``mocap triangulate``: files to files."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from mocap.cli.console import say
from mocap.cli.options import (
    AsJson,
    Crop,
    FileOptions,
    Force,
    Fps,
    RecordingOptions,
    Unit,
    Views,
    refusing,
    with_records,
)


@refusing
@with_records
def convert(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="Files of any format that mocap info knows; several are "
            "combined (views of one recording, calibration)."
        ),
    ],
    out: Annotated[Path, typer.Argument(help="File to write; the end of its name sets the format.")],
    options: FileOptions,
    to: Annotated[
        str | None,
        typer.Option(help="Format: c3d, trc, movement, csv-wide, csv-long, parquet, dltdv, anipose-calibration."),
    ] = None,
    fps: Fps = None,
    unit: Unit = None,
    filled: Annotated[
        bool,
        typer.Option(
            "--filled", help="Write filled samples even to formats that cannot mark them as filled (TRC, DLTdv)."
        ),
    ] = False,
    crop: Crop = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Write a recording in another format; what that format cannot store is listed, or refused.

    A log of corrections (edits.jsonl) becomes movement's list of swaps and drops (edits.json; --fps sets its times).
    """
    from mocap.io.output import result_file
    from mocap.io.together import convert_files

    if len(files) == 1 and files[0].suffix == ".jsonl":
        from mocap.reading.edits import read_edits
        from mocap.reading.edits_of_movement import write_committed

        edits = read_edits(files[0])
        with result_file(out, replace=force, inputs=files, tell=say) as file:
            wrote = write_committed(file, edits, fps=fps or 1.0)
        say(f"wrote {wrote} to {out}")
        return
    whole = None
    if crop:
        from mocap.reading.reading import uncropped

        whole = uncropped(files, crop, fps=fps, hints=options.hints())
    with result_file(out, replace=force, inputs=[*files, *(crop or [])], tell=say) as file:
        done = convert_files(
            files, file, hints=options.hints(), to=to, fps=fps, unit=unit, filled=filled, contents=whole
        )
    done["written"] = [str(out.with_name(name)) for name in done["written"]]
    if as_json:
        print(json.dumps(done))  # noqa: T201
        return
    for remark in [*done["findings"], *done["remarks"]]:
        say(remark)
    say(f"wrote {', '.join(done['written'])}")


@with_records
def triangulate(
    tracks: Views,
    out: Annotated[Path, typer.Option(help="xyzpts file to write.")],
    options: RecordingOptions,
    refine: Annotated[
        bool,
        typer.Option(
            "--refine",
            help="Minimise the reprojection error, reject outlying cameras, and add _sd columns (standard deviations).",
        ),
    ] = False,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Pixels to 3D points: linear least squares as in DLTdv, without cleaning; --refine for better."""
    import mocap
    from mocap.cleaning.triangulate_file import triangulate_file
    from mocap.io.output import result_file

    # points of a frame each: no rate is needed
    recording = mocap.read(tracks, **{**options.arguments(), "fps": options.fps or 1.0})
    with result_file(out, replace=force, inputs=recording.inputs, tell=say) as file:
        summary = triangulate_file(recording, file, refine=refine)
    findings = [str(finding) for finding in summary.findings]
    if as_json:
        print(json.dumps({"out": str(out), **asdict(summary), "findings": findings}))  # noqa: T201
        return
    say(*findings)
    say(f"{out}: {summary.points} of {summary.samples} samples triangulated, residual {summary.residual_px:.2f} px")
