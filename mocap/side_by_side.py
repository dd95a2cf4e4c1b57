"""Calls that do not wait for each other, side by side in processes of their own where somebody allows them.

The numbers are those of one process: each call is a whole, on one BLAS thread.
"""

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from multiprocessing import forkserver, get_context
from multiprocessing.context import BaseContext
from typing import Any

from mocap.errors import MocapError

Progress = Callable[[float], None]
Call = Callable[..., Any]
"""Takes ``progress``, which is called with the share done, or is None; travels to another process."""


@dataclass(eq=False)
class _Pool:
    """Processes that start when they are first needed.

    They are not forked from this one, which may have threads. On Linux they are forked from one that does nothing
    else, and has imported what each of them needs.
    """

    count: int
    context: BaseContext
    executor: ProcessPoolExecutor | None = None

    @classmethod
    def of(cls, count: int) -> "_Pool":
        """Of so many processes; what they are forked from starts to import while this process goes on."""
        if sys.platform != "linux":
            return cls(count, get_context("spawn"))
        context = get_context("forkserver")
        context.set_forkserver_preload(["mocap.pipeline.job"])
        forkserver.ensure_running()
        return cls(count, context)

    def submit(self, call: Call) -> Future:
        """Begin a call; if no process can be started for it, its future is that of a process that died."""
        count = min(self.count, 61) if sys.platform == "win32" else self.count  # its wait takes 63 handles, two its own
        for _ in range(2):
            self.executor = self.executor or ProcessPoolExecutor(count, mp_context=self.context)
            try:
                return self.executor.submit(call, progress=None)
            except (BrokenProcessPool, OSError, EOFError):  # a process died, or that which it is forked from
                self.executor.shutdown(wait=True)  # calls that were begun come to their end
                self.executor = None
        died: Future = Future()
        died.set_exception(BrokenProcessPool("no process can be started"))
        return died

    def close(self) -> None:
        if self.executor is not None:
            self.executor.shutdown(wait=True, cancel_futures=True)
        self.executor = None


MOST_PROCESSES = 4
"""Processes that one recording has work for."""
_POOL: ContextVar[_Pool | None] = ContextVar("_POOL", default=None)


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
    pool = None if count == 1 else _Pool.of(count)
    token = _POOL.set(pool)
    try:
        yield
    finally:
        _POOL.reset(token)
        if pool is not None:
            pool.close()


def call_all(calls: Sequence[Call], progress: Progress | None = None) -> list[Any]:
    """What the calls return, in their order: one after the other, or side by side (``processes``).

    Calls whose process died, as where memory is used up, are made once more in this one.

    Args:
        calls: See ``Call``.
        progress: Called with the share done of all of them together.
    """
    pool = _POOL.get()
    if pool is None or len(calls) < 2:
        return [call(progress=_share(progress, i, len(calls))) for i, call in enumerate(calls)]
    futures = [pool.submit(call) for call in calls]
    left = []
    for count, future in enumerate(as_completed(futures)):
        if isinstance(future.exception(), BrokenProcessPool):
            left.append(futures.index(future))
        if progress is not None:
            progress((count + 1) / len(calls))
    if left:
        pool.close()
    return [calls[i](progress=None) if i in left else future.result() for i, future in enumerate(futures)]


def _share(progress: Progress | None, part: int, count: int) -> Progress | None:
    return None if progress is None else lambda share: progress((part + share) / count)
