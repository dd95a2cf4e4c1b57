"""Where the recording of a result is."""

from pathlib import Path

from mocap.errors import MocapError, beside
from mocap.io.manifest import current


class StoredError(MocapError):
    """There is no recording."""

    page = "looking"


def recording_file(path: Path) -> Path:
    """The file of a recording, or of the run in a folder.

    Raises:
        StoredError: there is none.
    """
    file = current(path, "recording.rrd") if path.is_dir() else path
    if not file.is_file():
        trouble = "there is no recording" if path.exists() else f"there is no such file or folder{beside(path)}"
        raise StoredError(f"{path}: {trouble}: give a folder that mocap track or mocap demo wrote")
    return file
