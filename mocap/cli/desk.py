"""``mocap desk``."""

import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from mocap.cli.console import say
from mocap.cli.options import LimitS, RecordingOptions, TrackingOptions, UntilIdle, seconds, with_records


@with_records
def desk(
    recording_options: RecordingOptions,
    tracking: TrackingOptions,
    sources: Annotated[
        list[str] | None,
        typer.Argument(metavar="FOLDER", help="Folder with trials, as for mocap batch. Default: this folder."),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder of results and corrections.")] = Path("out/desk"),
    jobs: Annotated[int, typer.Option(min=1, help="Trials that are tracked at a time.")] = 2,
    limit_s: LimitS = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of the page; 0: any that is free.")] = 0,
    until_idle: UntilIdle = None,
) -> None:
    """Open trials, track them, proof-read what is uncertain and pass it on, in the browser on this computer only.

    Example: mocap desk data/ --calibration data/dltCoefs.csv --fps 500 --skeleton bat.toml
    """
    from mocap.desk.shell import shell
    from mocap.web.server import Behind, forwarded, served

    behind = Behind(shell())
    with served(behind, port=port) as page, forwarded(page.address) as link:
        say(
            f"The desk is at {page.address} (Ctrl-C here ends it; each correction is kept in {out} at once)",
            "Who has this address can see the recordings and change the corrections: keep it to yourself.",
        )
        webbrowser.open(link)
        from mocap.side_by_side import context_of

        context_of("mocap.batches.find")  # it imports while this process does
        from mocap.batches.run import checked_model
        from mocap.batches.trial import Options
        from mocap.desk.desk import opened_desk
        from mocap.desk.page import desk_page

        options = Options(model=checked_model(tracking.model), validate=tracking.validate, seed=tracking.seed)
        with opened_desk(
            sources or ["."],
            out,
            options=options,
            jobs=jobs,
            limit_s=limit_s,
            arguments=recording_options.arguments(),
            behind=True,
        ) as opened:
            behind.becomes(desk_page(opened))
            looked = opened.looked
            looked.add_done_callback(lambda done: page.end("there is nothing to open") if done.exception() else None)
            page.wait(idle_s=seconds(until_idle), works=lambda: bool(opened.progress()["running"]))
            if looked.done() and not opened.trials:
                looked.result()  # why there are none
    say(f"The desk ended ({page.why}); what was corrected and tracked is in {out}")
