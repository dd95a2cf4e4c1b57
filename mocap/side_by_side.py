"""Calls in processes of their own: side by side, each within limits; no process outlives the one that started it.

A call is made whole by one process: the numbers are those of this one. Calls, and what becomes of them, go through
pipes that nobody else can open; nothing listens on a port.
"""

import atexit
import os
import pickle
import signal
import sys
import traceback
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import contextmanager, nullcontext, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from math import inf
from multiprocessing import current_process, get_context, parent_process
from multiprocessing.connection import Connection, wait
from multiprocessing.context import BaseContext
from multiprocessing.process import BaseProcess
from multiprocessing.reduction import ForkingPickler
from pathlib import Path
from threading import Lock
from time import monotonic
from typing import Any, Literal, TypeVar

from eal.efforts import Call, Progress, efforts_of, in_turn, shares_beside
from mocap.ending import end_after, end_with
from mocap.errors import MocapError

Hear = Callable[..., None]
"""Called with the number of a process, the name of its call, and what that tells on its way."""
Name = TypeVar("Name")

START_S = 300.0
"""A process that is not ready by then does not start: it reads the script first, and a busy computer is slow."""
STARTS = 3
"""Processes that may end before they are ready, one after the other, before it is given up."""
LOOK_S = 0.5
"""Seconds between two looks at the memory of processes: it is filled by some GB a second."""
END_S = 5.0
"""What has nothing to do and does not end by itself in that time is ended."""
MOST_PROCESSES = 4
"""Processes that one recording has work for."""
_STARTING = Lock()
"""Held while a process starts: one whose parent ends before it has told it what to do fails with a traceback."""
atexit.register(lambda: _STARTING.acquire(timeout=END_S))


class NoProcess(MocapError):
    """No process can be started."""


class Lost(MocapError):
    """What a call would have given is lost with its process.

    Attributes:
        why: The process ended by itself (``died``), or was ended, as it took too long or too much memory, or a person
            stopped it; such a call may not have begun.
    """

    def __init__(self, text: str, why: Literal["died", "time", "memory", "stopped"]) -> None:
        """With why."""
        super().__init__(text, why)
        self.why = why

    def __str__(self) -> str:
        """The text alone."""
        return str(self.args[0])


def _end_with_parent() -> None:
    parent = parent_process()
    assert parent is not None
    if sys.platform == "win32":  # where it is the handle of a process
        end_after(lambda: wait([parent.sentinel]))
    else:
        end_with(parent.sentinel)


def _work(pipe: Connection) -> None:
    """The life of a process: it makes one call after the other, until nobody is there to send one."""
    _end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the process that started it, which ends it
    pipe.send(("ready", None))
    with suppress(EOFError, OSError):
        while True:
            pipe.send_bytes(_made(pipe.recv_bytes(), pipe))


def _made(packed: bytes, pipe: Connection) -> Any:
    """Make a call; what it gave or raised."""

    def tell(*said: Any) -> None:
        pipe.send(("said", said))

    try:
        call, heard = pickle.loads(packed)
        pipe.send(("begun", None))  # what it needs has been imported: now its time runs
        return ForkingPickler.dumps(("gave", call(progress=tell if heard else None)))
    except BaseException as error:  # a call ends its process by no means: others follow
        error.add_note("".join(traceback.format_exception(error)))
        if isinstance(error, Exception):
            with suppress(Exception):
                sent = ForkingPickler.dumps(("raised", error))
                pickle.loads(sent)  # some can be sent, and not be read
                return sent
        kind = MocapError if isinstance(error, MocapError) else RuntimeError
        same = kind(str(error) if kind is MocapError else f"{type(error).__name__}: {error}")
        return ForkingPickler.dumps(("raised", same))


