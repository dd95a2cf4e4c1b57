"""Which tabs there are, in their order. A new one is a file beside this one and a line here."""

from typing import Protocol, runtime_checkable

import rerun as rr
import rerun.blueprint as rrb

from eal.plugins import offered
from mocap.pipeline.result import Result
from mocap.rerun.layout import Layout
from mocap.rerun.tabs import angles, cameras, health, joints, lagrangian, overview, report


@runtime_checkable
class Tab(Protocol):
    """What the file of a tab holds."""

    def log(self, rec: rr.RecordingStream, run: Result, layout: Layout) -> None:
        """Log what the tab shows."""
        ...

    def tab(self, layout: Layout) -> rrb.Container | rrb.View | None:
        """Lay it out; None: this run has nothing for it."""
        ...


ELSEWHERE = offered("mocap.views", Tab).values()
TABS: tuple[Tab, ...] = (angles, overview, cameras, joints, lagrangian, health, report, *ELSEWHERE)
