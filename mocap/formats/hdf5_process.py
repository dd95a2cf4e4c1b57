"""A walk through an HDF5 file in a process of its own: ``python hdf5_process.py FILE OUT``.

Damaged files send the HDF5 library (2.0) into endless loops. Everything is read once here; what comes to an end here
does so in the program that asked. Exit 0 and the names at the root as JSON, or exit 3 and a message on stdout.
"""

import json
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py

REFUSED = 3
_TROUBLE = (OSError, RuntimeError, KeyError, ValueError, TypeError, UnicodeError, AttributeError, MemoryError)


def look(_name: str, item: Any) -> None:
    """Read attributes and values; what cannot be read is the reader's to refuse."""
    for key in list(item.attrs):
        with suppress(*_TROUBLE):
            item.attrs[key]
    if isinstance(item, h5py.Dataset):
        with suppress(*_TROUBLE):
            item[()]


def main(path: str, out: str) -> int:
    """Walk; write the names at the root."""
    try:
        with h5py.File(path, "r") as file:
            names = [str(name) for name in file]
            with suppress(*_TROUBLE):
                file.visititems(look)
        Path(out).write_text(json.dumps(names))
    except Exception as error:  # a damaged file may raise anything
        sys.stdout.write(" ".join(str(error).split()) or type(error).__name__)
        return REFUSED
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