@dataclass(eq=False)
class Worker:
    """A process that makes calls.

    Attributes:
        process: It.
        pipe: To it.
        ready: Whether it has started.
        begun: Whether it has begun its call.
        until_s: When it has taken too long to start, or for its call.
        call: The name of its call; None: it has none.
        limit_s: Seconds that the call may take.
    """

    process: BaseProcess
    pipe: Connection
    ready: bool = False
    begun: bool = False
    until_s: float = field(default_factory=lambda: monotonic() + START_S)
    call: Any = None
    limit_s: float = inf

    @classmethod
    def started(cls, context: BaseContext, *, daemon: bool = True) -> "Worker":
        """One that starts; a ``daemon`` starts none of its own.

        Raises:
            OSError: the system refuses.
        """
        here, there = context.Pipe()
        try:
            process = context.Process(target=_work, args=(there,), daemon=daemon)  # type: ignore[attr-defined]
            with _STARTING:
                process.start()
        except BaseException:
            here.close()
            raise
        finally:
            there.close()
        return cls(process, here)

    @property
    def name(self) -> int:
        """The number of the process."""
        return self.process.pid or 0

    def send(self, name: Any, call: Call, *, hears: bool, limit_s: float = inf) -> None:
        """Give it a call; it is ``ready`` and has none."""
        self.call, self.begun, self.limit_s, self.until_s = name, False, limit_s, monotonic() + START_S
        with suppress(OSError):  # it has died: ``messages`` tells
            self.pipe.send_bytes(ForkingPickler.dumps((call, hears)))

    def messages(self) -> Iterator[tuple[str, Any]]:
        """What it sent: ``ready``, ``said``, at the end of its call ``gave`` or ``raised``; ``died``: it is gone."""
        while True:
            try:
                if not self.pipe.poll():
                    return
                kind, what = self.pipe.recv()
            except (EOFError, OSError):
                yield "died", None
                return
            if kind == "begun":
                self.begun, self.until_s = True, monotonic() + self.limit_s
                continue
            if kind != "said":
                self.ready, self.call, self.until_s = True, None, inf
            yield kind, what

    def end(self, *, now: bool) -> None:
        """End it; one that has no call ends by itself unless it is to be ``now``."""
        self.pipe.close()
        if not now:
            self.process.join(END_S)
        if now or self.process.is_alive():
            self.process.kill()
        self.process.join(END_S)


def memory_bytes(process: int) -> int:
    """Memory that a process holds; 0 where the system (Windows, macOS) does not tell it in /proc."""
    try:
        return int(Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, IndexError, ValueError):
        return 0


GUARD = (
    "the processes could not be started: in a script, call mocap below "
    '`if __name__ == "__main__":`, as every process reads the script first; else see whether memory is left'
)


def context_of(preload: str) -> BaseContext:
    """How processes start: not forked from this one, which may have threads.

    On Linux they are forked from one that does nothing else, and has imported what each of them needs, which it begins
    to do while this process goes on.

    Raises:
        MocapError: this process is itself one that reads its script.
    """
    if getattr(current_process(), "_inheriting", False):
        raise MocapError(GUARD)
    if sys.platform != "linux":
        return get_context("spawn")
    from multiprocessing import forkserver, resource_tracker

    context = get_context("forkserver")
    context.set_forkserver_preload([preload])
    # Ctrl-C reaches it, too, and it would end in the middle of an import; what it forks ignores it (``_work``).
    # The tracker, which it starts at the first time, would let it through again
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    return context


