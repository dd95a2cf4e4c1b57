"""What a worker does with a trial; Dask loads this module when a worker starts."""

import signal
import threading
from pathlib import Path
from time import perf_counter

from distributed import get_worker

from mocap.batches.one import track_trial
from mocap.batches.trial import Options, Record, Trial

TOPIC = "mocap-batch"
"""Under which workers say what they do."""


def dask_setup(_worker: object) -> None:
    """Leave Ctrl-C to the process that started the batch: it ends its workers."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def track_here(trial: Trial, options: Options, out: Path, again: bool) -> tuple[Record, float]:
    """How a trial went, and the seconds that it took; each stage is told once under ``TOPIC``."""
    worker = get_worker()

    def tell(stage: str) -> None:
        worker.log_event(TOPIC, {"worker": worker.address, "trial": trial.name, "stage": stage})

    begun = perf_counter()
    # tells each stage once
    last = ""

    def tell_once(stage: str, _share: float) -> None:
        nonlocal last
        if stage != last:
            last = stage
            tell(stage)

    record = track_trial(trial, options, out, again=again, progress=tell_once)
    return record, perf_counter() - begun
