"""``mocap digitise``."""

import json
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from mocap.cli.console import program, progress, say, show, typed
from mocap.cli.options import AsJson, Crop, Force, Fps, Out, Profile, UntilIdle, seconds
from mocap.errors import MocapError


def digitise(
    videos: Annotated[
        list[Path],
        typer.Argument(help="A video (or folder of images) for each camera, in their order; or a folder of videos."),
    ],
    calibration: Annotated[
        Path, typer.Option("--calibration", "--dlt", help="Calibration of the cameras, in any format.")
    ],
    skeleton: Annotated[Path, typer.Option(help="Skeleton in TOML: markers, rigid bones, trunk.")],
    out: Out,
    start: Annotated[
        Path | None,
        typer.Option(
            help="First clicks, as DLTdv's xypts: each marker in two or more cameras in one frame; clicks in other "
            "frames are taken too. With --web it may be left out."
        ),
    ] = None,
    model: Annotated[Path | None, typer.Option(help="A model that mocap learn wrote of this kind of animal.")] = None,
    budget: Annotated[int, typer.Option(min=0, help="How many clicks to ask for next (asked.csv).")] = 40,
    error_px: Annotated[
        float, typer.Option(min=0.1, help="Clicks are asked for where a marker is known worse than that, in pixels.")
    ] = 1.0,
    profile: Profile = None,
    fps: Fps = None,
    offset: Annotated[
        list[int] | None,
        typer.Option(
            "--video-offset", help="Frame of the video minus frame of the tracks; once for all cameras, or for each."
        ),
    ] = None,
    crop: Crop = None,
    web: Annotated[
        bool,
        typer.Option("--web", help="Click in the browser, on 127.0.0.1 only; each click is saved at once in --out."),
    ] = False,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of the page; 0: any that is free.")] = 0,
    until_idle: UntilIdle = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Find and name markers in videos from a few clicks; say which clicks would help most."""
    import mocap
    from mocap.digitising.write import report_text
    from mocap.io.output import result_folder

    given: dict[str, Any] = {
        "calibration": calibration,
        "skeleton": skeleton,
        "model": model,
        "profile": profile,
        "fps": fps,
        "offset_frames": offset,
        "crop": crop,
        "error_px": error_px,
    }
    if web:
        from mocap.batches.trial import Options
        from mocap.desk.desk import Desk
        from mocap.desk.page import desk_page
        from mocap.desk.session import SAVED, open_session
        from mocap.io.manifest import occupied
        from mocap.web.server import served

        words = [word for word in sys.argv[1:] if word != "--web"]  # of two --start the last one counts
        same = typed(*program(), *words, "--start", out / SAVED, "--force")
        with occupied(out, "mocap digitise --web"):
            session = open_session(videos, folder=out, start=start, command=same, **given)
            desk = Desk(out=out, trials={}, options=Options(), proof=session)
            with served(desk_page(desk), port=port) as page:
                say(
                    f"Click at {page.address} (Ctrl-C here ends it; clicks are saved in {out} one by one)",
                    "Who has this address can see the videos and change the clicks: keep it to yourself.",
                )
                page.wait(idle_s=seconds(until_idle))
            say(f"The page ended ({page.why}); clicks are saved in {out}")
        if session.found is not None:
            with result_folder(out, "digitise", replace=True, beside=True, tell=say) as folder:
                session.found.write(folder, most=budget)
            say(f"Wrote {out}/: xypts.csv, xyzpts.csv, clicks_xypts.csv, asked.csv, origin.csv, report.md, calibration")
        return
    if start is None:
        raise MocapError("--start is missing: give first clicks (DLTdv's xypts), or click in the browser with --web")
    inputs = [*videos, calibration, skeleton, start, model, profile, *(crop or [])]
    with result_folder(out, "digitise", replace=force, inputs=inputs, tell=say) as folder, progress() as tell:
        result = mocap.digitise(videos, start=start, progress=tell, **given)
        result.write(folder, most=budget)
    if as_json:
        print(json.dumps(result.report))  # noqa: T201
        return
    show(report_text(result.report, result.questions(budget), result.engine.names))
    tracks = out / "xypts.csv"
    cameras = next(path for path in (out / "calibration.toml", out / "dltCoefs.csv") if path.is_file())
    track = (*program(), "track", tracks, "--calibration", cameras, "--skeleton", out / "skeleton.toml")
    say(
        "",
        f"Wrote {out}/: xypts.csv, xyzpts.csv, clicks_xypts.csv, asked.csv, origin.csv, report.md, calibration",
        f"Track it: {typed(*track)} --fps {result.fps:g} --out ...",
    )
