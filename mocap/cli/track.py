"""``mocap track``."""

import sys
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mocap.cli.console import progress, say, typed
from mocap.cli.options import Jobs, Out, PrintOptions, RecordingOptions, TrackingOptions, Views, with_records
from mocap.errors import FormatError, MocapError
from mocap.progress import Stages
from mocap.text import as_text

if TYPE_CHECKING:
    from mocap.recording import Recording


@dataclass(frozen=True, kw_only=True)
class VideoOptions:
    """Movies to show under the tracks."""

    video: Annotated[
        list[Path] | None,
        typer.Option(help="Video or folder of images to show under the tracks: one folder of all, or one per camera."),
    ] = None
    video_offset: Annotated[
        list[int] | None,
        typer.Option(
            help="Frame of the video minus frame of the tracks, once or per camera. Default: as the project states."
        ),
    ] = None
    video_undistorted: Annotated[
        bool,
        typer.Option("--video-undistorted", "--video-straight", help="The videos are already free of lens distortion."),
    ] = False


@with_records
def track(
    tracks: Views,
    out: Out,
    recording_options: RecordingOptions,
    movies: VideoOptions,
    tracking: TrackingOptions,
    printed: PrintOptions,
    blocks: Annotated[
        int | None,
        typer.Option(
            help="Track in blocks of this many frames, to save memory; 0: all at once. Default: 4000 above 20,000.",
            min=0,
        ),
    ] = None,
    jobs: Jobs = None,
) -> None:
    """Track a recording: clean it, fill its gaps, smooth it, each value with a 95 % interval; tables, figures, viewer.

    Example: mocap track bat_xypts.csv --calibration bat_dltCoefs.csv --fps 500 --skeleton bat.toml --out out/bat
    """
    import mocap
    from mocap.cli.closing import finish
    from mocap.io.output import result_folder
    from mocap.tracking.track_part import MODELS, existing_model

    model, force = tracking.model, printed.force
    how = {"validate": tracking.validate, "seed": tracking.seed}
    learned = None if model in MODELS else mocap.load_model(existing_model(model))
    with progress() as tell, Stages(tell=tell).stage(recording_options.stage):
        recording = on_disk(tracks, recording_options, blocks) or recording_options.read(tracks)
    opened = []
    if movies.video:
        from mocap.io.movies import open_movies

        opened = open_movies(movies.video)
    inputs = [*recording.inputs, None if learned is None else Path(model)]
    size = block_size(recording, blocks)
    if size and opened:
        raise MocapError(
            f"--video shows recordings that are tracked at once, not in blocks of {size} frames: add --blocks 0, or "
            "leave it out"
        )
    footer = f"\n## Command that repeats this run\n\n    {again()}\n"
    with (
        result_folder(out, "track", replace=force, inputs=inputs, tell=say) as folder,
        progress() as tell,
        mocap.processes(jobs),
    ):
        if size:
            from mocap.results.long_result import write_in_blocks

            record = None if learned is None else learned.learned
            result = write_in_blocks(
                recording,
                folder,
                model=model,
                learned=record,
                size=size,
                footer=footer,
                progress=tell,
                **how,
            )
        else:
            result = mocap.track(recording, model=learned or model, progress=tell, **how)
            result = result.with_report(footer)
            if opened:
                result = result.with_video(
                    opened, offset_frames=movies.video_offset, undistorted=movies.video_undistorted
                )
            result.write(folder, progress=tell)
    cycles = result.skeleton.measures.cyclic and not size and (out / "cycles.csv").exists()
    told = [f"{one.number}: {one.meaning}" for one in result.frequencies] or result.why_no_cycles if cycles else []
    finish(result.report, result.report_text, out, as_json=printed.as_json, verbose=printed.verbose, cycles=told)


def block_size(recording: "Recording", requested: int | None) -> int:
    """Frames of a block; 0: the whole at once."""
    from mocap.recording import BLOCK, LONG

    if requested is not None:
        return requested
    frames = len(recording.t_s)
    if frames <= LONG:
        return 0
    say(f"{recording.name}: {frames} frames are tracked in blocks of {BLOCK} (--blocks 0: the whole at once)")
    return BLOCK


def on_disk(tracks: list[Path], options: RecordingOptions, blocks: int | None) -> "Recording | None":
    """A long Parquet table of positions alone, to be read by range; None: it is something else, or is not long."""
    from mocap.io.tables_long import LongTable
    from mocap.recording import LONG
    from mocap.tracking.blocks import OnDisk

    if len(tracks) != 1 or tracks[0].suffix != ".parquet" or not tracks[0].is_file() or blocks == 0:
        return None
    if any(one is not None for one in (options.calibration, options.fps, options.unit, options.point_sd_mm)):
        return None
    try:
        frames = LongTable(tracks[0]).n_frames
    except FormatError:
        return None  # pixels, or another table: read as any file
    return None if frames <= LONG and blocks is None else OnDisk.of(tracks[0], options.skeleton)


def again() -> str:
    """The command as it was called, and with which version."""
    return f"{as_text(typed('mocap', *sys.argv[1:]))}    # version {version('eal-mocap')}"
