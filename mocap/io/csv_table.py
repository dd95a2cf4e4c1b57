"""Numeric CSV tables with one header line, checked cell by cell; columns by their titles, in any order."""

import codecs
import csv
import io
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from eal.arrays import Array
from mocap.errors import FormatError
from mocap.io.lines import LARGEST, MISSING_WORDS, cells_of, one_kind
from mocap.text import number_of

BLOCK = 1 << 24
"""Bytes that are read at once: a table takes little more memory than its numbers."""
SMALL = 1 << 20
"""Fewer bytes of numbers are read here, in less time (0.1 s) than importing pandas takes (0.4 s), which reads more."""
_TRUTH = re.compile(rb"true|false", re.IGNORECASE)
_NUMBER = re.compile(r'("?)[+-]?(\d+\.?\d*|\.\d+|inf)([eE][+-]?\d+)?\1', re.ASCII)


def to_the_last_bit() -> dict[str, Any]:
    """Option of pandas' reader: from version 3.1 on it takes the nearest number by itself, and warns of the option."""
    import pandas as pd

    return {"float_precision": "round_trip"} if tuple(map(int, pd.__version__.split(".")[:2])) < (3, 1) else {}


def read_table(path: Path, *, header: bool = True) -> tuple[list[str], Array]:
    """The names (none without a header) and the (rows, columns) numbers of a comma-separated file, NaN where missing.

    Missing cells are empty, ``NaN`` or ``NA``; ``header`` says whether the first line holds the names.

    Raises:
        FormatError: the file is missing, empty, cut, ragged, or has a cell that is no number.
    """
    names, parts, line = [], [], 1
    width = None
    for block, last in _blocks(path):
        if line == 1:
            if b";" in block and b"," not in block:
                raise FormatError(f"{path.name}: cells are separated by semicolons; export it with commas")
            block = block.removeprefix(codecs.BOM_UTF8)
            if header:
                names, block = _names(path, block)
                width, line = len(names), 2
        block = block.rstrip(b"\n \t") if last else block.removesuffix(b"\n")
        if block:
            parts.append(_numbers(path, block, names, width, line))
            width, line = parts[-1].shape[1], line + len(parts[-1])
    if not parts:
        raise FormatError(
            f"{path.name}: contains no rows of numbers; expected a table with one row for each frame: export it again"
        )
    values = parts[0] if len(parts) == 1 else np.concatenate(parts)
    if names and not names[-1] and np.isnan(values[:, -1]).all():  # every line ends in a comma
        return names[:-1], values[:, :-1]
    return names, values


def first_cells(path: Path) -> list[str]:
    """The cells of the first line; none of a file that cannot be read."""
    with suppress(OSError, UnicodeDecodeError, FormatError), path.open(encoding="utf-8-sig", newline="") as stream:
        return [cell.strip() for cell in next(cells_of(path, [stream.readline().strip()]), [])]
    return []


def has_titles(path: Path) -> bool:
    """Whether a cell of the first line is neither a number nor one of the words for a missing one."""
    return any(cell not in MISSING_WORDS and not _NUMBER.fullmatch(cell) for cell in first_cells(path))


def _blocks(path: Path) -> Iterator[tuple[bytes, bool]]:
    """Whole lines of the file, some megabytes at a time, with line ends of one kind; and whether they are the last."""
    try:
        with path.open("rb") as stream:
            pending, empty = b"", True
            while chunk := stream.read(BLOCK):
                pending += chunk
                empty = empty and not pending.strip()
                cut = pending.rfind(b"\n") + 1
                if cut and len(chunk) == BLOCK:
                    yield one_kind(pending[:cut]), False
                    pending = pending[cut:]
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror}") from None
    if empty:
        raise FormatError(f"{path.name}: the file is empty: export it again")
    yield one_kind(pending), True


def _names(path: Path, block: bytes) -> tuple[list[str], bytes]:
    first, _, rest = block.partition(b"\n")
    try:
        names = next(cells_of(path, [first.decode("utf-8-sig").strip()]), [])
    except UnicodeDecodeError:
        raise FormatError(f"{path.name}: not a text file; expected a CSV table") from None
    return [from_cell(name.strip()) for name in names], rest


