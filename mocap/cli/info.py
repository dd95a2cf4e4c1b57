"""``mocap info``."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from mocap.cli.console import show_text
from mocap.cli.options import (
    AsJson,
    Calibration,
    CalibrationOrigin,
    FileOptions,
    Fps,
    ImageHeight,
    PixelOriginOption,
    Unit,
    with_records,
)


@with_records
def info(
    files: Annotated[
        list[Path],
        typer.Argument(help="Files of any format; files that belong together are also checked against each other."),
    ],
    options: FileOptions,
    calibration: Calibration = None,
    fps: Fps = None,
    unit: Unit = None,
    origin: PixelOriginOption = None,
    calibration_origin: CalibrationOrigin = None,
    image_height: ImageHeight = None,
    as_json: AsJson = False,
) -> None:
    """Describe files: format, points, cameras, frames, rate, units, gaps, and what is wrong or unusual in them."""
    from mocap.audit.inspect import inspect, readable
    from mocap.cameras.origin import PixelOptions

    corners = PixelOptions(origin=origin, calibration_origin=calibration_origin, image_height_px=image_height)
    files = files if calibration is None else [*files, calibration]
    found: list[dict[str, Any]] = inspect(files, options.hints(), fps=fps, unit=unit, origin=corners)
    if as_json:
        print(json.dumps(found[0] if len(found) == 1 else found, allow_nan=False))  # noqa: T201
    else:
        for one in found:
            show_text(readable(one))
    if any(one["format"] is None or "error" in one for one in found):
        raise typer.Exit(1)
