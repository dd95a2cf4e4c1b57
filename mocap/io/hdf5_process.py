"""A walk through an HDF5 file in a process of its own: ``hdf5_process FILE MOST``.

Damaged files send the HDF5 library (2.0) into endless loops. Everything is read once here; what comes to an end here
does so in the program that asked. Exit 0 and the names at the root as JSON, or exit 3 and a message on stdout.
"""

import json
import math
import sys
from contextlib import suppress
from typing import Any

import h5py

from mocap.io.apart import answer

_TROUBLE = (OSError, RuntimeError, KeyError, ValueError, TypeError, UnicodeError, AttributeError)


def announced(item: Any) -> int:
    """Bytes that a dataset says it has, or one of its chunks where that is more."""
    chunk = math.prod(item.chunks) if item.chunks else 0
    return max(math.prod(item.shape or (0,)), chunk) * item.dtype.itemsize


def names(path: str, most: int) -> bytes:
    """Names at the root, after a walk that reads attributes and values; what cannot be read is the reader's to refuse.

    Tables of pandas are named a second time, with its mark: ``NAME/pandas_type``.

    Raises:
        MemoryError: datasets announce more than ``most`` bytes.
    """
    total = 0

    def look(_name: str, item: Any) -> None:
        nonlocal total
        for key in list(item.attrs):
            with suppress(*_TROUBLE):
                item.attrs[key]
        if isinstance(item, h5py.Dataset):
            with suppress(*_TROUBLE):
                total += announced(item)
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
    return json.dumps(root).encode()


if __name__ == "__main__":
    sys.exit(answer(names))
