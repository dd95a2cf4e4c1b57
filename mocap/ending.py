"""The end of a process: with whoever started it."""

import os
import signal
import threading
from collections.abc import Callable
from multiprocessing.connection import wait


def end_with(pipe: int) -> None:
    """End this process as soon as the other end of a pipe is closed: by hand, or by the end of whoever holds it.

    Linux ends it, also where it hangs in a library that keeps Python's lock; elsewhere a thread does.

    Args:
        pipe: Number of its open file, into which nothing is written any more.
    """
    try:
        import fcntl

        fcntl.fcntl(pipe, fcntl.F_SETOWN, os.getpid())
        fcntl.fcntl(pipe, fcntl.F_SETSIG, signal.SIGKILL)
        fcntl.fcntl(pipe, fcntl.F_SETFL, fcntl.fcntl(pipe, fcntl.F_GETFL) | os.O_ASYNC)
    except (ImportError, AttributeError, OSError):
        end_after(lambda: os.read(pipe, 1))
    else:
        if wait([pipe], 0.0):  # it was closed before
            os._exit(1)


def end_after(waits: Callable[[], object]) -> None:
    """End this process as soon as a call returns, which is made in a thread."""

    def watch() -> None:
        waits()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
