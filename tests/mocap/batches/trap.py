"""A worker that dies at a trial, as one whose memory is used up."""

import os
import signal
from pathlib import Path

from distributed import Worker, WorkerPlugin

from mocap.batches import worker as here


class Trap(WorkerPlugin):
    """Kills a worker that is about to track a trial, so many times; the file counts."""

    def __init__(self, trial: str, times: int, counter: Path) -> None:
        """Set it."""
        self.trial, self.times, self.counter = trial, times, counter

    def setup(self, worker: Worker) -> None:
        """On every worker, also on those that replace others."""
        del worker
        track = here.track_trial

        def trapped(trial, *arguments, **options):
            if trial.name == self.trial and len(self.counter.read_text()) < self.times:
                with self.counter.open("a") as stream:
                    stream.write("x")
                os.kill(os.getpid(), signal.SIGKILL)
            return track(trial, *arguments, **options)

        here.track_trial = trapped
