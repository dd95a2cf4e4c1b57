"""Trials on Dask: it queues them, hands them to processes, replaces those that die, and tries a trial once more.

Nothing here does: a graph of tasks without dependencies is given to the scheduler, and futures are taken as they come.
"""

import logging
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from multiprocessing import current_process
from pathlib import Path
from queue import Empty, Queue
from time import monotonic, sleep
from typing import Any

from dask import config
from dask._task_spec import Task
from dask.utils import parse_bytes
from distributed import Client, Future, KilledWorker, LocalCluster, Status

from mocap.batches.one import basic_columns
from mocap.batches.trial import NoWorkers, Options, Record, Trial
from mocap.batches.worker import TOPIC, track_here
from mocap.errors import MocapError, shown_elsewhere

CONFIG = {
    "distributed.scheduler.allowed-failures": 1,  # a trial whose worker dies is tried once more
    "distributed.scheduler.worker-saturation": 1.0,  # one trial a worker: a death accuses no other
    "distributed.worker.daemon": False,  # readers of damaged files start processes
    "distributed.worker.memory.target": False,  # nothing is kept that could be spilled
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,  # a pause would have no end: the memory is the trial's own
    "distributed.worker.memory.terminate": 0.95,
    "distributed.worker.memory.monitor-interval": "500ms",
    "distributed.worker.profile.enabled": False,  # nobody looks at Dask's own page: what it samples costs time
    "distributed.admin.system-monitor.interval": "10s",
    "distributed.admin.tick.interval": "500ms",
    "distributed.nanny.pre-spawn-environ": {  # all of it: what Dask does to malloc returns memory after each array
        "OMP_NUM_THREADS": 1,
        "MKL_NUM_THREADS": 1,
        "OPENBLAS_NUM_THREADS": 1,
    },
    "distributed.comm.timeouts.connect": "60s",
    "distributed.deploy.lost-worker-timeout": "1d",  # after its 15 s a busy machine's process, not up yet, was given up
}
WORKER_S = 300.0
"""Seconds; where no trial ends for so long, workers are looked for, and waited for as long: Dask, too, counts one that
is silent for five minutes as dead."""
LEAST_MEMORY = 500_000_000
"""Bytes; a process that has read no trial yet holds half of it."""
CONNECT_S = 10.0
"""So long a scheduler may take to answer."""
GUARD = (
    "the processes of the workers could not be started: in a script, call mocap.batch below "
    '`if __name__ == "__main__":`, as every process reads the script first; else see whether memory is left'
)
GONE = "the connection to the Dask scheduler has ended: see whether it runs"


@contextmanager
def client(*, jobs: int, memory: str | float | None, scheduler: str | None) -> Iterator[Client]:
    """A Dask client: of a cluster of processes on this machine, or of one that stands.

    Args:
        jobs: Number of processes.
        memory: Limit of each, as ``2GB``; None: an equal part of the machine's.
        scheduler: Address of a scheduler that runs; the others are then its own affair.

    Raises:
        MocapError: their memory is too small, or no scheduler answers.
        NoWorkers: the processes do not start.
    """
    # a limit at which every process would be ended before it reads a trial, and started again for ever
    try:
        enough = memory is None or parse_bytes(memory) >= LEAST_MEMORY
    except ValueError as error:
        raise MocapError(f"`memory` {memory}: {error}: give it as 2GB") from None
    if not enough:
        raise MocapError(f"`memory` {memory}: a process needs 500 MB before it reads a trial: give more, as 2GB")
    if getattr(current_process(), "_inheriting", False):
        raise MocapError(GUARD)
    with config.set(CONFIG):
        if scheduler is not None:
            try:
                found = Client(scheduler, timeout=CONNECT_S, set_as_default=False)
            except (OSError, ValueError) as error:
                raise MocapError(
                    f"`scheduler` {scheduler}: no Dask scheduler answers ({error}): start one (dask scheduler), and "
                    "give its address as tcp://HOST:8786"
                ) from None
            with found:
                yield found
            return
        try:
            cluster = LocalCluster(
                n_workers=jobs,
                threads_per_worker=1,
                processes=True,
                memory_limit="auto" if memory is None else memory,
                preload="mocap.batches.worker",
                dashboard_address="127.0.0.1:0",  # any free port: several batches may run
                silence_logs=logging.CRITICAL,
            )
        except RuntimeError as error:
            raise NoWorkers(f"{GUARD} ({error})") from None
        with _closed(cluster), Client(cluster, set_as_default=False) as found:
            yield found


