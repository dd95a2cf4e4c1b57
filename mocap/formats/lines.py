"""Text exports of motion-capture systems: lines of a head, then rows of cells with numbers."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mocap.arrays import Array
from mocap.errors import FormatError

_MISSING = ("", "NA", "NaN", "nan")


def read_lines(path: Path) -> list[str]:
    """The lines of a text file, without their ends.

    Raises:
        FormatError: it cannot be read, is empty, no text, or does not end with a line's end, as a cut file does.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror}") from None
    if not data.strip():
        raise FormatError(f"{path.name}: the file is empty: export it again")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise FormatError(
            f"{path.name}: not a text file; expected the text export of a motion-capture system"
        ) from None
    if "\0" in text:
        raise FormatError(f"{path.name}: not a text file; expected the text export of a motion-capture system")
    if text[-1] not in "\r\n":
        raise FormatError(
            f"{path.name}: the last line has no end, the file seems to be cut: export it again (or, if it is whole, "
            "end it with an empty line)"
        )
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")[:-1]


def numbers(path: Path, lines: Sequence[str], *, separator: str, columns: int, first_line: int) -> Array:
    """Rows of numbers; NaN where a cell is empty or ``NA``.

    Args:
        path: Of the file, for messages.
        lines: One a row; an empty cell too many at the end is none.
        separator: Between cells.
        columns: Cells that each row must have.
        first_line: Number of the first of ``lines`` in the file, from 1.

    Returns:
        (rows, columns) numbers.

    Raises:
        FormatError: a row has another number of cells, or a cell is no finite number.
    """
    rows = []
    for number, line in enumerate(lines, start=first_line):
        cells = line.split(separator)
        if len(cells) == columns + 1 and not cells[-1].strip():
            cells.pop()
        if len(cells) != columns:
            raise FormatError(
                f"{path.name}: line {number} has {len(cells)} cells, expected {columns} as the head says: "
                "the file is cut or was edited; export it again"
            )
        rows.append(["nan" if cell.strip() in _MISSING else cell for cell in cells])
    try:
        values = np.array(rows, dtype=np.float64).reshape(len(rows), columns)
        bad = np.argwhere(np.isinf(values))
    except ValueError:
        bad = [(i, j) for i, row in enumerate(rows) for j, cell in enumerate(row) if not _is_number(cell)][:1]
        values = np.empty(0)
    if len(bad):
        i, j = bad[0]
        raise FormatError(
            f"{path.name}: line {i + first_line}, cell {j + 1}: {rows[i][j].strip()!r} is not a finite number; "
            "correct it, or leave it empty if the marker was not seen"
        )
    return values


def _is_number(cell: str) -> bool:
    try:
        return bool(np.isfinite(float(cell))) or cell == "nan"
    except ValueError:
        return False


def one_line(error: Exception) -> str:
    """What a library says, without its line ends."""
    return " ".join(str(error).split())


def points(values: Array, *, unit_m: float) -> Array:
    """(T, 3 M) columns X, Y, Z of each marker to (T, M, 3) metres; NaN where a coordinate is missing."""
    xyz = values.reshape(len(values), -1, 3) * unit_m
    xyz[np.isnan(xyz).any(axis=-1)] = np.nan
    return xyz
