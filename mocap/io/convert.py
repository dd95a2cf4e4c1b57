"""From one format to another."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mocap.calls import check_stated
from mocap.io.contents import FileContents
from mocap.io.format import Hints
from mocap.io.registry import read, write, writer
from mocap.io.together import joined


def convert_files(
    files: Sequence[Path],
    out: Path,
    *,
    hints: Hints,
    to: str | None = None,
    fps: float | None = None,
    unit: str | None = None,
    filled: bool = False,
    contents: FileContents | None = None,
) -> dict[str, Any]:
    """Read, join and write.

    Args:
        files: Files of any format.
        out: File to write, as ``mocap.io.output.result_file`` gives it; DLTdv's set has its name's beginning.
        hints: What the user states of the files.
        to: Format; None: as the end of the name says.
        fps: Frames a second; replaces what the files say.
        unit: Of lengths, where the files do not state it.
        filled: As in ``mocap.io.registry.write``.
        contents: What is written in place of what the files hold; None: that.

    Returns:
        ``format``, names of the files ``written``, ``remarks`` on what is not held or held otherwise, ``findings`` of
        readers.

    Raises:
        MocapError: a file cannot be read, the format cannot hold it, or a file exists.
    """
    check_stated("fps", fps)
    format = writer(out, to)
    recording = joined([read(path, hints) for path in files]) if contents is None else contents
    recording = recording if fps is None else recording.with_rate(fps)
    recording = recording if unit is None else recording.with_unit(unit)
    remarks = write(recording, out, format.name, filled=filled)
    return {
        "format": format.name,
        "written": [path.name for path in format.files(out, recording)],
        "remarks": remarks,
        "findings": list(recording.remarks),
    }
