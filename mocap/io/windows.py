"""The memory that a process of Windows may take: a job object, as Windows has no ``setrlimit``."""

import ctypes
from typing import Any

_PROCESS_MEMORY = 0x100  # JOB_OBJECT_LIMIT_PROCESS_MEMORY
_EXTENDED = 9  # JobObjectExtendedLimitInformation


class _Basic(ctypes.Structure):
    """JOBOBJECT_BASIC_LIMIT_INFORMATION."""

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
    )


class _Extended(ctypes.Structure):
    """JOBOBJECT_EXTENDED_LIMIT_INFORMATION."""

    _fields_ = (
        ("BasicLimitInformation", _Basic),
        ("IoInfo", ctypes.c_uint64 * 6),
        ("ProcessMemoryLimit", ctypes.c_size_t),
        ("JobMemoryLimit", ctypes.c_size_t),
        ("PeakProcessMemoryUsed", ctypes.c_size_t),
        ("PeakJobMemoryUsed", ctypes.c_size_t),
    )


def limit_memory(n_bytes: int, kernel: Any = None) -> bool:
    """Let this process commit so much memory and no more: what asks for more gets none, a MemoryError in Python.

    Args:
        n_bytes: As much.
        kernel: ``kernel32``; None: that of the system.

    Returns:
        Whether the system took it: one that lets no process into a job leaves the limit of time.
    """
    kernel = kernel or ctypes.WinDLL("kernel32")  # type: ignore[attr-defined]
    for call in (kernel.CreateJobObjectW, kernel.GetCurrentProcess):
        call.restype = ctypes.c_void_p  # handles are pointers, and an int is shorter
    job = kernel.CreateJobObjectW(None, None)
    limits = _Extended(ProcessMemoryLimit=n_bytes)
    limits.BasicLimitInformation.LimitFlags = _PROCESS_MEMORY
    size = ctypes.sizeof(limits)
    stated = kernel.SetInformationJobObject(ctypes.c_void_p(job), _EXTENDED, ctypes.byref(limits), size)
    own = ctypes.c_void_p(kernel.GetCurrentProcess())
    return bool(job and stated and kernel.AssignProcessToJobObject(ctypes.c_void_p(job), own))
