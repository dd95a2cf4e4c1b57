"""How far long work is, on a terminal, and how long each of its stages took."""

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import accumulate
from time import perf_counter
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


def as_one(tell: Tell, name: str, seconds: Mapping[str, float]) -> Tell:
    """Progress of stages as that of one piece of work, by the time that each stage usually takes.

    Args:
        tell: Told of the whole.
        name: Of the whole.
        seconds: Processor time of each stage, in order, as measured once; only their ratios count. A stage that
            nobody tells of is over when the next begins; one that is not among them takes no time.
    """
    total = sum(seconds.values())
    begins = dict(zip(seconds, accumulate(seconds.values(), initial=0.0), strict=False))

    def told(stage: str, share: float) -> None:
        if stage in begins:
            tell(name, (begins[stage] + share * seconds[stage]) / total)

    return told


@dataclass(kw_only=True)
class Stages:
    """Times stages, and tells somebody how far the current one is.

    Attributes:
        tell: Called with the name of the stage and the share done.
        seconds: Time that each stage took.
    """

    tell: Callable[[str, float], None] = lambda _stage, _share: None
    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[Callable[[float], None]]:
        """Time one stage; yields its progress callback."""
        start = perf_counter()
        self.tell(name, 0.0)
        yield lambda share: self.tell(name, share)
        self.tell(name, 1.0)
        self.seconds[name] = self.seconds.get(name, 0.0) + perf_counter() - start
