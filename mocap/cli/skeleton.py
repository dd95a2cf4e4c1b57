"""``mocap skeleton``."""

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from mocap.cli.console import say
from mocap.cli.options import (
    AsJson,
    Columns,
    Dlt,
    DltOrigin,
    Force,
    FormatName,
    Fps,
    ImageHeight,
    PixelOriginOption,
    Profile,
    Sheet,
    SparseCameras,
    Tracks,
    Unit,
)


def skeleton(
    tracks: Tracks,
    out: Annotated[Path | None, typer.Option(help="Skeleton file to write; if not given, it is printed.")] = None,
    dlt: Dlt = None,
    fps: Fps = None,
    unit: Unit = None,
    profile: Profile = None,
    origin: PixelOriginOption = None,
    dlt_origin: DltOrigin = None,
    image_height: ImageHeight = None,
    format_name: FormatName = None,
    cameras: SparseCameras = None,
    columns: Columns = None,
    sheet: Sheet = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Propose a skeleton from a recording: its markers, rigid bones, trunk and joints, in a file to correct.

    mocap skeleton trial.csv > bat.toml; then: mocap track trial.csv --skeleton bat.toml.
    """
    from mocap.io.format import Hints
    from mocap.io.output import result_file
    from mocap.io.plain import parse_columns
    from mocap.pipeline.prepare import prepare
    from mocap.pipeline.propose_skeleton import propose_skeleton
    from mocap.pipeline.source import Source

    source = Source(
        tracks=tracks,
        fps=fps,
        coefficients=dlt,
        profile=profile,
        pixel_origin=origin,
        coefficient_origin=dlt_origin,
        image_height_px=image_height,
        unit=unit,
        hints=Hints(cameras=cameras, columns=parse_columns(columns or ""), format=format_name, sheet=sheet),
    )
    found = propose_skeleton(prepare(source))
    if out is not None:
        with result_file(out, replace=force, inputs=source.inputs, tell=say) as file:
            file.write_text(found.text, encoding="utf-8", newline="")
    counts = {
        "markers": len(found.skeleton.markers),
        "bones": len(found.skeleton.bones),
        "trunk": len(found.skeleton.trunk),
        "joints": len(found.skeleton.joints),
    }
    if as_json:
        print(json.dumps({"out": None if out is None else str(out), **counts, "text": found.text}))  # noqa: T201
    elif out is None:
        sys.stdout.buffer.write(found.text.encode("utf-8"))  # whatever the encoding of the terminal: it becomes a file
        sys.stdout.flush()
    say(
        *source.frame_findings,
        f"proposed: {counts['markers']} markers, {counts['bones']} bones, {counts['joints']} joints, a trunk of "
        f"{counts['trunk'] or 'no'} markers; correct it",
    )
