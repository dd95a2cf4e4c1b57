"""How far long work is, on a terminal."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

Tell = Callable[[str, float], None]
"""Called with the name of a stage and the share of it that is done."""


def silent(_stage: str, _share: float) -> None:
    """Nobody is told of progress."""


@contextmanager
def bars(console: "Console | None" = None) -> Iterator[Tell]:
    """A bar a stage, gone at the end; where errors go to no terminal, as in a log or a notebook, nothing.

    Args:
        console: Where to; None: to errors.
    """
    if console is None and not sys.stderr.isatty():
        yield silent
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description:28}", markup=False), BarColumn(bar_width=24), TimeElapsedColumn())
    shown = console or Console(stderr=True)
    with Progress(*columns, TimeRemainingColumn(compact=True), console=shown, transient=True) as drawn:
        tasks: dict[str, TaskID] = {}

        def tell(stage: str, share: float) -> None:
            if stage not in tasks:
                tasks[stage] = drawn.add_task(stage, total=1.0)
            drawn.update(tasks[stage], completed=share)

        yield tell
