"""The workers of a batch are killed, and the batch must end all the same.

A point is a way of killing at a moment: ``mocap batch`` tracks short simulated recordings with two processes, and from
so many finished trials on its workers get SIGKILL. However that is, the command must end by itself: with all trials
done, or with one line that says how many are. The next run must then make, byte for byte, what a run that nobody
disturbed makes, and leave what was done before as it was.
"""

import argparse
import json
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pandas as pd
import psutil

from benchmarks.batch import batch, contents, finished, make_twins, spent

TRIALS, FRAMES = 4, 40
WAYS = ("all at once", "one, then the other", "all, again and again")
MOST_S = 900.0
"""A command that takes so long has not ended: three times the 301 s that one took on two cores under a load of 18."""


def run(options: argparse.Namespace) -> int:
    """Kill at all points; prints the table, and returns the number of defects."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        twins, whole = Path(folder) / "twins", Path(folder) / "whole"
        make_twins(twins, TRIALS, frames=FRAMES)
        spent(batch(twins, whole, jobs=2))
        for way in WAYS:
            for after in (1,) if options.quick else (-1, 0, 1, 2):
                rows.append(_attacked(twins, whole, Path(folder) / f"out{len(rows)}", way, after))
                print(rows[-1], flush=True)
    table = pd.DataFrame(rows)
    print(table.to_string(index=False))
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
        table.to_csv(options.out / "workers.csv", index=False)
    defects = int(table["defect"].astype(bool).sum())
    print(f"{len(rows)} points: {defects} defects")
    return defects


def _attacked(twins: Path, whole: Path, out: Path, way: str, after: int) -> dict[str, object]:
    """One point: from ``after`` finished trials on (-1: as the first processes start)."""
    command = batch(twins, out, jobs=2)
    begun, killed = time.perf_counter(), set()
    with tempfile.TemporaryFile() as said:
        running = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=said)
        while running.poll() is None and time.perf_counter() - begun < MOST_S:
            for worker in _workers(running.pid) if len(finished(out)) >= after else ():
                if way != "all, again and again" and len(killed) >= 2:
                    break
                if worker.pid not in killed:
                    with suppress(psutil.NoSuchProcess):
                        worker.kill()
                    killed.add(worker.pid)
                    if way == "one, then the other":
                        time.sleep(1.0)
            time.sleep(0.02)
        hung = running.poll() is None
        running.kill()
        running.wait()
        took = time.perf_counter() - begun
        said.seek(0)
        errors = said.read().decode()
    # a trial whose worker died twice has failed, and is to be done again
    done = [path for path in finished(out) if json.loads(path.read_text(encoding="utf-8"))["status"] == "done"]
    before = {path: path.stat().st_mtime_ns for path in done}
    spent(batch(twins, out, jobs=2))
    told = [line for line in errors.splitlines() if line.startswith("error: ")]
    troubles = {
        "hangs": hung,
        "traceback": "Traceback" in errors or "this is an error in mocap" in errors,
        "not one line": running.returncode != 0 and len(told) != 1,
        "done again": any(path.stat().st_mtime_ns != when for path, when in before.items()),
        "other bytes": contents(out) != contents(whole),
    }
    return {
        "way": way,
        "after": after,
        "killed": len(killed),
        "exit": running.returncode,
        "done": len(before),
        "seconds": round(took),
        "defect": ", ".join(name for name, there in troubles.items() if there),
    }


def _workers(command: int) -> Iterator[psutil.Process]:
    """Processes that a command has started to track in: those that another one was forked to."""
    with suppress(psutil.NoSuchProcess):
        for process in psutil.Process(command).children():
            with suppress(psutil.NoSuchProcess):
                yield from process.children()
