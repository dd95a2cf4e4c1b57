"""MATLAB files of versions 5 to 7.2, through SciPy."""

from pathlib import Path
from typing import Any

from scipy.io import loadmat

from mocap.errors import FormatError


def variables(path: Path) -> dict[str, Any]:
    """All variables; structs as dictionaries.

    Raises:
        FormatError: the file is absent, or SciPy cannot read it.
    """
    if not path.is_file():
        raise FormatError(f"{path}: cannot be read: no such file")
    try:
        return loadmat(path, simplify_cells=True)
    except Exception as error:  # SciPy raises whatever its parser stumbles over
        raise FormatError(
            f"{path.name}: not a readable MATLAB file of version 5 to 7.2 ({type(error).__name__}: {error}): it is cut "
            "or damaged; save it again"
        ) from None
