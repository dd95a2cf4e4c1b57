"""What points are called: a list with a name a line, as DLTdv takes it, or any file that has names."""

from pathlib import Path

from mocap.errors import FormatError
from mocap.io.lines import read_lines
from mocap.io.registry import read
from mocap.text import visible


def point_names(path: Path, count: int) -> list[str]:
    """The names of so many points, in their order.

    Args:
        path: A text with a name a line (``pointnames.txt``), or with all in one, between commas or tabs; else a file of
            any known format.
        count: Points of the recording that they belong to.

    Raises:
        FormatError: there are not as many, or one appears twice.
    """
    try:
        names = list(read(path).names)
    except FormatError:
        lines = [line.strip() for line in read_lines(path) if line.strip()]
        cells = lines if len(lines) > 1 else lines[0].replace("\t", ",").split(",")
        names = [visible(cell.strip().strip('"')) for cell in cells]
    if len(names) != count:
        raise FormatError(
            f"{path.name}: {len(names)} names for {count} points of the recording: give one name a line, in its order"
        )
    if len(set(names)) != count:
        raise FormatError(f"{path.name}: {max(names, key=names.count)!r} appears twice: rename one")
    return names
