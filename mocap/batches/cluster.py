"""Calls on a Dask cluster that somebody started: it queues them, and tries those again whose worker dies.

Dask does what anybody asks who reaches its scheduler: all of its network is trusted, or it has TLS, by Dask's settings.
"""

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager
from dataclasses import dataclass
from queue import Empty, Queue
from secrets import token_hex
from typing import Any

from dask import config
from dask._task_spec import Task
from distributed import Client, KilledWorker, get_worker

from mocap.errors import MocapError
from mocap.side_by_side import Call, Hear, Lost, NoProcess

TOPIC = "mocap-batch"
"""Under which workers say what they do."""
WORKER_S = 300.0
"""Seconds; where no trial ends for so long, workers are looked for, and waited for as long: Dask, too, counts one that
is silent for five minutes as dead."""
CONNECT_S = 10.0
"""So long a scheduler may take to answer."""
GONE = "the connection to the Dask scheduler has ended: see whether it runs"


@contextmanager
def cluster(scheduler: str) -> Iterator["Cluster"]:
    """A cluster by the address of its scheduler.

    Raises:
        MocapError: none answers.
    """
    with config.set({"distributed.comm.timeouts.connect": "60s"}):
        try:
            found = Client(scheduler, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise MocapError(
                f"`scheduler` {scheduler}: no Dask scheduler answers ({error}): start one (dask scheduler), and "
                "give its address as tcp://HOST:8786"
            ) from None
        with found:
            yield Cluster(found)


def _made(call: Call, key: str) -> Any:
    """On a worker: make a call; what it tells is heard under ``TOPIC``."""
    worker = get_worker()

    def tell(*what: object) -> None:
        worker.log_event(TOPIC, {"worker": worker.address, "key": key, "what": what})

    return call(progress=tell)


@dataclass(frozen=True, eq=False)
class Cluster:
    """A Dask cluster.

    Attributes:
        connected: To it.
    """

    connected: Client

    def each(
        self,
        calls: Mapping[str, Call],
        *,
        limit_s: Callable[[str], float],
        hear: Hear,
        stopped: Callable[[str], bool] | None = None,
    ) -> Iterator[tuple[str, "Future[Any]"]]:
        """As of ``Runner``; how long a call may take, and what stops it, is the cluster's own affair.

        Raises:
            NoProcess: the cluster has none left.
        """
        del limit_s, stopped

        def heard(event: tuple[float, Any]) -> None:
            if event[1]["key"] in keys:  # others' batches are told of, too
                hear(event[1]["worker"], keys[event[1]["key"]], *event[1]["what"])

        batch = token_hex(8)  # of two calls of one key a scheduler makes one
        keys = {f"mocap-{batch}-{i}": name for i, name in enumerate(calls)}
        self.connected.subscribe_topic(TOPIC, heard)
        # marked as producers of data, they wait at the scheduler, not at a worker whose death they would be accused of
        graph = {key: Task(key, _made, calls[name], key, _data_producer=True) for key, name in keys.items()}
        futures: Any = self.connected.get(graph, list(graph), sync=False, retries=1)
        ended: Queue[Any] = Queue()
        for future in futures:
            future.add_done_callback(ended.put)
        for _ in futures:
            while True:
                try:
                    future = ended.get(timeout=WORKER_S)
                    break
                except Empty:
                    self._need_workers()
            went: Future[Any] = Future()
            try:
                went.set_result(self._result(future))
            except NoProcess:
                raise
            except KilledWorker:
                went.set_exception(Lost("its process died", "died"))
            except Exception as error:  # the call's own
                went.set_exception(error)
            yield keys[future.key], went
            future.release()
        self.connected.unsubscribe_topic(TOPIC)

    def _result(self, future: Any) -> Any:
        """What a call gives; if that died with its worker before it was fetched, it is made again."""
        while True:
            try:
                return future.result(WORKER_S)
            except TimeoutError:
                if future.status == "error":  # the call's own
                    raise
                self._need_workers()
            except CancelledError:  # as all are when the scheduler has gone
                raise NoProcess(GONE) from None

    def _need_workers(self) -> None:
        """Wait until there is a worker.

        Raises:
            NoProcess: none comes.
        """
        if self.connected.status != "running":
            raise NoProcess(GONE)
        try:
            self.connected.wait_for_workers(1, timeout=WORKER_S)
        except OSError as error:
            if not isinstance(error, TimeoutError) or self.connected.status != "running":  # that is known late
                raise NoProcess(GONE) from None
            raise NoProcess(
                f"the cluster has been without a worker for {WORKER_S:g} s: see whether its hosts have memory left"
            ) from None
