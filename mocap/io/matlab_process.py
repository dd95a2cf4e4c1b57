"""The part of reading a MATLAB file that runs in a process of its own: ``matlab_process FILE MOST``.

Damaged files send SciPy (1.17) and the HDF5 library (2.0) into endless loops and forbidden memory. Exit 0 and a pickle
of plain values, or exit 3 and a message on stdout.
"""

import pickle
import sys
import zlib
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from scipy.io import loadmat

from mocap.io.apart import answer
from mocap.io.hdf5_process import announced as of_dataset

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


def of_hdf5(path: str, most: int) -> dict[str, Any]:
    """The variables of a file of version 7.3, which is HDF5, as SciPy gives those of earlier ones.

    Raises:
        MemoryError: they announce more than ``most`` bytes.
    """
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
        total += of_dataset(item)
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


def values(path: str, most: int) -> bytes:
    """The variables, structs as dictionaries; what is plain, pickled.

    Raises:
        MemoryError: they announce more than ``most`` bytes.
    """
    if h5py.is_hdf5(path):
        return pickle.dumps(plain(of_hdf5(path, most)))
    if announced(Path(path)) > most:
        raise MemoryError
    return pickle.dumps(plain(loadmat(path, simplify_cells=True)))


if __name__ == "__main__":
    sys.exit(answer(values))
