"""``mocap demo``."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from mocap.cli.console import program, progress, say, show_text, typed
from mocap.cli.options import AsJson, Force, Jobs, Out, Verbose


class DemoAnimal(StrEnum):
    """Built-in recordings."""

    bat = "bat"
    lizard = "lizard"


NEXT = "Next, with your own files: {mocap} info FILES   (what is in them, and what is wrong)"
"""After the demo the second of the five commands that ``mocap`` alone lists."""


def demo(
    animal: Annotated[DemoAnimal, typer.Argument(help="Built-in recording.")] = DemoAnimal.bat,
    out: Out = Path("out/demo"),
    seed: Annotated[int, typer.Option(min=0, help="Which flight or walk.")] = 0,
    jobs: Jobs = None,
    force: Force = False,
    as_json: AsJson = False,
    verbose: Verbose = False,
) -> None:
    """Track a built-in synthetic recording, and compare the result with its ground truth."""
    from mocap import Tracked, processes
    from mocap.cli.closing import finish
    from mocap.io.output import result_folder
    from mocap.progress import Stages
    from mocap.report.demo import run_demo

    with result_folder(out, "track", replace=force, tell=say) as folder, progress() as tell, processes(jobs):
        result = Tracked.of(run_demo(animal.value, stages=Stages(tell=tell), seed=seed))
        result.write(folder, progress=tell)
    finish(result.report, result.report_text, out, as_json=as_json, verbose=verbose)
    if not as_json:
        show_text(f"\n{NEXT.format(mocap=typed(*program()))}")
