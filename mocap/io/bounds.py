"""How much a file of a size may hold, and how much memory the process may take that reads it."""

import ctypes
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

from mocap.errors import FormatError

LEAST = 1 << 29
"""Bytes that any file may hold: 24 minutes of 20 markers at 250 Hz, with their covariances. Chosen."""
UNKNOWN_BYTES = 2 << 30
"""Address space of Python with its libraries where the system does not tell."""


def most_bytes(path: Path) -> int:
    """Bytes that what a file holds may take unpacked."""
    # compressed recordings of noise hold 1 to 3 times their size, empty ones 50
    return max(LEAST, 100 * path.stat().st_size)


def check_bytes(path: Path, announced: int, what: str) -> None:
    """Refuse what is announced by a head, before it is unpacked.

    Raises:
        FormatError: a file of its size cannot hold as many bytes.
    """
    size = path.stat().st_size
    if announced > most_bytes(path):
        raise FormatError(
            f"{path.name}: {what} would take {announced / 1e9:.3g} GB of memory, but the file has only "
            f"{size / 1e6:.3g} MB: it was made to fill the memory, or is almost empty: export it without what is empty"
        )


def limit_memory(more: int) -> None:
    """Let this process take so many more bytes: what asks for more gets none, a MemoryError in Python."""
    if sys.platform == "win32":
        limit_windows_memory(UNKNOWN_BYTES + more)
        return
    import resource

    with suppress(ValueError, OSError):  # macOS takes no such limit: that of time is left
        try:
            pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[0]
            taken = resource.getpagesize() * int(pages)
        except OSError:
            taken = UNKNOWN_BYTES
        resource.setrlimit(resource.RLIMIT_AS, (taken + more, taken + more))


class _Limits(ctypes.Structure):
    """JOBOBJECT_EXTENDED_LIMIT_INFORMATION, which begins with JOBOBJECT_BASIC_LIMIT_INFORMATION."""

    _fields_ = (
        ("PerProcessUserTimeLimit", ctypes.c_int64),
        ("PerJobUserTimeLimit", ctypes.c_int64),
        ("LimitFlags", ctypes.c_uint32),
        ("MinimumWorkingSetSize", ctypes.c_size_t),
        ("MaximumWorkingSetSize", ctypes.c_size_t),
        ("ActiveProcessLimit", ctypes.c_uint32),
        ("Affinity", ctypes.c_size_t),
        ("PriorityClass", ctypes.c_uint32),
        ("SchedulingClass", ctypes.c_uint32),
        ("IoInfo", ctypes.c_uint64 * 6),
        ("ProcessMemoryLimit", ctypes.c_size_t),
        ("JobMemoryLimit", ctypes.c_size_t),
        ("PeakProcessMemoryUsed", ctypes.c_size_t),
        ("PeakJobMemoryUsed", ctypes.c_size_t),
    )


def limit_windows_memory(n_bytes: int, kernel: Any = None) -> bool:
    """Let this process of Windows, which has no ``setrlimit``, commit so much memory and no more: by a job object.

    Returns:
        Whether the system (``kernel32``) took it: one that lets no process into a job leaves the limit of time.
    """
    kernel = kernel or ctypes.WinDLL("kernel32")  # type: ignore[attr-defined]
    for call in (kernel.CreateJobObjectW, kernel.GetCurrentProcess):
        call.restype = ctypes.c_void_p  # handles are pointers, and an int is shorter
    job = kernel.CreateJobObjectW(None, None)
    # JOB_OBJECT_LIMIT_PROCESS_MEMORY, and the class of JobObjectExtendedLimitInformation
    limits, kind = _Limits(ProcessMemoryLimit=n_bytes, LimitFlags=0x100), 9
    limited = kernel.SetInformationJobObject(ctypes.c_void_p(job), kind, ctypes.byref(limits), ctypes.sizeof(limits))
    own = ctypes.c_void_p(kernel.GetCurrentProcess())
    return bool(job and limited and kernel.AssignProcessToJobObject(ctypes.c_void_p(job), own))
