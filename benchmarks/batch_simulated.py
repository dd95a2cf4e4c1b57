"""Ten thousand trials on a hundred workers: Dask's own scheduler with workers that only wait.

The scheduler is the real one, with the settings and the tasks of ``mocap batch``; its hundred workers share this
machine's processor, so that what they cost is counted too, and the figure is an upper bound.
"""

import asyncio
import logging
import time
from pathlib import Path
from typing import Any

import psutil
from dask import config
from dask._task_spec import Task
from distributed import Client, LocalCluster

from mocap.batches.engine import CONFIG
from mocap.batches.known import Options, Record
from mocap.batches.trial import Trial

ROW = {f"figure{i}": 1.234567 for i in range(18)}
"""As many figures as a row of ``summary.csv`` has."""


async def wait_for(trial: Trial, _options: Options, _out: Path, seconds: float) -> tuple[Record, float]:
    """A trial that takes so long and costs nothing; an asynchronous task runs in the worker's own loop."""
    await asyncio.sleep(seconds)
    return Record(trial=trial.name, status="done", row=ROW, key="0" * 64), seconds


def simulated(*, quick: bool) -> list[str]:
    """The table."""
    workers, trials, seconds = (20, 500, 1.0) if quick else (100, 10_000, 2.0)
    process, options, out = psutil.Process(), Options(), Path("/results")
    with (
        config.set(CONFIG | {"distributed.worker.memory.terminate": False}),
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=False,
            dashboard_address="127.0.0.1:0",
            silence_logs=logging.CRITICAL,
        ) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        before_mb, cpu, begun = process.memory_info().rss / 1e6, sum(process.cpu_times()[:2]), time.perf_counter()
        named = [
            Trial(name=f"bat{i % 100:03d}/t{i:05d}", paths=(Path(f"/data/t{i:05d}_xypts.csv"),)) for i in range(trials)
        ]
        graph = {
            f"track-{i}": Task(f"track-{i}", wait_for, trial, options, out, seconds, _data_producer=True)
            for i, trial in enumerate(named)
        }
        futures: Any = client.get(graph, list(graph), sync=False, retries=1)
        queued_s = time.perf_counter() - begun
        most_mb = 0.0
        while not all(future.done() for future in futures):
            most_mb = max(most_mb, process.memory_info().rss / 1e6)
            time.sleep(0.5)
        wall_s, cpu_s = time.perf_counter() - begun, sum(process.cpu_times()[:2]) - cpu
        done = sum(future.status == "finished" for future in futures)
    ideal_s = trials * seconds / workers
    return [
        f"## {trials} trials of {seconds:g} s on {workers} workers, simulated",
        "",
        f"- ideal {ideal_s:.0f} s, took {wall_s:.0f} s; {done} done; all were in the queue after {queued_s:.1f} s",
        f"- processor time of scheduler, client and all workers: {cpu_s:.1f} s, {1e3 * cpu_s / trials:.2f} ms a trial",
        f"- memory of scheduler and client: {most_mb - before_mb:.0f} MB more for {trials} trials",
        f"- so {trials} trials of 30 s on {workers} workers would keep the scheduler busy for "
        f"{100 * cpu_s / (30 * trials / workers):.1f} % of the time at most",
    ]
