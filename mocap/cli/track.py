"""``mocap track``."""

import shlex
import sys
from contextlib import nullcontext, suppress
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, cast, get_args

import typer

from mocap.cli.console import finish, progress, say
from mocap.cli.options import (
    AsJson,
    Columns,
    Dlt,
    DltOrigin,
    Force,
    FormatName,
    Fps,
    ImageHeight,
    Out,
    PixelOriginOption,
    PixelSd,
    Profile,
    Sheet,
    SkeletonFile,
    SparseCameras,
    Tracks,
    Unit,
)
from mocap.errors import MocapError
from mocap.pipeline.source import Source
from mocap.text import as_text


def track(
    tracks: Tracks,
    out: Out,
    dlt: Dlt = None,
    fps: Fps = None,
    unit: Unit = None,
    profile: Profile = None,
    skeleton: SkeletonFile = None,
    origin: PixelOriginOption = None,
    dlt_origin: DltOrigin = None,
    image_height: ImageHeight = None,
    stored: Annotated[Path | None, typer.Option(help="xyzpts to audit; if not given, the one beside xypts.")] = None,
    pixel_sd: PixelSd = None,
    in_step: Annotated[
        bool, typer.Option("--in-step", help="Read cameras that run late, by the audit, between their frames.")
    ] = False,
    model: Annotated[
        str,
        typer.Option(
            help="A file of mocap learn; mixture, eal or constant_velocity; auto: which fills hidden samples best."
        ),
    ] = "auto",
    video: Annotated[
        list[Path] | None,
        typer.Option(
            help="Movie or folder of pictures to show under the tracks: once a camera, in the order of the cameras; or "
            "one folder that holds them, sorted by name."
        ),
    ] = None,
    video_offset: Annotated[
        list[int] | None,
        typer.Option(
            help="Frame of the movie minus frame of the tracks: one for all, or once a camera; if not given, those "
            "of the project or of the offsets file beside the tracks."
        ),
    ] = None,
    video_straight: Annotated[
        bool, typer.Option("--video-straight", help="The movies are free of the lens' distortion already.")
    ] = False,
    live: Annotated[
        bool,
        typer.Option("--live", help="Show frames as they are filtered; then the whole run, until you close it."),
    ] = False,
    validate: Annotated[bool, typer.Option(help="Hide samples and measure how they are filled.")] = True,
    format_name: FormatName = None,
    cameras: SparseCameras = None,
    columns: Columns = None,
    sheet: Sheet = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Clean, fill and smooth a recording; learn the potentials of its joints; write tables and a rerun recording."""
    from filters.model_file import load_model
    from mocap.io.format import Hints
    from mocap.io.output import result_folder
    from mocap.io.plain import parse_columns
    from mocap.pipeline.job import Model, run_job
    from mocap.rerun.footage import offsets_of, open_movies, with_footage
    from mocap.rerun.record import recording_id, write_recording
    from mocap.rerun.watch import session
    from mocap.results.tables import write_run

    hints = Hints(cameras=cameras, columns=parse_columns(columns or ""), format=format_name, sheet=sheet)
    source = Source(
        tracks=tracks,
        fps=fps,
        coefficients=dlt,
        profile=profile,
        skeleton=skeleton,
        pixel_origin=origin,
        coefficient_origin=dlt_origin,
        image_height_px=image_height,
        stored_points=stored,
        pixel_sd=pixel_sd,
        in_step=in_step,
        unit=unit,
        hints=hints,
    )
    learned = None if model in get_args(Model) else load_model(existing_model(model))
    inputs = [*source.inputs, None if learned is None else Path(model)]
    movies = open_movies(video or [])
    if live and learned is not None:
        raise MocapError("--live filters with one motion model, not with a learned mixture: give --model auto")
    name = cast(Model, model) if learned is None else "auto"
    with session(say) if live else nullcontext() as watched:
        with result_folder(out, "track", replace=force, inputs=inputs, tell=say) as folder, progress() as stages:
            watch = None if watched is None else watched[0].watch
            run, _ = run_job(source, model=name, learned=learned, stages=stages, validated=validate, watch=watch)
            run = replace(run, report_text=f"{run.report_text}\n## The same again\n\n    {again()}\n")
            if movies:
                run = with_footage(run, movies, offsets=offsets_of(tracks, video_offset), straight=video_straight)
            with stages.stage("write"):
                write_run(run, folder, write_recording=write_recording)
        finish(run.report, run.report_text, out, as_json)
        if watched is not None:
            watched[0].show(out / "recording.rrd", recording_id(run))
            with suppress(KeyboardInterrupt):
                watched[1].wait()


def again() -> str:
    """The command as it was called, and with which version."""
    return f"{as_text(shlex.join(['mocap', *sys.argv[1:]]))}    # version {version('eal-mocap')}"


def existing_model(model: str) -> Path:
    """The file of a learned model.

    Raises:
        MocapError: there is none.
    """
    path = Path(model)
    if not path.is_file():
        raise MocapError(
            f"--model {model}: give auto, mixture, eal, constant_velocity, or a file that mocap learn wrote"
        )
    return path
