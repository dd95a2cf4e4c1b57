"""``mocap demo``."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from mocap.cli.console import finish, progress, say
from mocap.cli.options import AsJson, Force, Out


class Animal(StrEnum):
    """Built-in recordings."""

    bat = "bat"
    lizard = "lizard"


def demo(
    animal: Annotated[Animal, typer.Argument(help="Built-in recording.")] = Animal.bat,
    out: Out = Path("out/demo"),
    seed: Annotated[int, typer.Option(min=0, help="Which flight or walk.")] = 0,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Run the main job on a built-in recording, and compare with its truth."""
    from mocap.io.output import result_folder
    from mocap.pipeline.demo import run_demo
    from mocap.rerun.record import write_recording
    from mocap.results.tables import write_run

    with result_folder(out, "track", replace=force, tell=say) as folder, progress() as stages:
        run = run_demo(animal.value, stages=stages, seed=seed)
        with stages.stage("write"):
            write_run(run, folder, write_recording=write_recording)
    finish(run.report, run.report_text, out, as_json)
