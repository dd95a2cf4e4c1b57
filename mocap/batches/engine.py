"""Who makes the calls of a batch: processes of this machine, or a Dask cluster that somebody started.

Both are asked alike (``Runner``), and both give a call a second process where the first one dies.
"""

import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from math import inf
from pathlib import Path
from typing import Any, Protocol

from eal.needs import needs
from mocap.batches.trial import size_bytes
from mocap.errors import MocapError
from mocap.side_by_side import Call, Hear, Lost, opened

LEAST_MEMORY = 500_000_000
"""Bytes; a process that has read no trial yet holds half of it."""
TRIAL_S, BYTES_A_S = 3600.0, 10_000.0
"""A trial may take an hour, and a second for each 10 kB of its files: more than ten times what the slowest took that
were measured (docs/experiments/batch_cost.md)."""
UNITS = {"": 1, "k": 1e3, "m": 1e6, "g": 1e9, "t": 1e12, "ki": 2**10, "mi": 2**20, "gi": 2**30, "ti": 2**40}


class Runner(Protocol):
    """Makes calls in other processes."""

    def each(
        self,
        calls: Mapping[str, Call],
        *,
        limit_s: Callable[[str], float],
        hear: Hear,
        stopped: Callable[[str], bool] | None = None,
    ) -> Iterator[tuple[str, Future[Any]]]:
        """What became of each call, as ``mocap.side_by_side.Pool.each`` tells it.

        Raises:
            MocapError: there is no process that makes them.
        """
        ...


@contextmanager
def engine(*, jobs: int, memory: str | float | None, scheduler: str | None) -> Iterator[Runner]:
    """Processes of this machine, or those of a cluster that runs.

    Args:
        jobs: Number of processes.
        memory: Limit of each, as ``2GB``; None: an equal part of the machine's, of which a twentieth is left.
        scheduler: Address of a Dask scheduler; the others are then its own affair.

    Raises:
        MocapError: their memory is too small, or no scheduler answers.
        NoProcess: none starts, or the cluster has none left.
    """
    limit = max(0.95 * machine_bytes() / jobs, LEAST_MEMORY) if memory is None else _bytes(memory)
    if scheduler is None:
        with opened(jobs, preload="mocap.batches.worker", most_bytes=limit) as pool:
            yield pool
        return
    needs("`scheduler`", "batch", "dask", "distributed")
    from mocap.batches.cluster import cluster

    with cluster(scheduler) as found:
        yield found


def limit_of(paths: Sequence[Path], limit_s: float | None) -> float:
    """Seconds that tracking files may take: what is stated, or by their size."""
    return TRIAL_S + size_bytes(paths) / BYTES_A_S if limit_s is None else limit_s


def why_lost(lost: Lost, limit_s: float) -> str:
    """What is told of a call that is lost, and what to do."""
    advice = "give fewer `jobs` or more `memory`, or take a shorter part of the recording"
    if lost.why == "time":
        return f"was not done within {limit_s:.0f} s, and was ended: if it only needs longer, give `limit_s`"
    if lost.why == "memory":
        return f"{lost}, twice: {advice}"
    return f"its process died twice, as where its memory is used up: {advice}"


def machine_bytes() -> float:
    """The memory of this machine, or what its container, or its job on a cluster, may take of it."""
    found = [inf]
    for name in ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"):
        with suppress(OSError, ValueError):  # of the second version "max": none
            found.append(float(Path(name).read_text(encoding="ascii")))
    if sys.platform != "win32":
        found.append(float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")))
    return min(found)


def _bytes(memory: str | float) -> float:
    found = re.fullmatch(r"\s*([\d.]+(?:e\d+)?)\s*([kmgt]?i?)b?\s*", str(memory), re.IGNORECASE)
    try:
        limit = float(found[1]) * UNITS[found[2].lower()] if found else None
    except (ValueError, KeyError):
        limit = None
    if limit is None:
        raise MocapError(f"`memory` {memory}: expected a number of bytes: give it as 2GB")
    # a limit at which every process would be ended before it reads a trial, and started again for ever
    if limit < LEAST_MEMORY:
        raise MocapError(f"`memory` {memory}: a process needs 500 MB before it reads a trial: give more, as 2GB")
    return limit
