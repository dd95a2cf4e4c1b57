"""What commands say: progress, findings, what was written."""

import json
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.markdown import Markdown
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from app.main_job import Stages

errors = Console(stderr=True)


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


def announce(line: str) -> None:
    """Say a line on stderr."""
    errors.print(line, highlight=False, soft_wrap=True, markup=False)


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
