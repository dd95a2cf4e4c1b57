"""Text exports of motion-capture systems: lines of a head, then rows of cells with numbers."""

import re
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path, PurePath
from typing import Any, AnyStr

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.errors import FormatError
from mocap.schema import LARGEST

MOST_FRAMES = 10**9  # twelve days at 1 kHz
FRAMES = (
    r"(frames?|fnum|img|images?|pictures?|samples?|index|idx|timestamps?|bild)"
    r"[ _.#-]*(no|nr|num|number|numbers|index|idx|id|count|counter)?[.#]?"
)
"""Titles of a column of frame numbers, for ``re.IGNORECASE``."""
_PRINTF = ("-NaN", "-nan", "-nan(ind)", "nan(ind)", "1.#QNAN", "-1.#QNAN", "-1.#IND")
_WORDS = ("na", "nan", "n/a", "n.a.", "#n/a", "<na>", "null", "(null)", "none", "missing", "undefined")
_SIGNS = ("", "-", "--", "---", ".", "..", "...", "*", "#NV", "#VALUE!", "#DIV/0!", "#NUM!", "#REF!")
"""Of people and spreadsheets: what they leave where there is no number, and what Excel shows where none comes out."""
MISSING_WORDS = frozenset(
    (
        *_PRINTF,
        *_SIGNS,
        *(spelt for word in _WORDS for spelt in (word, word.upper(), word.title(), word.capitalize())),
        "NaN",
    )
)
"""Cells of tables, of any program, that say that a number is missing."""
_NO_NUMBER = re.compile(r"[^0-9eE+.\-]")
"""Letters that Python's float takes, but no program writes: underscores, digits of other scripts, infinity."""


def read_lines(path: Path) -> list[str]:
    """The lines of a text file, without their ends.

    Raises:
        FormatError: it cannot be read, is empty, or no text.
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
        text = "\0"
    if "\0" in text:
        raise FormatError(f"{path.name}: not a text file; expected the text export of a motion-capture system")
    return one_kind(text).removesuffix("\n").split("\n")


def one_kind(text: AnyStr) -> AnyStr:
    """Text with the line ends of Unix; those of Windows, also where they were translated twice, and of old Macs go."""
    if isinstance(text, bytes):
        return one_kind(text.decode("latin-1")).encode("latin-1") if b"\r" in text else text
    while "\r\r\n" in text:
        text = text.replace("\r\r\n", "\r\n")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def numbers(path: Path, lines: Sequence[str], *, separator: str, columns: int, first_line: int) -> Array:
    """(rows, columns) numbers of lines, a row each; NaN where a cell is empty or ``NA``.

    Empty cells too many at the end are none where all rows have as many. ``first_line`` is the number of the first of
    ``lines`` in the file, from 1.

    Raises:
        FormatError: a row has another number of cells, or a cell is no number.
    """
    rows = [line.split(separator) for line in lines]
    usual = Counter(map(len, rows)).most_common(1)[0][0] if rows else columns
    closed = usual > columns and not any("".join(row[columns:]).strip() for row in rows if len(row) == usual)
    surplus = usual - columns if closed else 0
    for place, cells in enumerate(rows, start=first_line):
        if len(cells) != columns + surplus:
            raise FormatError(
                f"{path.name}: line {place} has {len(cells) - surplus} cells, expected {columns} as the header "
                "states: correct it, or export it again"
            )
    rows = [["nan" if cell.strip() in MISSING_WORDS else cell for cell in row[:columns]] for row in rows]
    values, bad = _array(rows, columns, plain=all(line.isascii() and "_" not in line for line in lines))
    bad = np.argwhere(bad | (np.abs(values) > LARGEST))
    if len(bad):
        i, j = bad[0]
        trouble = "is larger than any measured value" if np.isfinite(number(rows[i][j])) else "is not a finite number"
        raise FormatError(
            f"{path.name}: line {i + first_line}, cell {j + 1}: {rows[i][j].strip()!r} {trouble}; "
            "correct it, or leave it empty if the marker was not seen"
        )
    return values


def number(text: str) -> float:
    """A number as programs write it; NaN where it is none.

    Python takes more: ``1_000``, digits of other scripts, ``infinity``.
    """
    text = text.strip()
    try:
        return np.nan if _NO_NUMBER.search(text) else float(text)
    except ValueError:
        return np.nan


def _array(rows: list[list[str]], columns: int, *, plain: bool) -> tuple[Array, NDArray[np.bool_]]:
    """(rows, columns) numbers, and where a cell is none; only ``plain`` text is what NumPy and we read alike."""
    if plain:
        with suppress(ValueError):
            return np.array(rows, dtype=np.float64).reshape(len(rows), columns), np.zeros((len(rows), columns), bool)
    values = np.array([[number(cell) for cell in row] for row in rows]).reshape(len(rows), columns)
    return values, np.isnan(values) & (np.array(rows).reshape(len(rows), columns) != "nan")


def frame_numbers(path: Path, values: Any, *, first_line: int | None = None) -> NDArray[np.int64]:
    """Whole numbers that increase, from a column of (T,) numbers, the first of them in line ``first_line``.

    Raises:
        FormatError: one is none, or does not increase; the message names its line, or its row.
    """
    values = np.asarray(values, dtype=np.float64)
    with np.errstate(invalid="ignore"):
        wrong = ~((values == np.round(values)) & (np.abs(values) < MOST_FRAMES))
        falling = np.append(False, ~(np.diff(values) > 0)) if first_line is not None else np.zeros_like(wrong)
    if (wrong | falling).any():
        row = int(np.argmax(wrong | falling))
        where = f"row {row + 1}" if first_line is None else f"line {row + first_line}"
        trouble = f"{values[row]:.12g} is not a frame number below {MOST_FRAMES:.0e}"
        if np.isnan(values[row]):
            trouble = "no frame number"
        elif not wrong[row]:
            trouble = f"{values[row]:.12g} follows frame {values[row - 1]:.12g}"
        raise FormatError(f"{path.name}: {where}: {trouble}; expected whole numbers that increase: correct them")
    return values.astype(np.int64)


def image_numbers(names: Sequence[str]) -> list[int] | None:
    """The numbers that end the names of images (before ``.png``); None where one has none, or two have the same."""
    ends = [re.search(r"(\d{1,8})$", PurePath(name).stem) for name in names]
    numbers = [int(end[1]) for end in ends if end]
    return numbers if len(set(numbers)) == len(names) else None