@dataclass(eq=False)
class Pool:
    """Processes that start when they are first needed, and make one call after the other.

    Attributes:
        count: So many at most.
        context: How they start.
        most_bytes: Memory that each may hold.
        workers: Those that there are.
    """

    count: int
    context: BaseContext
    most_bytes: float = inf
    workers: list[Worker] = field(default_factory=list)

    def each(
        self,
        calls: Mapping[Name, Call],
        *,
        limit_s: Callable[[Name], float] = lambda _name: inf,
        hear: Hear | None = None,
        stopped: Callable[[Name], bool] | None = None,
        tries: int = 2,
    ) -> Iterator[tuple[Name, "Future[Any]"]]:
        """What became of each call, as they end: its result, what it raised, or that it is ``Lost``.

        Args:
            calls: By name.
            limit_s: Seconds that a call may take.
            hear: Told what calls tell.
            stopped: Whether a call is not wanted any more, also one that is being made.
            tries: So many times a call is made whose process dies; one that takes too long is made once.

        Raises:
            NoProcess: none can be started.
        """
        left, died, vain = deque(calls), Counter[Name](), 0
        most = min(self.count, 61) if sys.platform == "win32" else self.count  # what `wait` takes there
        try:
            while left or any(worker.call is not None for worker in self.workers):
                busy = sum(worker.call is not None for worker in self.workers)
                while vain < STARTS and len(self.workers) < min(most, busy + len(left)):
                    try:
                        self.workers.append(Worker.started(self.context))
                    except (OSError, EOFError):  # also that which they are forked from has died
                        vain += 1
                if not self.workers:
                    raise NoProcess(GUARD)
                for worker in self.workers:
                    while left and stopped is not None and stopped(left[0]):
                        yield left.popleft(), _stopped()
                    if left and worker.ready and worker.call is None:
                        name = left.popleft()
                        worker.send(name, calls[name], hears=hear is not None, limit_s=limit_s(name))
                wait([worker.pipe for worker in self.workers], self._look_again_s(LOOK_S if stopped else inf))
                for worker in list(self.workers):
                    name, future = worker.call, Future()
                    for kind, what in worker.messages():
                        if kind == "ready":
                            vain = 0
                        elif kind == "said" and hear is not None:
                            hear(str(worker.name), name, *what)
                        elif kind == "gave":
                            future.set_result(what)
                        elif kind == "raised":
                            future.set_exception(what)
                        elif kind == "died":
                            future.set_exception(Lost("its process died", "died"))
                    if not future.done() and (error := self._beyond(worker)) is not None:
                        future.set_exception(error)
                    if not future.done() and worker.call is not None and stopped is not None and stopped(name):
                        future = _stopped()
                    error = future.exception() if future.done() else None
                    if isinstance(error, Lost):
                        self.workers.remove(worker)
                        worker.end(now=True)
                        if name is None:
                            vain += not worker.ready
                            continue
                        died[name] += 1
                        if error.why not in ("time", "stopped") and died[name] < tries:
                            left.appendleft(name)
                            continue
                    if future.done():
                        yield name, future
        finally:
            for worker in [worker for worker in self.workers if worker.call is not None]:
                self.workers.remove(worker)
                worker.end(now=True)

    def _look_again_s(self, most_s: float) -> float | None:
        until_s = min(worker.until_s for worker in self.workers) - monotonic()
        soon_s = min(until_s, most_s, inf if self.most_bytes == inf else LOOK_S)
        return None if soon_s == inf else max(soon_s, 0.0)

    def _beyond(self, worker: Worker) -> Lost | None:
        """The limit that a process is beyond."""
        if monotonic() > worker.until_s:
            return Lost("it took too long", "time")
        if self.most_bytes < inf and memory_bytes(worker.name) > self.most_bytes:
            return Lost(f"it took more than {self.most_bytes / 1e9:.3g} GB of memory", "memory")
        return None

    def close(self) -> None:
        """End them."""
        while self.workers:
            worker = self.workers.pop()
            worker.end(now=worker.call is not None or not worker.ready)


def _stopped() -> "Future[Any]":
    found: Future[Any] = Future()
    found.set_exception(Lost("it was stopped", "stopped"))
    return found


_POOL: ContextVar[Pool | None] = ContextVar("_POOL", default=None)


@contextmanager
def opened(count: int, *, preload: str = "mocap.report.job", most_bytes: float = inf) -> Iterator[Pool]:
    """Processes, for as long as the context lasts.

    Args:
        count: So many at most.
        preload: The module that they need.
        most_bytes: Memory that each may hold.
    """
    found = Pool(count, context_of(preload), most_bytes)
    try:
        yield found
    finally:
        found.close()


@contextmanager
def processes(count: int | None = None) -> Iterator[None]:
    """What is tracked and learned in this context may use so many processes; without it, all is done in one.

    A script that uses more than one guards what it does by ``if __name__ == "__main__":``, as Python's own processes
    want it.

    Args:
        count: Of processes; 1: only this one; None: one for each core, at most ``MOST_PROCESSES``.

    Raises:
        MocapError: fewer than one.
    """
    if count is None:
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        count = min(cores, MOST_PROCESSES)
    if count < 1:
        raise MocapError(f"`count` of processes is {count}: give 1 or more")
    with nullcontext() if count == 1 else opened(count) as pool:
        token = _POOL.set(pool)
        try:
            yield
        finally:
            _POOL.reset(token)


def call_all(calls: Sequence[Call], progress: Progress | None = None) -> list[Any]:
    """What the calls return, in their order: one after the other, or side by side (``processes``).

    Calls whose process died, as where memory is used up, are made once more in this one.

    Args:
        calls: See ``Call``; one that says its ``effort`` counts for so much.
        progress: Called with the share done of all of them together.
    """
    there = _POOL.get()
    if there is None or len(calls) < 2:
        return in_turn(calls, progress)
    tell = None if progress is None else shares_beside(progress, efforts_of(calls), there.count)
    hear = None if tell is None else (lambda _worker, i, share: tell(i, share))
    ended: dict[int, Future[Any]] = {}
    with suppress(NoProcess):
        for i, future in there.each(dict(enumerate(calls)), hear=hear, tries=1):
            ended[i] = future
            if tell is not None:
                tell(i, 1.0)
    lost = [i for i in range(len(calls)) if i not in ended or isinstance(ended[i].exception(), Lost)]
    if lost:
        there.close()  # that this one has the memory
    return [call(progress=None) if i in lost else ended[i].result() for i, call in enumerate(calls)]
