"""Numeric CSV tables with one header line, checked cell by cell before anything is believed."""

import csv
import io
import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd

from mocap.arrays import Array
from mocap.errors import FormatError

MISSING_WORDS = ["", "NaN", "nan", "NAN", "NA"]


def read_table(path: Path, *, header: bool = True) -> tuple[list[str], Array]:
    """Read names and numbers.

    Args:
        path: A comma-separated file; missing cells are empty, ``NaN`` or ``NA``.
        header: Whether the first line holds the names.

    Returns:
        The names (empty without a header) and the (rows, columns) numbers, NaN where missing.

    Raises:
        FormatError: the file is missing, empty, cut, ragged, or has a cell that is no number.
    """
    data = _bytes_of(path)
    end = data.find(b"\n") + 1 if header else 0
    if header and end == 0:
        end = len(data)
    try:
        names = next(csv.reader([data[:end].decode("utf-8-sig").strip()])) if header else []
    except UnicodeDecodeError:
        raise FormatError(f"{path.name}: not a text file; expected a CSV table") from None
    names = [name.strip() for name in names]
    body = data[end:].replace(b"\r\n", b"\n").replace(b"\r", b"\n").rstrip(b"\n \t")
    if not body:
        raise FormatError(
            f"{path.name}: holds no rows of numbers; expected a table with a row a frame: export it again"
        )
    first_line = 2 if header else 1
    _check_columns(path, body, len(names) if header else None, first_line)
    if not data.endswith((b"\n", b"\r")):
        _check_last_cell(path, body)
    try:
        table = pd.read_csv(
            io.BytesIO(body), header=None, dtype=np.float64, na_values=MISSING_WORDS, skip_blank_lines=False
        )
    except ValueError:
        raise FormatError(_bad_cell(path, body, names, first_line)) from None
    values = table.to_numpy()
    if np.isinf(values).any():
        row, column = np.argwhere(np.isinf(values))[0]
        where = names[column] if names else f"column {column + 1}"
        raise FormatError(f"{path.name}: line {row + first_line}, {where}: infinite; expected a number or NaN")
    return names, values


def _bytes_of(path: Path) -> bytes:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror}") from None
    if not data.strip():
        raise FormatError(f"{path.name}: the file is empty: export it again")
    return data


def _check_columns(path: Path, body: bytes, expected: int | None, first_line: int) -> None:
    """Every line has as many cells as the header (or the first line) has."""
    raw = np.frombuffer(body, dtype=np.uint8)
    ends = np.append(np.flatnonzero(raw == ord("\n")), len(raw))
    cells = np.diff(np.searchsorted(np.flatnonzero(raw == ord(",")), ends), prepend=0) + 1
    expected = expected or int(cells[0])
    wrong = np.flatnonzero(cells != expected)
    if len(wrong):
        i = int(wrong[0])
        hint = ": the file seems to be cut there" if i == len(cells) - 1 and cells[i] < expected else ""
        raise FormatError(
            f"{path.name}: line {i + first_line} has {cells[i]} cells, expected {expected}{hint}; export it again"
        )


def _check_last_cell(path: Path, body: bytes) -> None:
    """A last line without its newline may be cut inside a number: its last cell then has fewer decimals."""
    lines = body.rsplit(b"\n", 2)
    cells = [line.rsplit(b",", 1)[-1].strip() for line in lines[-2:]]
    if len(cells) == 2 and all(b"." in cell for cell in cells):
        decimals = [len(cell.split(b".")[1]) for cell in cells]
        if decimals[1] < decimals[0]:
            raise FormatError(
                f"{path.name}: the last cell {cells[1].decode()!r} seems to be cut; export the file again"
            )


def _bad_cell(path: Path, body: bytes, names: Sequence[str], first_line: int) -> str:
    for i, row in enumerate(csv.reader(io.StringIO(body.decode("utf-8", "replace")))):
        for j, cell in enumerate(row):
            if cell.strip() not in MISSING_WORDS:
                try:
                    float(cell)
                except ValueError:
                    where = names[j] if names else f"column {j + 1}"
                    line = i + first_line
                    return f"{path.name}: line {line}, {where}: {cell!r} is not a number; correct it or write NaN"
    return f"{path.name}: holds cells that are not numbers"


@contextmanager
def whole_file(path: Path) -> Iterator[io.TextIOWrapper]:
    """Write a text file under a temporary name and rename it when it is whole; on an error nothing is left."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    try:
        with open(handle, "w", encoding="utf-8", newline="") as stream:
            yield stream
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def write_table(path: Path, names: Sequence[str], values: Array, *, decimals: int = 6) -> None:
    """Write names and (rows, columns) numbers, ``NaN`` where missing."""
    with whole_file(path) as stream:
        if names:
            csv.writer(stream, lineterminator="\n").writerow(names)
        pd.DataFrame(values).to_csv(
            stream, header=False, index=False, float_format=f"%.{decimals}f", na_rep="NaN", lineterminator="\n"
        )
