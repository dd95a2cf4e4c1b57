"""MATLAB (5 and later), HDF5 and classic NetCDF files: first read in a process of their own, ``apart KIND FILE MOST``.

Damaged files send SciPy (1.17) and the HDF5 library (2.0) into endless loops and forbidden memory. That process exits
with 0 and a pickle of plain values, or with REFUSED and a message on stdout. What it reads comes back through a pipe:
no folder for temporary files can be full.
"""

import ctypes
import io
import math
import os
import pickle
import subprocess
import sys
import zlib
from contextlib import suppress
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

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


REFUSED = 3
"""Exit code where the file is refused; the reason is on stdout."""
SPARE_BYTES = 1 << 29
"""What libraries may need beside what they read."""
_TROUBLE = (OSError, RuntimeError, KeyError, ValueError, TypeError, UnicodeError, AttributeError)


def variables(path: Path) -> dict[str, Any]:
    """All variables of a MATLAB file; structs as dictionaries. Not to be changed: the same file is read once.

    Raises:
        FormatError: the file is absent, or cannot be read.
    """
    if not path.is_file():
        raise FormatError(f"{path}: cannot be read: no such file")
    return _once(path, "MATLAB", path.stat().st_mtime_ns, path.stat().st_size)


def root_names(path: Path) -> frozenset[str]:
    """Names at the root of an HDF5 file, of which all was read; tables of pandas also as ``NAME/pandas_type``.

    Raises:
        FormatError: it cannot be read.
    """
    return frozenset(_once(path, "HDF5", path.stat().st_mtime_ns, path.stat().st_size))


CLASSIC_NETCDF = (b"CDF\x01", b"CDF\x02")
"""How a NetCDF file of before HDF5 begins."""


def classic_names(path: Path) -> frozenset[str]:
    """Names of the variables of a classic NetCDF file, of which all was read.

    Raises:
        FormatError: it cannot be read.
    """
    return frozenset(_once(path, "NetCDF", path.stat().st_mtime_ns, path.stat().st_size))


@lru_cache(maxsize=2)
def _once(path: Path, kind: str, _changed_ns: int, _size: int) -> Any:
    """What a file in one state holds; the sniffers and the reader ask for it in turn."""
    return pickle.loads(read_apart(path, kind, seconds=20.0))


def read_apart(path: Path, kind: str, *, seconds: float) -> bytes:
    """What ``READERS[kind]`` gives of a file, pickled, in another process with the packages that run here.

    After so many seconds, and one for each megabyte, the file is given up.

    Raises:
        FormatError: the reader refuses the file, crashes on it, or does not come to an end.
    """
    command = [sys.executable, "-P", "-m", __name__, kind, str(path.absolute()), str(most_bytes(path))]
    packages = [str(Path(__file__).resolve().parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(packages)}
    ours, held = os.pipe()  # the system closes `held` when this process ends, and the other one sees it
    try:
        limit = seconds + path.stat().st_size / 1e6
        done = subprocess.run(command, stdin=ours, capture_output=True, timeout=limit, check=False, env=environment)
    except subprocess.TimeoutExpired:
        raise FormatError(
            f"{path.name}: was not read as {kind} within {limit:.0f} s: try again when the computer is idle"
        ) from None
    except OSError as error:
        raise FormatError(
            f"{path.name}: the process that reads it could not be started ({error.strerror}): try again"
        ) from None
    finally:
        os.close(ours)
        os.close(held)
    if done.returncode == REFUSED:
        reason = done.stdout.decode("utf-8", "replace")
        raise FormatError(f"{path.name}: cannot be read as {kind} ({reason}): copy or export it again")
    if done.returncode != 0 or not done.stdout:
        raise FormatError(f"{path.name}: the library that reads {kind} crashed on it: copy or export it again")
    return done.stdout


def _answer(kind: str, path: str, most: int) -> int:
    """The other process: what is read within limited memory, or its trouble, to stdout; what libraries print to stderr.

    Returns:
        The exit code: 0, or REFUSED.
    """
    from mocap.ending import end_with  # of processes alone

    end_with(0)
    out, code = os.dup(1), 0
    os.dup2(2, 1)
    for library in ("h5py",) if kind == "HDF5" else ("h5py", "scipy.io"):
        import_module(library)  # before memory is limited
    limit_memory(SPARE_BYTES + 2 * most)  # as it is read, and as it is sent
    try:
        result = pickle.dumps(READERS[kind](path, most))
    except MemoryError:
        result, code = b"it asks for more memory than a file of its size can need", REFUSED
    except Exception as error:  # libraries raise whatever their parsers stumble over
        words = " ".join(str(error).split())
        result, code = f"{type(error).__name__}: {words}".encode("utf-8", "replace"), REFUSED
    with open(out, "wb") as stream:
        stream.write(result)
    return code


def _announced(item: Any) -> int:
    """Bytes that a dataset says it has, or one of its chunks where that is more."""
    chunk = math.prod(item.chunks) if item.chunks else 0
    return max(math.prod(item.shape or (0,)), chunk) * item.dtype.itemsize


def hdf5_names(path: str, most: int) -> list[str]:
    """Names at the root, after a walk that reads attributes and values; what cannot be read is the reader's to refuse.

    Raises:
        MemoryError: datasets announce more than ``most`` bytes.
    """
    import h5py

    total = 0

    def look(_name: str, item: Any) -> None:
        nonlocal total
        for key in list(item.attrs):
            with suppress(*_TROUBLE):
                item.attrs[key]
        if isinstance(item, h5py.Dataset):
            with suppress(*_TROUBLE):
                total += _announced(item)
                if total > most:
                    raise MemoryError
                item[()]

    with h5py.File(path, "r") as file:
        root = [str(name) for name in file]
        with suppress(*_TROUBLE):
            file.visititems(look)
        for name in tuple(root):
            with suppress(*_TROUBLE):
                root += [f"{name}/pandas_type"] if "pandas_type" in file[name].attrs else []
    return root


def matlab_values(path: str, most: int) -> dict[str, Any]:
    """The variables, structs as dictionaries, as far as they are plain values.

    Raises:
        MemoryError: they announce more than ``most`` bytes.
    """
    import h5py
    from scipy.io import loadmat

    if h5py.is_hdf5(path):
        return _plain(_of_hdf5(path, most))
    if _announced_by_tags(Path(path)) > most:
        raise MemoryError
    return _plain(loadmat(path, simplify_cells=True))


def netcdf_names(path: str, most: int) -> list[str]:
    """Names of the variables of a classic NetCDF file, whose values lie in it as they are.

    Raises:
        MemoryError: they announce more than ``most`` bytes.
    """
    from scipy.io import netcdf_file

    with netcdf_file(path, mmap=False) as file:
        found = dict(file.variables)
        if sum(one.data.nbytes for one in found.values()) > most:
            raise MemoryError
        return [str(name) for name in found]


READERS = {"HDF5": hdf5_names, "MATLAB": matlab_values, "NetCDF": netcdf_names}


def _plain(value: Any) -> Any:
    """Dictionaries, lists, arrays and numbers as they are; anything else (functions, opaque objects) as None."""
    if isinstance(value, dict):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_plain(inner) for inner in value]
    if isinstance(value, np.ndarray) and value.dtype.kind == "O":
        out = np.empty(value.shape, dtype=object)
        for index in np.ndindex(value.shape):
            out[index] = _plain(value[index])
        return out
    if isinstance(value, np.ndarray):
        return value if type(value) is np.ndarray and value.dtype.kind in "biufcSU" else None
    return value if isinstance(value, bool | int | float | complex | str | bytes | np.generic) else None


