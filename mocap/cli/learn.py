"""``mocap learn``."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from mocap.cli.console import program, say, show
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
    SkeletonFile,
    SparseCameras,
    Unit,
)
from mocap.pipeline.source import Source


def learn(
    trials: Annotated[list[Path], typer.Argument(help="Recordings, in any format that mocap info knows.")],
    out: Annotated[Path, typer.Option(help="Model to write (.npz).")],
    dlt: Dlt = None,
    fps: Fps = None,
    unit: Unit = None,
    profile: Profile = None,
    skeleton: SkeletonFile = None,
    origin: PixelOriginOption = None,
    dlt_origin: DltOrigin = None,
    image_height: ImageHeight = None,
    pixel_sd: PixelSd = None,
    seed: Annotated[int, typer.Option(min=0, help="Which samples are hidden to choose and to calibrate.")] = 0,
    format_name: FormatName = None,
    cameras: SparseCameras = None,
    columns: Columns = None,
    sheet: Sheet = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Learn a motion model from several recordings, to track others with: mocap track FILE --model MODEL.

    Cameras, profile and skeleton are those of all the recordings. How the model fills gaps is measured on samples that
    were hidden from it, and printed.
    """
    from filters.model_file import save_model
    from mocap.io.format import Hints
    from mocap.io.output import result_file
    from mocap.io.plain import parse_columns
    from mocap.pipeline.learning import learn_from, readable_scores

    hints = Hints(cameras=cameras, columns=parse_columns(columns or ""), format=format_name, sheet=sheet)
    sources = [
        Source(
            tracks=tracks,
            fps=fps,
            coefficients=dlt,
            profile=profile,
            skeleton=skeleton,
            pixel_origin=origin,
            coefficient_origin=dlt_origin,
            image_height_px=image_height,
            pixel_sd=pixel_sd,
            unit=unit,
            hints=hints,
        )
        for tracks in trials
    ]
    sources = [s if s.recording.pixels is not None else replace(s, coefficients=None) for s in sources]
    inputs = [path for source in sources for path in source.inputs]
    with result_file(out, replace=force, inputs=inputs, tell=say) as file:
        learned = learn_from(sources, seed=seed, tell=say)
        save_model(learned, file)
    if as_json:
        print(json.dumps({"out": str(out), "scores": learned.scores}))  # noqa: T201
        return
    show(readable_scores(learned))
    say("", f"Wrote {out}. Track another recording with it: {program()} track FILE ... --model {out}")
