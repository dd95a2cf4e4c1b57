"""A folder held by one process of ours at a time; the lock ends with the process, however that ends."""

import contextlib
import errno
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from mocap.errors import OutputError

LOCK = ".mocap-lock"
"""File that holds a folder on Windows while a process writes there; elsewhere the folder itself is locked."""


@contextlib.contextmanager
def locked(folder: Path, *, patience_s: float = 0.0) -> Iterator[None]:
    """Hold a folder against other processes of ours; the lock ends with the process, however that ends.

    Args:
        folder: It exists.
        patience_s: So long another holder is waited for.

    Raises:
        OutputError: another process holds it.
    """
    handle = _lock(folder, patience_s)
    try:
        yield
    finally:
        if handle is not None:
            os.close(handle)


def _lock(folder: Path, patience_s: float) -> int | None:
    """A handle that holds the lock; None where the file system knows no locks."""
    end = time.monotonic() + patience_s
    while True:
        handle = None
        try:
            if sys.platform == "win32":
                import msvcrt

                handle = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_TEMPORARY)
                msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
            else:
                import fcntl

                handle = os.open(folder, os.O_RDONLY)
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return handle
        except OSError as error:
            if handle is not None:
                os.close(handle)
            if error.errno in (errno.EBADF, errno.EINVAL, errno.ENOLCK, errno.ENOTSUP):
                return None  # some network file systems lock no folders
            if error.errno not in (errno.EWOULDBLOCK, errno.EACCES, errno.EDEADLK):
                raise
            if handle is None:  # it could not even be opened
                raise
            if time.monotonic() >= end:
                raise OutputError(
                    f"{folder}: another mocap is writing there: wait until it has ended, or choose another place"
                ) from None
            time.sleep(0.05)
