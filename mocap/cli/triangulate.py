"""``mocap triangulate``."""

import json
from dataclasses import asdict
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
    PixelSd,
    Profile,
    Sheet,
    SparseCameras,
    Tracks,
    Unit,
)
from mocap.errors import MocapError
from mocap.pipeline.source import Source


def triangulate(
    tracks: Tracks,
    out: Annotated[Path, typer.Option(help="xyzpts file to write.")],
    dlt: Dlt = None,
    fps: Fps = None,
    unit: Unit = None,
    profile: Profile = None,
    origin: PixelOriginOption = None,
    dlt_origin: DltOrigin = None,
    image_height: ImageHeight = None,
    pixel_sd: PixelSd = None,
    refine: Annotated[
        bool, typer.Option("--refine", help="Smallest reprojection error, bad rays rejected, with _sd columns.")
    ] = False,
    format_name: FormatName = None,
    cameras: SparseCameras = None,
    columns: Columns = None,
    sheet: Sheet = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Pixels to points: DLTdv's linear least squares, nothing cleaned; --refine for better."""
    from mocap.io.format import Hints
    from mocap.io.output import result_file
    from mocap.io.plain import parse_columns
    from mocap.pipeline.triangulate_file import triangulate_file

    hints = Hints(cameras=cameras, columns=parse_columns(columns or ""), format=format_name, sheet=sheet)
    source = Source(
        tracks=tracks,
        fps=fps or 1.0,  # points of a frame each: no rate is needed
        coefficients=dlt,
        profile=profile,
        pixel_origin=origin,
        coefficient_origin=dlt_origin,
        image_height_px=image_height,
        pixel_sd=pixel_sd,
        unit=unit,
        hints=hints,
    )
    if not source.filmed:
        raise MocapError(f"{tracks.name}: pixels need the coefficients of their cameras: give --dlt")
    with result_file(out, replace=force, inputs=source.inputs, tell=say) as file:
        summary = triangulate_file(source, file, refine=refine)
    if as_json:
        print(json.dumps({"out": str(out), **asdict(summary)}))  # noqa: T201
        return
    for finding in summary.findings:
        say(finding)
    say(f"{out}: {summary.points} of {summary.samples} samples triangulated, residual {summary.residual_px:.2f} px")