def _numbers(path: Path, body: bytes, names: list[str], width: int | None, line: int) -> Array:
    """The (rows, columns) numbers of a block of lines, of which ``line`` is the number of the first.

    Each must have ``width`` cells (None: as many as the first).
    """
    if b" " in body or b"\t" in body:
        body = re.sub(rb"[ \t]*([,\n])[ \t]*", rb"\1", body.lstrip(b" \t"))
    _check_columns(path, body, width, line)
    try:
        values = _many(body) if len(body) >= SMALL else None
    except ValueError:
        values = None
    values = _few(path, body, names, line) if values is None else values
    with np.errstate(invalid="ignore"):
        wrong = np.abs(values) > LARGEST
    if wrong.any():
        row, column = np.argwhere(wrong)[0]
        where = names[column] if names else f"column {column + 1}"
        what = "infinite" if np.isinf(values[row, column]) else f"{values[row, column]:g}"
        raise FormatError(
            f"{path.name}: line {row + line}, {where}: {what}; expected a number below {LARGEST:g}, or NaN: correct it"
        )
    return values


def _few(path: Path, body: bytes, names: Sequence[str], first_line: int) -> Array:
    def value(cell: str, row: int, column: int) -> float:
        bare = cell[1:-1] if len(cell) > 1 and cell[0] == cell[-1] == '"' else cell
        if bare in MISSING_WORDS:
            return np.nan
        if _NUMBER.fullmatch(cell):
            return float(bare)
        where = names[column] if names else f"column {column + 1}"
        raise FormatError(
            f"{path.name}: line {row + first_line}, {where}: {cell!r:.80} is not a number; correct it or write NaN"
        )

    rows = [line.split(",") for line in body.decode("utf-8", "replace").split("\n")]
    with suppress(TypeError, ValueError):  # no cell in quotes, and none that is no number
        plain = [[np.nan if c in MISSING_WORDS else float(_NUMBER.fullmatch(c)[0]) for c in row] for row in rows]  # type: ignore[index]
        return np.array(plain, dtype=np.float64)
    return np.array([[value(c, i, j) for j, c in enumerate(row)] for i, row in enumerate(rows)], dtype=np.float64)


def _many(body: bytes) -> Array:
    """The same by pandas.

    Raises:
        ValueError: a cell is no number.
    """
    import pandas as pd

    if any(letter in body for letter in (b"u", b"U", b"l", b"L")) and _TRUTH.search(body):
        raise ValueError("pandas reads these as 1 and 0")
    table = pd.read_csv(
        io.BytesIO(body),
        header=None,
        dtype=np.float64,
        na_values=list(MISSING_WORDS),
        keep_default_na=False,
        skip_blank_lines=False,
        **to_the_last_bit(),
    )
    return table.to_numpy()


def _check_columns(path: Path, body: bytes, expected: int | None, first_line: int) -> None:
    """Every line has as many cells as the header (or the first line) has."""
    raw = np.frombuffer(body + b"\n", dtype=np.uint8)
    starts = np.append(0, np.flatnonzero(raw == ord("\n"))[:-1] + 1)
    cells = np.add.reduceat(raw == ord(","), starts, dtype=np.int64) + 1
    expected = expected or int(cells[0])
    wrong = np.flatnonzero(cells != expected)
    if len(wrong):
        i = int(wrong[0])
        hint = ": the file seems to be cut there" if i == len(cells) - 1 and cells[i] < expected else ""
        raise FormatError(
            f"{path.name}: line {i + first_line} has {cells[i]} cells, expected {expected}{hint}; export it again"
        )


def write_table(path: Path, names: Sequence[str], values: Array, *, decimals: int = 6) -> None:
    """Write names and (rows, columns) numbers, ``NaN`` where missing."""
    row = ",".join([f"%.{decimals}f"] * values.shape[1]) + "\n"
    with path.open("w", encoding="utf-8", newline="") as stream:
        if names:
            csv.writer(stream, lineterminator="\n").writerow(as_cells(names))
        stream.writelines((row % tuple(one.tolist())).replace("nan", "NaN") for one in values)


_FORMULA = "=+-@\t\r\n＝＋－＠'"
"""Text that begins so is written after an apostrophe; the apostrophe itself, so that every text comes back."""
_ESCAPES = {"\\": "\\\\", "\t": "\\t", "\r": "\\r", "\n": "\\n", ";": "\\x3b"}
_PLAIN = {escape: letter for letter, escape in _ESCAPES.items()}
_SPLITS = re.compile(r"[\t\r\n;]")


def as_cell(text: str) -> str:
    """The cell of a text, inverse of ``from_cell``."""
    if not text or (text[0] not in _FORMULA and not _SPLITS.search(text)):
        return text
    return "'" + re.sub(r"[\\\t\r\n;]", lambda found: _ESCAPES[found[0]], text)


def from_cell(cell: str) -> str:
    """The text of a cell; of other programs' cells the text itself, unless it begins with an apostrophe."""
    if not cell.startswith("'"):
        return cell
    return re.sub(r"\\(?:[\\trn]|x3b)", lambda found: _PLAIN[found[0]], cell[1:])


