"""The command line: ``mocap``."""

import json
import shutil
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import Annotated, cast, get_args

import typer
from rich.console import Console
from rich.markdown import Markdown
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from app.main_job import Stages
from app.source import Source
from mocap.errors import MocapError

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Motion capture of animals: clean marker tracks, gaps filled with honest uncertainty, empirical potentials.",
)
errors = Console(stderr=True)


class PixelOrigin(StrEnum):
    """Where pixel rows are counted from."""

    upper_left = "upper-left"
    lower_left = "lower-left"


class Animal(StrEnum):
    """Built-in recordings."""

    bat = "bat"
    lizard = "lizard"


Tracks = Annotated[Path, typer.Argument(help="DLTdv xypts file; for track also xyzpts, without --dlt.")]
Dlt = Annotated[Path | None, typer.Option("--dlt", help="DLT coefficients: 11 rows, a column a camera.")]
Profile = Annotated[
    Path | None, typer.Option(help="Camera profile, a line a camera: cam f W H cx cy AR k1 k2 p1 p2 k3.")
]
PixelOriginOption = Annotated[
    PixelOrigin | None,
    typer.Option("--origin", help="Corner that pixel rows are counted from; if not given, found by the residual."),
]
DltOrigin = Annotated[PixelOrigin | None, typer.Option(help="The same for the coefficients, if it differs.")]
ImageHeight = Annotated[float | None, typer.Option(help="Image height in pixels, to flip rows without a profile.")]
Fps = Annotated[float | None, typer.Option(help="Frames per second; the files do not hold it.")]
SkeletonFile = Annotated[Path | None, typer.Option("--skeleton", help="Skeleton in TOML: markers, bones, joints.")]
PixelSd = Annotated[float | None, typer.Option(help="Standard deviation of a pixel; if not given, estimated.")]
Force = Annotated[bool, typer.Option("--force", help="Replace what exists.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON, for machines.")]
Out = Annotated[Path, typer.Option(help="Folder to write.")]


