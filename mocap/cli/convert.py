"""``mocap convert``."""

import json
from pathlib import Path
from typing import Annotated

import typer

from mocap.cli.console import say
from mocap.cli.options import AsJson, Crop, FileOptions, Force, Fps, Unit, with_records


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
    stated: FileOptions,
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
    """Write a recording in another format; what that format cannot store is listed, or refused."""
    from mocap.io.output import result_file
    from mocap.io.together import convert_files

    whole = None
    if crop:
        from mocap.pipeline.reading import uncropped

        whole = uncropped(files, crop, fps=fps, hints=stated.hints())
    with result_file(out, replace=force, inputs=[*files, *(crop or [])], tell=say) as file:
        done = convert_files(
            files, file, hints=stated.hints(), to=to, fps=fps, unit=unit, filled=filled, contents=whole
        )
    done["written"] = [str(out.with_name(name)) for name in done["written"]]
    if as_json:
        print(json.dumps(done))  # noqa: T201
        return
    for remark in [*done["findings"], *done["remarks"]]:
        say(remark)
    say(f"wrote {', '.join(done['written'])}")
