"""``mocap info``."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from mocap.cli.console import show_text
from mocap.cli.options import AsJson, RecordingOptions, with_records


@with_records
def info(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="Files of any format; files that belong together are also checked against each other. A folder: its "
            "trials, each against the others."
        ),
    ],
    options: RecordingOptions,
    as_json: AsJson = False,
) -> None:
    """Describe files: format, points, cameras, frames, rate, units, gaps, and what is wrong or unusual in them."""
    from mocap.audit.inspect import inspect, readable
    from mocap.cameras.origin import PixelOptions
    from mocap.cleaning.trial_audit import of_files
    from mocap.cli.table import of_folders
    from mocap.errors import MocapError, NoRateError
    from mocap.findings import listed

    stated = options.arguments()
    if any(path.is_dir() for path in files):
        describe = of_folders()
        if describe is None:
            raise MocapError(f"{files[0]}: is a folder: give files")
        sources = [str(path) for path in files]
        describe(sources, as_json=as_json, **stated)
        return
    files = [*files, *(one for one in (options.calibration, options.profile, options.stored_points) if one is not None)]
    found: list[dict[str, Any]] = inspect(
        files,
        stated["hints"],
        fps=options.fps,
        unit=options.unit,
        origin=PixelOptions(
            origin=options.origin,
            calibration_origin=options.calibration_origin,
            image_height_px=options.image_height_px,
        ),
    )
    whole = of_files(files, **stated)
    lines: list[str] = []
    if whole is not None and not isinstance(whole.refused, NoRateError):  # of its motion nothing is known then
        lines = listed(whole.findings)
        _with_list(found, [one.as_json() for one in whole.findings])
    if as_json:
        print(json.dumps(found[0] if len(found) == 1 else found, allow_nan=False))  # noqa: T201
    else:
        for one in found:
            told = {entry["text"] for entry in one.get("audit", [])} if lines else set()
            show_text(readable({**one, "findings": [text for text in one["findings"] if text not in told]}))
        show_text("\n".join([*lines, ""]) if lines else "")
    if any(one["format"] is None or "error" in one for one in found):
        raise typer.Exit(1)


def _with_list(found: list[dict[str, Any]], audit: list[dict[str, Any]]) -> None:
    """Put the list of the whole trial in place of those of its files, which say some of the same; with the first."""
    texts = [one["text"] for one in audit]
    for one in found:
        told = {*texts, *(entry["text"] for entry in one.get("audit", []))}
        one["findings"] = [text for text in one["findings"] if text not in told]
        one["audit"] = []
    found[0]["audit"] = audit
    found[0]["findings"] += texts
