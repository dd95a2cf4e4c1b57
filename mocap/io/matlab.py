"""MATLAB files of version 5 and later: through SciPy, those of 7.3 through h5py."""

import pickle
from functools import lru_cache
from pathlib import Path
from typing import Any

from mocap.errors import FormatError
from mocap.io.apart import read_apart

SECONDS = 20.0


def variables(path: Path) -> dict[str, Any]:
    """All variables; structs as dictionaries. Not to be changed: the same file is read once.

    Raises:
        FormatError: the file is absent, or cannot be read.
    """
    if not path.is_file():
        raise FormatError(f"{path}: cannot be read: no such file")
    stat = path.stat()
    return _variables(path, stat.st_mtime_ns, stat.st_size)


@lru_cache(maxsize=1)
def _variables(path: Path, _changed_ns: int, _size: int) -> dict[str, Any]:
    """The variables of a file in one state; the sniffers and the reader ask for them in turn."""
    return pickle.loads(read_apart(path, "matlab_process", kind="MATLAB", seconds=SECONDS))
