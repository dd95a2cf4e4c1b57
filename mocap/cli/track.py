"""``mocap track``."""

import shlex
import sys
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import typer

from mocap.cli.console import finish, progress, say
from mocap.cli.options import AsJson, Force, Out, RecordingOptions, Views
from mocap.cli.records import with_records
from mocap.errors import MocapError
from mocap.text import as_text

MODELS = ("auto", "mixture", "eal", "constant_velocity")


@dataclass(frozen=True, kw_only=True)
class VideoOptions:
    """Movies to show under the tracks."""

    video: Annotated[
        list[Path] | None,
        typer.Option(
            help="Movie (or folder of pictures) to show under the tracks; give the option once for each camera, in "
            "the order of the cameras, or once with a folder that contains them, sorted by name."
        ),
    ] = None
    video_offset: Annotated[
        list[int] | None,
        typer.Option(
            help="Frame of the movie minus frame of the tracks; give it once for all cameras, or once for each; if "
            "not given, as the project or the offsets file beside the tracks states."
        ),
    ] = None
    video_undistorted: Annotated[
        bool,
        typer.Option(
            "--video-undistorted", "--video-straight", help="The movies are already corrected for lens distortion."
        ),
    ] = False


@with_records
def track(
    tracks: Views,
    out: Out,
    stated: RecordingOptions,
    movies: VideoOptions,
    stored: Annotated[
        Path | None, typer.Option(help="Stored 3D points (xyzpts) to check; if not given, those beside the xypts file.")
    ] = None,
    correct_lag: Annotated[
        bool,
        typer.Option(
            "--correct-lag",
            "--in-step",
            help="Correct cameras that the audit finds not synchronised, by interpolation between frames.",
        ),
    ] = False,
    model: Annotated[
        str,
        typer.Option(
            help="A file that mocap learn wrote, or mixture, eal or constant_velocity; auto: the one that fills "
            "hidden samples best."
        ),
    ] = "auto",
    live: Annotated[
        bool,
        typer.Option(
            "--live", help="Show frames while they are filtered, then the whole run, until you close the viewer."
        ),
    ] = False,
    validate: Annotated[bool, typer.Option(help="Hide some samples and measure how well they are filled.")] = True,
    fit_lens: Annotated[
        bool,
        typer.Option(
            "--fit-lens",
            help="Estimate radial lens distortion from the recording, where no lens is given, and correct it.",
        ),
    ] = False,
    mm_per_px: Annotated[
        float | None,
        typer.Option(help="Scale of one film without a calibration, in its plane; if not given, positions are pixels."),
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Clean, fill and smooth a recording; learn the potentials of its joints; write tables and a rerun recording."""
    import mocap
    from mocap.io.output import result_folder
    from mocap.rerun.footage import open_movies
    from mocap.rerun.watch import session

    recording = stated.read(
        tracks, stored_points=stored, correct_lag=correct_lag, fit_lens=fit_lens, mm_per_px=mm_per_px
    )
    learned = None if model in MODELS else mocap.load_model(existing_model(model))
    opened = open_movies(movies.video or [])
    if live and learned is not None:
        raise MocapError("--live filters with one motion model, not with a learned mixture: give --model auto")
    inputs = [*recording.inputs, None if learned is None else Path(model)]
    with session(say) if live else nullcontext() as watched:
        with result_folder(out, "track", replace=force, inputs=inputs, tell=say) as folder, progress() as tell:
            result = mocap.track(
                recording,
                model=learned or model,
                validate=validate,
                progress=tell,
                watch=None if watched is None else watched[0].watch,
            )
            result = result.with_report(f"\n## Command that repeats this run\n\n    {again()}\n")
            if opened:
                result = result.with_video(
                    opened, offset_frames=movies.video_offset, undistorted=movies.video_undistorted
                )
            result.write(folder, progress=tell)
        finish(result.report, result.run.report_text, out, as_json)
        if watched is not None:
            watched[0].show(out / "recording.rrd", result.recording_id)
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
