"""Numpy archives (npz), whose sizes are looked at before anything is unpacked."""

import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy


@contextmanager
def opened(path: Path) -> Iterator[Mapping[str, Any]]:
    """The arrays of an archive by name, read where they are asked for; no pickled objects.

    Raises:
        ValueError: it is no regular file; the archive announces more than a file of its size can hold; or an array has
            another size than its part of the archive.
    """
    if path.exists() and not path.is_file():
        raise ValueError("it is a folder, a pipe or a device")
    with path.open("rb") as stream:
        size = path.stat().st_size
        with zipfile.ZipFile(stream) as archive:
            parts = archive.infolist()
            total = sum(part.file_size for part in parts)
            if total > max(2**29, 100 * size):  # half a GiB, or 100 times its own size
                raise ValueError(f"it would take {total / 1e9:.3g} GB unpacked, the file has {size / 1e6:.3g} MB")
            for part in parts:
                with archive.open(part) as member:
                    version = npy.read_magic(member)
                    if version > (2, 0):
                        raise ValueError(f"{part.filename} is of version {version} of numpy's format")
                    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
                    shape, _, kind = read(member)
                    if prod(shape) * kind.itemsize > part.file_size:
                        raise ValueError(f"{part.filename} has shape {shape}, but {part.file_size} bytes")
        stream.seek(0)
        with np.load(stream, allow_pickle=False) as file:
            yield file
