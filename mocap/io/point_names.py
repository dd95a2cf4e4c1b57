"""What points are called: a list with a name a line, as DLTdv takes it, or any file that has names."""

from collections.abc import Sequence
from pathlib import Path

from mocap.errors import FormatError
from mocap.io.lines import read_lines
from mocap.io.registry import read
from mocap.text import visible


def point_names(given: Path | Sequence[str], count: int) -> list[str]:
    """The names of so many points, in their order.

    Args:
        given: A list of them; or a text with a name a line (``pointnames.txt``), or with all in one, between commas or
            tabs; else a file of any known format.
        count: Points of the recording that they belong to.

    Raises:
        FormatError: there are not as many, or one appears twice.
    """
    where = given.name if isinstance(given, Path) else "`names`"
    names = _of_file(given) if isinstance(given, Path) else list(given)
    if len(names) != count:
        raise FormatError(
            f"{where}: {len(names)} names for {count} points of the recording: give one name a line, in its order"
        )
    if len(set(names)) != count:
        raise FormatError(f"{where}: {max(names, key=names.count)!r} appears twice: rename one")
    return names


def _of_file(path: Path) -> list[str]:
    try:
        return list(read(path).names)
    except FormatError:
        lines = [line.strip() for line in read_lines(path) if line.strip()]
        cells = lines if len(lines) > 1 else lines[0].replace("\t", ",").split(",")
        return [visible(cell.strip().strip('"')) for cell in cells]
