"""``res.cycles`` and ``batch.cycles``: a pandas table of cycles that can be asked for peaks and frequencies."""

from collections.abc import Callable, Sequence
from functools import partial

import pandas as pd

from mocap.errors import MocapError
from mocap.kinematics.cycles import Cycle, cycles_table
from mocap.kinematics.extremes import cycle_statistics, without_side
from mocap.kinematics.records import COUNTED, Kinematics
from mocap.sides import side_of

Peaks = Callable[[str | None], pd.DataFrame]
"""Statistics of one quantity, or of all, of all cycles."""


class CycleTable(pd.DataFrame):
    """A row a cycle, as ``cycles.csv`` has them; rows that are picked (``.query``, ``[...]``) can be asked the same."""

    _metadata = ["_peaks"]  # noqa: RUF012  # as pandas declares it
    _peaks: Peaks | None = None

    @property
    def _constructor(self) -> type["CycleTable"]:
        return CycleTable

    def peaks(self, quantity: str | None = None) -> pd.DataFrame:
        """Peak, trough, range, mean and time of the peak in each of these cycles, each with its interval.

        Doubtful cycles have the status ``doubtful`` (``mocap.kinematics.extremes.cycle_statistics``).

        Args:
            quantity: ``elbow_flexion_deg`` of both sides, ``elbow_l_flexion_deg`` of one; None: all angles, speeds,
                stated distances and areas.

        Raises:
            MocapError: there is no such quantity, or the table does not come from a recording or a batch.
        """
        if self._peaks is None:
            raise MocapError("these cycles come from no recording: ask `res.cycles` or `batch.cycles`")
        found = self._peaks(quantity)
        which = ["trial" if "trial" in self else "recording", "kind", "of", "number"]
        own = self[which].set_axis(["trial", "kind", "of", "cycle"], axis=1)
        own = pd.DataFrame(own).drop_duplicates()
        return found.merge(own, on=list(own.columns), how="inner")

    @property
    def counted(self) -> "CycleTable":
        """The rows that are not doubtful: those of means and figures."""
        return self[self["status"] == COUNTED]  # type: ignore[return-value]


def cycle_table(rows: Sequence[Cycle], found: Kinematics) -> CycleTable:
    """The table of a recording's cycles."""
    table = CycleTable(cycles_table(rows))
    table._peaks = partial(_of_recording, rows, found)
    return table


def _of_recording(rows: Sequence[Cycle], found: Kinematics, quantity: str | None) -> pd.DataFrame:
    return cycle_statistics(found, rows, quantity)


def stored_table(cycles: pd.DataFrame, peaks: Callable[[], pd.DataFrame]) -> CycleTable:
    """The table of many recordings' cycles, with that of their statistics, which is read when it is needed."""
    table = CycleTable(cycles)
    table._peaks = partial(_of_table, peaks)
    return table


def _of_table(peaks: Callable[[], pd.DataFrame], quantity: str | None) -> pd.DataFrame:
    """The rows of a quantity.

    Raises:
        MocapError: there are none.
    """
    found = peaks()
    if quantity is None:
        return found
    some = pd.DataFrame(found[found["quantity"] == without_side(quantity)])
    if quantity != without_side(quantity):
        some = pd.DataFrame(some[some["side"] == side_of(quantity)])
    if some.empty:
        near = ", ".join(found["quantity"].unique()[:8])
        raise MocapError(f"peaks.csv has no quantity {quantity!r}: it has {near or 'no rows'}")
    return some.reset_index(drop=True)