@contextmanager
def _closed(cluster: LocalCluster) -> Iterator[None]:
    """End a cluster.

    Dask stops halfway with a KeyError where a worker that has just been started anew is asked to leave before its
    connection stands, or where one left before Dask had noted that it came: what it watched workers with has ended by
    it, and would raise it each time that it is awaited. It is asked again, without it, until it does.
    """
    try:
        yield
    finally:
        end = monotonic() + CONNECT_S
        while cluster.status != Status.closed:
            try:
                cluster.close()
            except KeyError:
                if monotonic() > end:
                    raise
                cluster.status = Status.failed  # type: ignore[misc]  # of one that closes, a second call would wait
                cluster._watch_worker_status_task = None  # no public name drops it
                sleep(0.1)


def tracked(
    connected: Client,
    trials: Sequence[Trial],
    options: Options,
    out: Path,
    *,
    again: bool = False,
    hear: Callable[[str, str, str], None],
) -> Iterator[tuple[Record, float | None]]:
    """How each trial went, as they end, and the seconds that it took (None: not known).

    Raises:
        NoWorkers: the cluster has none left.
    """

    def heard(event: tuple[float, Any]) -> None:
        hear(event[1]["worker"], event[1]["trial"], event[1]["stage"])

    connected.subscribe_topic(TOPIC, heard)
    keys = {f"track-{i}": trial for i, trial in enumerate(trials)}
    # marked as producers of data, tasks wait at the scheduler and not at a worker whose death they would be accused of
    graph = {key: Task(key, track_here, trial, options, out, again, _data_producer=True) for key, trial in keys.items()}
    futures: Any = connected.get(graph, list(graph), sync=False, retries=1)
    ended: Queue[Any] = Queue()
    for future in futures:
        future.add_done_callback(ended.put)
    for _ in futures:
        while True:
            try:
                future = ended.get(timeout=WORKER_S)
                break
            except Empty:
                _need_workers(connected)
        trial = keys[future.key]
        try:
            went: tuple[Record, float | None] = _result(connected, future)
        except NoWorkers:
            raise
        except Exception:  # whatever it was, the other trials go on
            went = Record(trial=trial.name, status="failed", error=_why(future), row=basic_columns(trial)), None
        yield went
        future.release()
    connected.unsubscribe_topic(TOPIC)


def on_worker(connected: Client, work: Callable[..., Any], *arguments: Any) -> Any:
    """The result of one call on a worker.

    Raises:
        MocapError: what the call raises; its process died.
        NoWorkers: the cluster has none left.
    """
    future = connected.submit(work, *arguments, pure=False)
    try:
        return _result(connected, future)
    except KilledWorker:
        raise MocapError(_why(future)) from None


def _result(connected: Client, future: Future) -> Any:
    """What a call on a worker gives; if that died with the worker before it was fetched, it is made again."""
    while True:
        try:
            return future.result(WORKER_S)
        except TimeoutError:
            if future.status == "error":  # the call's own
                raise
            _need_workers(connected)
        except CancelledError:  # as all are when the scheduler has gone
            raise NoWorkers(GONE) from None


def _need_workers(connected: Client) -> None:
    """Wait until there is a worker.

    Raises:
        NoWorkers: none comes.
    """
    if connected.status != "running":
        raise NoWorkers(GONE)
    try:
        connected.wait_for_workers(1, timeout=WORKER_S)
    except OSError:  # also that the time is over
        raise NoWorkers(
            f"the cluster has been without a worker for {WORKER_S:g} s: see whether its hosts have memory left"
        ) from None


def _why(future: Future) -> str:
    error = future.exception()
    if isinstance(error, KilledWorker):
        return (
            "its process died twice, as where its memory is used up: give fewer `jobs` or more "
            "`memory`, or take a shorter part of the recording"
        )
    text = " ".join(str(error).split())
    if isinstance(error, MocapError):
        return text
    if isinstance(error, OSError) and error.filename:
        advice = f"{shown_elsewhere(error)}check that it is there and that you may use it"
        return f"{error.filename}: {error.strerror}: {advice}"
    place = traceback.extract_tb(future.traceback())  # type: ignore[arg-type]
    where = f" at {Path(place[-1].filename).name}:{place[-1].lineno}" if place else ""
    return f"{type(error).__name__}{where}: {text[:300]}: this is an error in mocap, not in your data: please report it"
