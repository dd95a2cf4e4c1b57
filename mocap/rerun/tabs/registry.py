"""Which tabs there are, in their order. A new one is a file beside this one and a line here."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import rerun as rr
import rerun.blueprint as rrb

from eal.plugins import described, left_out, offered
from mocap.rerun.layout import Layout
from mocap.rerun.tabs import angles, cameras, health, joints, lagrangian, overview, report
from mocap.tracking.result import Result


@runtime_checkable
class Tab(Protocol):
    """What the file of a tab holds."""

    def log(self, rec: rr.RecordingStream, run: Result, layout: Layout) -> None:
        """Log what the tab shows."""
        ...

    def tab(self, layout: Layout) -> rrb.Container | rrb.View | None:
        """Lay it out; None: this run has nothing for it."""
        ...


GROUP = "mocap.views"


@dataclass(frozen=True)
class TabElsewhere:
    """A tab of another package: where it fails it is left out, and named in a warning.

    Attributes:
        name: As the package offers it.
        own: The tab.
    """

    name: str
    own: Tab

    def log(self, rec: rr.RecordingStream, run: Result, layout: Layout) -> None:
        """Log what it shows, as far as it comes."""
        try:
            self.own.log(rec, run, layout)
        except KeyboardInterrupt:  # a person's
            raise
        except BaseException as error:  # sys.exit included
            left_out(GROUP, self.name, f"but it fails: {described(error)}")

    def tab(self, layout: Layout) -> rrb.Container | rrb.View | None:
        """Lay it out; None where it fails."""
        try:
            return self.own.tab(layout)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            left_out(GROUP, self.name, f"but it fails: {described(error)}")
            return None


ELSEWHERE = tuple(TabElsewhere(name, own) for name, own in offered(GROUP, Tab).items())
TABS: tuple[Tab, ...] = (angles, overview, cameras, joints, lagrangian, health, report, *ELSEWHERE)
