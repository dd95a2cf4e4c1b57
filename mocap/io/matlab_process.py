"""The part of reading a MATLAB file that runs in a process of its own: ``matlab_process FILE MOST``.

Damaged files send SciPy (1.17) into endless loops and forbidden memory. Exit 0 and a pickle of plain values, or exit 3
and a message on stdout.
"""

import pickle
import sys
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat

from mocap.io.apart import answer

_HEAD = 128
_COMPRESSED = 15


def plain(value: Any) -> Any:
    """Dictionaries, lists, arrays and numbers as they are; anything else (functions, opaque objects) as None."""
    if isinstance(value, dict):
        return {str(key): plain(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [plain(inner) for inner in value]
    if isinstance(value, np.ndarray) and value.dtype.kind == "O":
        out = np.empty(value.shape, dtype=object)
        for index in np.ndindex(value.shape):
            out[index] = plain(value[index])
        return out
    if isinstance(value, np.ndarray):
        return value if type(value) is np.ndarray and value.dtype.kind in "biufcSU" else None
    return value if isinstance(value, bool | int | float | complex | str | bytes | np.generic) else None


def announced(path: Path) -> int:
    """Bytes that the variables of a file say they have unpacked: a tag of type and size stands before each.

    Raises:
        ValueError: a variable is longer than the file.
    """
    total, size = 0, path.stat().st_size
    with path.open("rb") as stream:
        order = "big" if stream.read(_HEAD)[126:128] == b"MI" else "little"
        while len(tag := stream.read(8)) == 8:
            kind, length = (int.from_bytes(tag[i : i + 4], order) for i in (0, 4))
            start = stream.tell()
            if start + length > size:
                raise ValueError(f"a variable of {length} bytes at byte {start} ends after the file")
            if kind == _COMPRESSED:
                inner = zlib.decompressobj().decompress(stream.read(min(length, 256)), 8)
                total += int.from_bytes(inner[4:8], order)
            else:
                total += length
            stream.seek(start + length)
    return total


def values(path: str, most: int) -> bytes:
    """The variables, read with SciPy, structs as dictionaries; what is plain, pickled.

    Raises:
        MemoryError: they announce more than ``most`` bytes.
    """
    if announced(Path(path)) > most:
        raise MemoryError
    return pickle.dumps(plain(loadmat(path, simplify_cells=True)))


if __name__ == "__main__":
    sys.exit(answer(values))
