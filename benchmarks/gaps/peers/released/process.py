"""The process in which released tools run: one a session, arrays by npz files, jobs by lines."""

import atexit
import json
import os
import subprocess
import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.gaps.peers.released.make_env import interpreter
from eal.arrays import Array

WORKER = Path(__file__).with_name("worker.py")


class Worker:
    """A running worker and its folder."""

    def __init__(self) -> None:
        """Start it, one thread for linear algebra."""
        self.folder = tempfile.TemporaryDirectory(prefix="peers")
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
        self.process = subprocess.Popen(
            [str(interpreter()), str(WORKER)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env={**os.environ, **threads, "JAX_PLATFORMS": "cpu", "JAX_ENABLE_X64": "1"},
        )
        atexit.register(self.close)

    def close(self) -> None:
        """End it."""
        self.process.kill()
        self.process.communicate()
        self.folder.cleanup()

    def run(self, tool: str, xyz_mm: Array, sd_mm: Array, options: dict, **arrays: Array) -> tuple[Array, Array | None]:
        """One job.

        Raises:
            ArithmeticError: the tool failed; the message is its own.
        """
        source, target = (str(Path(self.folder.name) / name) for name in ("job.npz", "answer.npz"))
        np.savez(source, allow_pickle=False, xyz=xyz_mm, sd=sd_mm, **arrays)
        stdin, stdout = self.process.stdin, self.process.stdout
        if stdin is None or stdout is None:
            raise ArithmeticError(f"{tool}: the worker has no pipes")
        stdin.write(json.dumps({"tool": tool, "input": source, "output": target, "options": options}) + "\n")
        stdin.flush()
        answer = stdout.readline().strip()
        if answer != "ok":
            raise ArithmeticError(f"{tool}: {answer or 'the worker ended'}")
        with np.load(target) as data:
            return data["first"], data.get("second")


@cache
def _worker(_process: int) -> Worker:
    return Worker()


def run(tool: str, xyz_mm: Array, sd_mm: Array, options: dict, **arrays: Array) -> tuple[Array, Array | None]:
    """One job in this process's worker, which is started at its first job."""
    return _worker(os.getpid()).run(tool, xyz_mm, sd_mm, options, **arrays)
