"""How far long work is, on a terminal, and how long each of its stages took."""

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from time import monotonic, perf_counter
from typing import TYPE_CHECKING

from eal.efforts import shares

if TYPE_CHECKING:
    from rich.console import Console

Tell = Callable[[str, float], None]
"""Called with the name of a stage and the share of it that is done."""


def silent(_stage: str, _share: float) -> None:
    """Nobody is told of progress."""


def left_s(spent_s: float, share: float) -> float | None:
    """Seconds that a whole still takes, of which a share was done in so many; None: too early to say."""
    return spent_s * (1.0 / share - 1.0) if share > 0.0 else None


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
    from rich.progress import BarColumn, Progress, Task, TaskID, TextColumn, TimeElapsedColumn
    from rich.text import Text

    class Left(TextColumn):  # rich's own looks at the last 30 s alone
        def render(self, task: Task) -> Text:
            seconds = None if task.finished else left_s(task.elapsed or 0.0, task.percentage / 100.0)
            return Text("" if seconds is None else f"{in_words(seconds)} left", style="progress.remaining")

    columns = (TextColumn("{task.description:28}", markup=False), BarColumn(bar_width=24), TimeElapsedColumn())
    shown = console or Console(stderr=True)
    with Progress(*columns, Left(""), console=shown, transient=True) as drawn:
        tasks: dict[str, TaskID] = {}

        def tell(stage: str, share: float) -> None:
            if stage not in tasks:
                tasks[stage] = drawn.add_task(stage, total=1.0)
            drawn.update(tasks[stage], completed=share)

        yield tell


def lines(say: Callable[[str], None], *, clock: Callable[[], float] = monotonic) -> Tell:
    """What says each stage as a line, with the share that is done and the time that it still takes; by whole per cents.

    Args:
        say: Called with a line.
        clock: Seconds.
    """
    begun: dict[str, float] = {}
    said = ""

    def tell(stage: str, share: float) -> None:
        nonlocal said
        now = clock()
        left = left_s(now - begun.setdefault(stage, now), share)
        done = f"{stage}, {100 * share:.0f} %" if share else stage
        if done != said:
            said = done
            say(done if left is None or share == 1.0 else f"{done}, about {in_words(left)} left")

    return tell


def in_words(seconds: float) -> str:
    """``70 s``, ``3 min``, ``2.5 h``: whole up to 99."""
    for unit, size in (("s", 1.0), ("min", 60.0)):
        if seconds < 99.5 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds / 3600.0:.1f} h"


def as_one(tell: Tell, name: str, seconds: Mapping[str, float]) -> Tell:
    """Progress of stages as that of one piece of work, by the time that each stage usually takes.

    Args:
        tell: Told of the whole.
        name: Of the whole.
        seconds: Processor time of each stage, in order, as measured once; only their ratios count. A stage that
            nobody tells of is over when the next begins; one that is not among them takes no time.
    """
    parts = dict(zip(seconds, shares(partial(tell, name), [*seconds.values()]), strict=True))

    def told(stage: str, share: float) -> None:
        if (part := parts.get(stage)) is not None:
            part(share)

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
