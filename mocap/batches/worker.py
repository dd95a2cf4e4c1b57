"""What becomes of a trial in a process: how it went, whatever happens there."""

from collections.abc import Sequence
from pathlib import Path
from time import perf_counter

from eal.threads import one_blas_thread
from mocap.batches.one import basic_columns, track_trial
from mocap.batches.time_left import told_whole
from mocap.batches.trial import Options, Record, Trial, why_failed
from mocap.findings import Finding
from mocap.side_by_side import Hear


def track_here(
    trial: Trial,
    options: Options,
    out: Path,
    again: bool,
    siblings: Sequence[Finding] = (),
    *,
    progress: Hear | None = None,
) -> tuple[Record, float | None]:
    """How a trial went, and the seconds that it took (None: the failure was not of the data).

    Args:
        trial: It.
        options: How it is tracked.
        out: Folder of results.
        again: Whether it is tracked, too, if that has been done.
        siblings: What the other trials tell of it.
        progress: Told each stage and the share of the whole that is done, at most a hundred times more.
    """
    begun, last = perf_counter(), ("", 0.0)

    def tell(stage: str, share: float) -> None:
        nonlocal last
        if progress is not None and (stage != last[0] or share >= last[1] + 0.01):
            last = stage, share
            progress(stage, share)

    try:
        with one_blas_thread():  # a result is the same whatever else the machine does
            record = track_trial(trial, options, out, again=again, siblings=siblings, progress=told_whole(tell))
    except Exception as error:  # whatever it was, the other trials go on
        return failed(trial, why_failed(error)), None
    return record, perf_counter() - begun


def failed(trial: Trial, error: str) -> Record:
    """A trial that is to be tried again."""
    return Record(trial=trial.name, status="failed", error=error, row=basic_columns(trial))