@app.command()
def triangulate(
    tracks: Tracks,
    out: Annotated[Path, typer.Option(help="xyzpts file to write.")],
    dlt: Dlt = None,
    profile: Profile = None,
    origin: PixelOriginOption = None,
    dlt_origin: DltOrigin = None,
    image_height: ImageHeight = None,
    pixel_sd: PixelSd = None,
    refine: Annotated[
        bool, typer.Option("--refine", help="Smallest reprojection error, bad rays rejected, with _sd columns.")
    ] = False,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Pixels to points: DLTdv's linear least squares, nothing cleaned; --refine for better."""
    from app.triangulate import triangulate_file

    if dlt is None and tracks.suffix.lower() != ".mat":
        raise MocapError(f"{tracks.name}: pixels need the coefficients of their cameras: give --dlt")
    source = Source(
        tracks=tracks,
        fps=1.0,
        coefficients=dlt,
        profile=profile,
        pixel_origin=origin.value if origin else None,
        coefficient_origin=dlt_origin.value if dlt_origin else None,
        image_height_px=image_height,
        pixel_sd=pixel_sd,
    )
    summary = triangulate_file(source, out, refine=refine, force=force)
    if as_json:
        print(json.dumps({"out": str(out), **asdict(summary)}))  # noqa: T201
        return
    for finding in summary.findings:
        errors.print(finding, highlight=False, soft_wrap=True)
    errors.print(
        f"{out}: {summary.points} of {summary.samples} samples triangulated, residual {summary.residual_px:.2f} px",
        highlight=False,
        soft_wrap=True,
    )


@app.command()
def track(
    tracks: Tracks,
    out: Out,
    dlt: Dlt = None,
    fps: Fps = None,
    profile: Profile = None,
    skeleton: SkeletonFile = None,
    origin: PixelOriginOption = None,
    dlt_origin: DltOrigin = None,
    image_height: ImageHeight = None,
    stored: Annotated[Path | None, typer.Option(help="xyzpts to audit; if not given, the one beside xypts.")] = None,
    pixel_sd: PixelSd = None,
    model: Annotated[
        str,
        typer.Option(
            help="File that mocap learn wrote; or eal, constant_velocity, or auto: what fills hidden samples better."
        ),
    ] = "auto",
    validate: Annotated[bool, typer.Option(help="Hide samples and measure how they are filled.")] = True,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Clean, fill and smooth a recording; learn the potentials of its joints; write tables and a rerun recording."""
    from app.main_job import Model, run_job
    from app.tables import check_target, write_run
    from app.view.record import write_recording
    from filters.model_file import load_model

    if fps is None:
        raise MocapError(f"{tracks.name}: frames per second are not in the file: give --fps")
    source = Source(
        tracks=tracks,
        fps=fps,
        coefficients=dlt,
        profile=profile,
        skeleton=skeleton,
        pixel_origin=origin.value if origin else None,
        coefficient_origin=dlt_origin.value if dlt_origin else None,
        image_height_px=image_height,
        stored_points=stored,
        pixel_sd=pixel_sd,
    )
    learned = None if model in get_args(Model) else load_model(existing_model(model))
    check_target(out, force=force, inputs=[*source.inputs, None if learned is None else Path(model)])
    name = cast(Model, model) if learned is None else "auto"
    with progress() as stages:
        run, _ = run_job(source, model=name, learned=learned, stages=stages, validated=validate)
        with stages.stage("write"):
            write_run(run, out, write_recording=write_recording, force=force)
    finish(run.report, run.report_text, out, as_json)


@app.command()
def learn(
    trials: Annotated[list[Path], typer.Argument(help="Recordings: xypts or xyzpts files, or DLTdv8 projects (.mat).")],
    out: Annotated[Path, typer.Option(help="Model to write (.npz).")],
    dlt: Dlt = None,
    fps: Fps = None,
    profile: Profile = None,
    skeleton: SkeletonFile = None,
    origin: PixelOriginOption = None,
    dlt_origin: DltOrigin = None,
    image_height: ImageHeight = None,
    pixel_sd: PixelSd = None,
    seed: Annotated[int, typer.Option(min=0, help="Which samples are hidden to choose and to calibrate.")] = 0,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Learn a motion model from several recordings, to track others with: mocap track FILE --model MODEL.

    Cameras, profile and skeleton are those of all the recordings. How the model fills gaps is measured on samples that
    were hidden from it, and printed.
    """
    from app.learning import learn_from, readable_scores
    from app.tables import check_target
    from filters.model_file import save_model
    from mocap.formats.dltdv import holds_pixels

    if fps is None:
        raise MocapError("frames per second are not in the files: give --fps")
    sources = [
        Source(
            tracks=tracks,
            fps=fps,
            coefficients=dlt if tracks.suffix.lower() == ".mat" or holds_pixels(tracks) else None,
            profile=profile,
            skeleton=skeleton,
            pixel_origin=origin.value if origin else None,
            coefficient_origin=dlt_origin.value if dlt_origin else None,
            image_height_px=image_height,
            pixel_sd=pixel_sd,
        )
        for tracks in trials
    ]
    inputs = [path for source in sources for path in source.inputs]
    check_target(out, force=force, inputs=inputs, folder=False)
    learned = learn_from(
        sources, seed=seed, tell=lambda line: errors.print(line, highlight=False, soft_wrap=True, markup=False)
    )
    save_model(learned, out)
    if as_json:
        print(json.dumps({"out": str(out), "scores": learned.scores}))  # noqa: T201
        return
    Console().print(Markdown(readable_scores(learned)))
    errors.print(
        f"\nWrote {out}. Track another recording with it: {program()} track FILE ... --model {out}", highlight=False
    )


def existing_model(model: str) -> Path:
    """The file of a learned model.

    Raises:
        MocapError: there is none.
    """
    path = Path(model)
    if not path.is_file():
        raise MocapError(f"--model {model}: give auto, eal, constant_velocity, or a file that mocap learn wrote")
    return path


@app.command()
def demo(
    animal: Annotated[Animal, typer.Argument(help="Built-in recording.")] = Animal.bat,
    out: Out = Path("out/demo"),
    seed: Annotated[int, typer.Option(min=0, help="Which flight or walk.")] = 0,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Run the main job on a built-in recording, and compare with its truth."""
    from app.demo import run_demo
    from app.tables import check_target, write_run
    from app.view.record import write_recording

    check_target(out, force=force)
    with progress() as stages:
        run = run_demo(animal.value, stages=stages, seed=seed)
        with stages.stage("write"):
            write_run(run, out, write_recording=write_recording, force=force)
    finish(run.report, run.report_text, out, as_json)


@app.command()
def view(
    run: Annotated[Path, typer.Argument(help="Folder that track or demo wrote, or a .rrd file.")],
    web: Annotated[bool, typer.Option("--web", help="In the browser instead of a window.")] = False,
) -> None:
    """Open a run in rerun, on 127.0.0.1 only."""
    import webbrowser

    from app.view.viewer import open_viewer

    path = run / "recording.rrd" if run.is_dir() else run
    if not path.is_file():
        raise MocapError(f"{path}: there is no recording: give a folder that mocap track or mocap demo wrote")
    viewer = open_viewer(path, web=web)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # a terminated command ends its viewer too
    try:
        if viewer.url:
            errors.print(f"{viewer.url}\nCtrl-C to stop.", highlight=False, soft_wrap=True)
            webbrowser.open(viewer.url)
        viewer.wait()
    except KeyboardInterrupt:
        pass
    finally:
        viewer.close()


@app.command()
def reproduce(
    figures: Annotated[list[str] | None, typer.Argument(help="Figures of the paper, such as 14a; none: all.")] = None,
    out: Out = Path("out/reproduce"),
    quick: Annotated[bool, typer.Option("--quick", help="Coarser grids and fewer seeds.")] = False,
    real: Annotated[
        Path | None,
        typer.Option(envvar="MOCAP_REAL_DATA", help="Folder of real recordings: draws figure 7 for one too."),
    ] = None,
    force: Force = False,
) -> None:
    """Reproduce the figures of the EAL paper: pictures, tables, and a verdict on every claim."""
    from app.reproduce import FIGURES
    from app.reproduce import reproduce as make_figures
    from app.reproduce.samples import real_bat_samples
    from app.tables import check_target

    for name in figures or []:
        if name.lower().removeprefix("fig") not in FIGURES:
            raise MocapError(f"there is no figure {name!r}: the figures are {', '.join(FIGURES)}")
    check_target(out, force=force)
    verdicts = make_figures(
        figures or None,
        out,
        quick,
        lambda line: errors.print(line, highlight=False, soft_wrap=True, markup=False),
        real_bat_m=None if real is None else real_bat_samples(real),
    )
    errors.print(
        f"\nWrote {out}/: {len(verdicts)} verdicts in verdicts.json, figures and their numbers", highlight=False
    )


@contextmanager
def progress() -> Iterator[Stages]:
    """A bar a stage, on stderr, where that is a terminal."""
    columns = (TextColumn("{task.description:28}"), BarColumn(bar_width=24), TimeElapsedColumn())
    with Progress(*columns, console=errors, disable=not errors.is_terminal) as bars:
        tasks: dict[str, int] = {}

        def tell(stage: str, share: float) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=1.0)
            bars.update(tasks[stage], completed=share)  # type: ignore[arg-type]

        yield Stages(tell=tell)


def finish(report: object, text: str, out: Path, as_json: bool) -> None:
    """Say what was found and written."""
    if as_json:
        print(json.dumps(report))  # noqa: T201
        return
    Console().print(Markdown(text))
    errors.print(
        f"\nWrote {out}/: markers.csv, joints.csv, report.json, report.md, potentials, recording.rrd\n"
        f"Look at it: {program()} view {out}   (in the browser: {program()} view {out} --web)",
        highlight=False,
        soft_wrap=True,
    )


def program() -> str:
    """This command as its user can call it again."""
    found = shutil.which("mocap")
    called = Path(sys.argv[0])
    return "mocap" if found is not None and Path(found).resolve() == called.resolve() else str(called)


def main() -> None:
    """Run, and turn trouble that a user can mend into one line and exit code 1."""
    try:
        app(standalone_mode=True)
    except MocapError as error:
        errors.print(f"error: {error}", style="red", highlight=False, soft_wrap=True, markup=False)
        sys.exit(1)
