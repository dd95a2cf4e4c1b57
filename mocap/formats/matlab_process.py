"""The part of reading a MATLAB file that runs in a process of its own: ``python matlab_process.py FILE OUT``.

Damaged files send SciPy (1.17) into endless loops and forbidden memory. Exit 0 and a pickle of plain values, or exit 3
and a message on stdout.
"""

import pickle
import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat

MOST_BYTES = 8 << 30
REFUSED = 3


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


def main(path: str, out: str) -> int:
    """Read with SciPy, structs as dictionaries; write what is plain."""
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))
    except (ImportError, ValueError, OSError):
        pass  # this system knows no such limits: the time limit of the caller is left
    try:
        table = plain(loadmat(path, simplify_cells=True))
        Path(out).write_bytes(pickle.dumps(table))
    except Exception as error:  # SciPy raises whatever its parser stumbles over
        sys.stdout.write(f"{type(error).__name__}: {' '.join(str(error).split())}")
        return REFUSED
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