def _announced_by_tags(path: Path) -> int:
    """Bytes that the variables of a file say they have unpacked: a tag of type and size stands before each."""
    total, size, compressed = 0, path.stat().st_size, 15
    with path.open("rb") as stream:
        order = "big" if stream.read(128)[126:128] == b"MI" else "little"
        while len(tag := stream.read(8)) == 8:
            kind, length = (int.from_bytes(tag[i : i + 4], order) for i in (0, 4))
            start = stream.tell()
            if start + length > size:
                raise ValueError(f"a variable of {length} bytes at byte {start} ends after the file")
            if kind == compressed:
                inner = zlib.decompressobj().decompress(stream.read(min(length, 256)), 8)
                total += int.from_bytes(inner[4:8], order)
            else:
                total += length
            stream.seek(start + length)
    return total


def _of_hdf5(path: str, most: int) -> dict[str, Any]:
    """The variables of a file of version 7.3, which is HDF5, as SciPy gives those of earlier ones."""
    import h5py

    total = 0

    def value(item: Any) -> Any:
        nonlocal total
        kind = item.attrs.get("MATLAB_class", b"")
        if isinstance(item, h5py.Group):
            fields = {} if "MATLAB_sparse" in item.attrs else {name: value(field) for name, field in item.items()}
            columns = [field for field in item.values() if field.attrs.get("MATLAB_class") is None]
            if not columns or len(columns) < len(item) or not all(isinstance(own, list) for own in fields.values()):
                return fields
            return [dict(zip(fields, row, strict=True)) for row in zip(*fields.values(), strict=True)]  # struct array
        total += _announced(item)
        if total > most:
            raise MemoryError
        if item.attrs.get("MATLAB_empty", 0):
            return "" if kind == b"char" else np.zeros(0)
        table = np.transpose(item[()])  # MATLAB's columns are rows there
        if item.dtype == h5py.ref_dtype:
            return [value(item.file[reference]) for reference in table.ravel(order="F")]
        if kind == b"char":
            rows = ["".join(map(chr, row)) for row in np.atleast_2d(table)]
            return rows[0] if len(rows) == 1 else rows
        return np.squeeze(table)[()]

    with h5py.File(path, "r") as file:
        return {name: value(item) for name, item in file.items() if not name.startswith("#")}


if __name__ == "__main__":
    sys.exit(_answer(sys.argv[1], sys.argv[2], int(sys.argv[3])))


_ARRAYS = ("_reconstruct", "ndarray", "dtype", "scalar", "_frombuffer")
"""What NumPy names in the pickle of an array."""


class _Inert(dict):
    """Stands for whatever else a pickle names; it runs nothing, and keeps nothing."""

    def __init__(self, *_given: Any, **_more: Any) -> None:
        super().__init__()

    def _nothing(self, *_given: Any) -> "_Inert":
        return _Inert()

    __setstate__ = __call__ = append = extend = _nothing


class _Plain(pickle.Unpickler):
    inert = False

    def find_class(self, module: str, name: str) -> Any:
        if module.split(".")[0] == "numpy" and name in _ARRAYS:
            return super().find_class(module, name)
        if self.inert:
            return _Inert
        raise pickle.UnpicklingError(f"{module}.{name} is neither a number, a text nor an array")


def plain_pickle(data: bytes, *, inert: bool = False) -> Any:
    """What a pickle holds; other objects in it are refused, or passed over where ``inert``.

    Raises:
        Exception: a damaged pickle raises whatever it likes; ``pickle.UnpicklingError``: it holds another object.
    """
    unpickler = _Plain(io.BytesIO(data))
    unpickler.inert = inert
    return unpickler.load()