def as_workbook_cell(text: str) -> str:
    """The cell of a text in a workbook, where nothing splits cells: only what would be a formula is escaped."""
    return as_cell(text) if text[:1] in tuple(_FORMULA) else text


def as_cells(texts: Iterable[str]) -> list[str]:
    """``as_cell`` of each."""
    return [as_cell(text) for text in texts]


def decimals_of(values: Array, sd: Array, *, least: int) -> int:
    """Decimals that keep two significant digits of the smallest standard deviation, of which 0 and NaN tell nothing.

    At least ``least``, and no more than the greatest number has in 15 significant digits.
    """
    positive = sd[np.isfinite(sd) & (sd > 0)]
    wanted = int(np.ceil(-np.log10(positive.min()))) + 1 if positive.size else least
    return max(least, min(wanted, decimals_in(values, digits=15)))


def decimals_in(values: Array, *, digits: int) -> int:
    """Decimals that write the greatest of some numbers with so many significant digits."""
    size = np.abs(values[np.isfinite(values)]).max(initial=0.0)
    return digits - 1 - int(np.floor(np.log10(size))) if size > 0 else 0


Key = tuple[int, str, int]
"""Camera (0 where columns are of none), marker and axis of a column."""


def by_title(
    path: Path,
    table: tuple[Sequence[str], Array],
    pattern: re.Pattern[str],
    axes: Sequence[str],
    *,
    expected: str,
    spare: int = 0,
) -> tuple[tuple[str, ...], list[int], Array]:
    """Names, numbers of the C cameras, and (C, T, M, A) values of a table's columns.

    Args:
        path: Of the file, for messages.
        table: Titles, and (T, columns) numbers.
        pattern: Of a title, with the groups ``name``, ``axis`` and, of pixels, ``camera``.
        axes: How each of the A axes is spelt, as the group ``axis`` matches it; other spellings follow a blank.
        expected: What titles look like, for messages.
        spare: So many axes, the last, a marker may lack: NaN.

    Raises:
        FormatError: a title is none, one appears twice, or a marker lacks an axis.
    """
    header, values = table
    axis_of = {word: axis for axis, words in enumerate(axes) for word in words.split(" ")}
    where: dict[Key, int] = {}
    for column, title in enumerate(header):
        match = pattern.fullmatch(title)
        if match is None:
            raise FormatError(f"{path.name}: column {column + 1} is {title!r}; expected {expected}")
        key = (int(match.groupdict().get("camera", 0)), match["name"], axis_of[match["axis"]])
        if key in where:
            raise FormatError(f"{path.name}: marker name {match['name']!r} appears twice (column {title}): rename one")
        where[key] = column
    needed = [words.split(" ")[0] for words in axes[: len(axes) - spare]]
    names, cameras = _grid(where)
    lacking = next((k[:2] for k in _order(names, cameras, len(needed)) if k not in where), None)
    if lacking is not None and "camera" in pattern.groupindex:
        raise FormatError(
            f"{path.name}: marker {lacking[1]!r} has no {' and '.join(word.strip('_') for word in needed)} columns for "
            f"cam{lacking[0]}: {number_of(len(header), 'column does', 'columns do')} not make {len(names)} markers "
            f"x {len(cameras)} cameras x "
            f"{len(needed)}: add them, empty where nothing was seen"
        )
    if lacking is not None:
        columns = [lacking[1] + word for word in needed]
        titles = " and ".join([", ".join(columns[:-1]), columns[-1]])
        raise FormatError(f"{path.name}: marker {lacking[1]!r} needs the columns {titles}")
    return names, cameras, laid_out(values, where, len(axes))


def laid_out(values: Array, where: Mapping[Key, int], axes: int) -> Array:
    """(C, T, M, axes) values of (T, columns), by the place of each; NaN where there is no column."""
    names, cameras = _grid(where)
    columns = np.array([where.get(key, -1) for key in _order(names, cameras, axes)], dtype=int)
    picked = values[:, columns]  # and nothing but that: the table may be large
    picked[:, columns < 0] = np.nan
    return np.moveaxis(picked.reshape(len(values), len(cameras), len(names), axes), 1, 0)


def _grid(where: Mapping[Key, int]) -> tuple[tuple[str, ...], list[int]]:
    return tuple(dict.fromkeys(name for _, name, _ in where)), sorted({camera for camera, _, _ in where})


def _order(names: Sequence[str], cameras: Sequence[int], axes: int) -> list[Key]:
    return [(camera, name, axis) for camera in cameras for name in names for axis in range(axes)]
