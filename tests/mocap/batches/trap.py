"""Workers that die at a trial, as those whose memory is used up, or stop there."""

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


HOLD = """
import multiprocessing, pathlib, sys, time

ended = []

def hold(event, arguments):
    if event != "open" or multiprocessing.parent_process() is None:
        return
    if str(arguments[0]).endswith("trial.json") and arguments[1] == "w":
        ended.append(arguments[0])
    elif ended and str(arguments[0]).endswith(("_xypts.csv", "_xyzpts.csv")):
        pathlib.Path({!r}).touch()
        time.sleep(1e6)

sys.addaudithook(hold)
"""


def second_held(folder: Path) -> Path:
    """A folder for ``PYTHONPATH``: with it processes write ``held`` and stop where they would read the second trial."""
    place = folder / "held_by"
    place.mkdir()
    (place / "sitecustomize.py").write_text(HOLD.format(str(place / "held")))
    return place
