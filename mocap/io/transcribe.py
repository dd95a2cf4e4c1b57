"""Text tables as people have them, written as readers take them: UTF-8, commas between cells, decimal points.

Spreadsheets of countries that write 0,5 separate cells by semicolons; Excel writes Windows-1252, UTF-16 with tabs, or a
workbook. Such a file is copied in that one form to a temporary folder, under its own name and line by line, so that
every format and every message stays as it is. A file that needs nothing of this is read where it is.
"""

import csv
import io
import json
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import takewhile
from pathlib import Path
from tempfile import TemporaryDirectory

from mocap.documents import check_regular, decoded, is_utf8, is_utf16
from mocap.errors import FormatError
from mocap.io.format import LENGTH, Head
from mocap.io.lines import FRAMES, MISSING_WORDS, cells_of, check_cells, one_kind
from mocap.io.number_spelling import Undecided, is_spelt, plain_numbers, without_thousands
from mocap.io.title_rows import laid_out
from mocap.io.workbook import is_workbook, sheet_text

_EXPONENT = r"(?:[eE][+-]?\d+)?"
_WITH_COMMA = rf"([+-]?(?:\d+:)*\d*),(\d+{_EXPONENT})"
_WITH_POINT = rf"[+-]?(?=[\d.,]*\d)[\d,]*\.[\d.,]*{_EXPONENT}"
_MISSING = "|".join(map(re.escape, MISSING_WORDS))
_NUMBER = re.compile(rf'\s*"?\s*([+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?|{_MISSING})\s*"?\s*', re.ASCII)
_COUNTED = re.compile(rf"{FRAMES}|t|t_s|time|time_s|seconds|(camera|cam|view)[ _.#-]*\d*", re.IGNORECASE)
"""Titles of a first column that has a number in every row: frames, times, numbers of cameras, coefficients of one."""

_QUOTED = re.compile(r'(?m)(^|,)"([^",\n]*)"(?=,|$)')
_WITH_COMMAS = re.compile(r'(?m)(^|,)"\s*([+-]?[\d.]*,[\d.,]*\d(?:[eE][+-]?\d+)?)\s*"(?=,|$)', re.ASCII)
_SEP = re.compile(r'"?sep=."?[;,\t ]*\n', re.IGNORECASE)
"""What a spreadsheet takes for its separator, before the titles."""
_ROW = re.compile(r'("[^"]*"|[^",]*)(,("[^"]*"|[^",]*))+')
_OF_NUMBERS = b"0123456789+-,eENaA \n"

Knows = Callable[[Head], bool]


@contextmanager
def transcribed(
    path: Path, *, knows: Knows, named: Knows = lambda _: False, sheet: str | None = None, anew: bool = False
) -> Iterator[tuple[Path, tuple[str, ...]]]:
    """The file to read in place of another, while the context lasts, and sentences on how it was read.

    Args:
        path: What the user named.
        knows: Whether a format knows a text whose cells are separated by tabs; else it is a table of commas to be.
        named: Whether a format knows a text by its titles: then a column of row numbers before them is left out.
        sheet: Of a workbook with several, the one to read: its name, or its number from 1.
        anew: Whether a table is laid out anew (``mocap.io.title_rows``); where none is, the file itself is given.

    Raises:
        FormatError: it is no regular file, no text, has decimal commas and points, or a sheet is not told or not there.
    """
    check_regular(path)
    with suppress(OSError):  # the reader says it
        check_cells(path)
    if is_workbook(path):
        text, notes = _without_row_numbers(path, *sheet_text(path, sheet), named)
    elif sheet is not None:
        raise FormatError(f"{path.name}: is not a workbook (.xlsx), but the sheet {sheet!r} was stated: leave it out")
    else:
        text, notes = _decoded(path) if anew else _one_form(path, knows, named)
    if anew and text is not None:
        text, spelt = plain_numbers(text)
        text, more = laid_out(text) or (None, ())
        notes = (*notes, *spelt, *more)
    if text is None:
        yield path, notes
        return
    with TemporaryDirectory(prefix="mocap-") as folder:
        copy = Path(folder) / path.name
        copy.write_bytes(text.encode("utf-8"))
        yield copy, notes


def _decoded(path: Path) -> tuple[str | None, tuple[str, ...]]:
    """The text of a file, with line ends of Unix, and sentences on that; None where it is not text."""
    try:
        data = path.read_bytes()
    except OSError:
        return None, ()
    if b"\0" in data[:LENGTH] and not is_utf16(data):
        return None, ()
    text, notes = decoded(path, data)
    text = one_kind(text)
    if _is_json(text):
        return None, ()
    return text, notes if text.endswith(("\n", "\x1a", "\f")) else (*notes, _whole_end(path, text))


_ROW_NUMBERS = re.compile(r'"?(|\d+|X|V1|Unnamed: ?\d*|row[ _.]?(names?|numbers?)?)"?', re.IGNORECASE)
"""What R, pandas and spreadsheets write over the numbers of rows."""


def _without_row_numbers(path: Path, text: str, notes: tuple[str, ...], named: Knows) -> tuple[str, tuple[str, ...]]:
    """A text without a first column that numbers its rows, where its titles are a format's without that column."""
    first, *lines = text.rstrip("\n").split("\n")
    title, _, titles = first.partition(",")
    if not _ROW_NUMBERS.fullmatch(title.strip()) or not titles or named(Head(path, text[:LENGTH].encode())):
        return text, notes
    column, _, rest = zip(*(line.partition(",") for line in lines), strict=True) if lines else ((), (), ())
    counts = [cell.strip('" ') for cell in column]
    start = int(counts[0]) if counts and counts[0] in ("0", "1") else -1
    if start < 0 or counts != [str(k) for k in range(start, start + len(counts))]:
        return text, notes
    bare = "\n".join([titles, *rest, ""])
    if not named(Head(path, bare[:LENGTH].encode())):
        return text, notes
    return bare, (*notes, f"the first column, {title.strip()!r}, numbers the rows from {start}, and was left out")


def _one_form(path: Path, knows: Knows, named: Knows) -> tuple[str | None, tuple[str, ...]]:
    """The text of a file in the one form, and sentences on that; None where it has it already, or is not text."""
    try:
        with path.open("rb") as stream:
            start = stream.read(LENGTH)
            if not start.strip() or (b"\0" in start and not is_utf16(start)):
                return None, ()
            numbered = _ROW_NUMBERS.fullmatch(start.split(b",", 1)[0].decode("latin-1").lstrip("\xef\xbb\xbf").strip())
            if (
                not numbered
                and not is_utf16(start)
                and is_utf8(_blocks(stream))
                and not is_spelt(_blocks(stream), start.decode("latin-1"))
                and _is_plain(stream, Head(path, start), knows)
            ):
                return None, ()
            stream.seek(0)
            data = stream.read()
    except OSError:
        return None, ()  # the reader says it
    text, notes = decoded(path, data)
    text = one_kind(text)
    if _is_json(text):
        return text, notes
    if hint := _SEP.match(text):
        text = text[hint.end() :]
        notes = (*notes, f"the first line, {hint[0].strip()!r}, was left out, and is not counted")
    text, spelt = plain_numbers(text)
    notes = (*notes, *spelt)
    head = Head(path, text[:LENGTH].encode())
    separator = _separator(head.lines)
    if separator == ";":
        text, separators = _semicolons(path, text)
    elif separator == "\t":
        text, separators = _tabs(path, text, knows)
    else:
        separators = ()
    if _all_quoted(head.lines):
        text, quoted = _quoted_commas(text)
        separators = (*separators, *quoted)
        text = _QUOTED.sub(r"\1\2", text)
    text, left = _trimmed(text)
    if not text.endswith("\n"):
        left = (*left, _whole_end(path, text))
        text += "\n"
    return _without_row_numbers(path, text, (*notes, *separators, *left), named)


def _is_json(text: str) -> bool:
    """Whether a text is JSON from its first to its last sign: then it is whole, with a last line end or without."""
    if text.lstrip("\ufeff \t\n")[:1] not in ("{", "["):
        return False
    try:
        json.loads(text.lstrip("\ufeff"))
    except ValueError:
        return False
    return True


def _all_quoted(lines: Sequence[str]) -> bool:
    """Whether lines are rows of cells with commas, of which some are quoted: no JSON, no settings."""
    rows = [line for line in lines if line.strip()]
    return any('"' in row for row in rows) and all(map(_ROW.fullmatch, rows))


def _quoted_commas(text: str) -> tuple[str, tuple[str, ...]]:
    """Numbers in quotes without the commas between their thousands, where a decimal point says that they are that.

    Decimal commas in quotes are read where tables are laid out anew (``title_rows``); 1,234 alone may be either.
    """
    cells = [match[2] for match in _WITH_COMMAS.finditer(text)]
    if not any("." in cell for cell in cells):
        return text, ()
    points = re.search(r'"[+-]?\d*\.\d+"', text, re.ASCII)  # "1.234" beside "1.234,5" is not decided
    if not points and all(re.fullmatch(r"[+-]?([1-9]\d{0,2}(\.\d{3})+|\d{1,3}),\d+", cell) for cell in cells):
        example = next(cell for cell in cells if "." in cell)
        text = _WITH_COMMAS.sub(lambda match: f'{match[1]}"{match[2].replace(".", "").replace(",", ".")}"', text)
        read_as = example.replace(".", "").replace(",", ".")
        return text, (f"numbers in quotes have points between thousands: {example} is read as {read_as}",)
    if not all(re.fullmatch(r"[+-]?\d{1,3}(,\d{3})+(\.\d+)?", cell) for cell in cells):
        return text, ()
    text = _WITH_COMMAS.sub(lambda match: match[1] + match[2].replace(",", ""), text)
    return text, (
        f"numbers in quotes have commas between thousands: {cells[0]} is read as {cells[0].replace(',', '')}",
    )


def _whole_end(path: Path, text: str) -> str:
    """What is to be said of a last line without its end.

    Raises:
        FormatError: it has fewer cells than those above, or its last number fewer decimals, of which all above have as
            many: it was cut.
    """
    *above, last = text[-(2**18) :].split("\n")
    mark = max(",\t; ", key=last.count)
    rows = takewhile(lambda row: row.count(mark) == last.count(mark), reversed(above[-50:]))
    column = [cell for row in rows if _NUMBER.fullmatch(cell := row.rpartition(mark)[2].strip())]
    cell = last.rpartition(mark)[2].strip()
    decimals = {len(other.partition(".")[2]) for other in column if other.strip("nNaA")}
    short = len(decimals) == 1 and cell.strip("nNaA") and len(cell.partition(".")[2]) < min(decimals)
    fewest = min((row.count(mark) for row in above[-5:]), default=0)
    if last.count(mark) < fewest and _NUMBER.fullmatch(last.split(mark)[0]):
        raise FormatError(
            f"{path.name}: the last line has {last.count(mark) + 1} cells and no line end, those before at least "
            f"{fewest + 1}: it seems to be cut; export the file again"
        )
    if mark in last and len(column) > 1 and (short or (not cell and all(column))):
        raise FormatError(f"{path.name}: the last cell {cell!r} seems to be cut; export the file again")
    return "the last line has no line end: if the file was cut there, its last number is wrong"


def _blocks(stream: io.BufferedReader) -> Iterator[bytes]:
    stream.seek(0)
    while block := stream.read(2**24):
        yield block


def _is_plain(stream: io.BufferedReader, head: Head, knows: Knows) -> bool:
    """Whether a text in UTF-8 is as readers take it."""
    separator = _separator(head.lines)
    if separator == "\t" and not (knows(head) and not any(b"," in block for block in _blocks(stream))):
        return False
    stream.seek(max(0, stream.seek(0, 2) - LENGTH))
    ending = stream.read()
    if ending[-1:] not in (b"\n", b"\r") or _all_quoted(head.lines) or _SEP.match(f"{head.first}\n"):
        return False
    ending = ending.rstrip(b"\r\n")
    last = ending[max(ending.rfind(b"\n"), ending.rfind(b"\r")) + 1 :]
    if separator == "\t":
        return True
    return separator == "," and not head.first.rstrip().endswith(",") and not _empty(last.decode("utf-8", "replace"))


def _separator(lines: Sequence[str]) -> str:
    """What separates the cells of the latter half of some lines: a semicolon, a tab, or else a comma.

    It is in all of them, and what commas they have are decimal ones: they stand in cells that are numbers.
    """
    rows = [line for line in lines if line.strip(" \t,;")]
    rows = rows[len(rows) // 2 :]
    for separator, other in ((";", "\t"), ("\t", ";")):
        if rows and all(separator in row and other not in row for row in rows):
            cells = [cell for row in rows for cell in row.split(separator) if "," in cell]
            if all(map(_may_hold_comma, cells)) and (separator in lines[0] or "," not in lines[0]):
                return separator
    return ","


def _may_hold_comma(cell: str) -> bool:
    """Whether a cell is a number, if perhaps a wrong one, or a text in quotes."""
    cell = cell.strip()
    return not cell.strip("0123456789+-.,eE:") or (len(cell) > 1 and cell[0] == cell[-1] == '"')


def _cell(pattern: str, separator: str) -> re.Pattern[str]:
    return re.compile(rf'(?m)(^|{separator})([ "]*){pattern}(?=[ "]*(?:{separator}|$))', re.ASCII)


def _semicolons(path: Path, text: str) -> tuple[str, tuple[str, ...]]:
    """A text with semicolons between its cells as one with commas and decimal points."""
    note = "cells are separated by semicolons"
    text, notes = without_thousands(path, text, ";")
    if found := _decimal_comma(text, ";"):
        if point := _with_point(text, ";"):
            line = text.count("\n", 0, point.end()) + 1
            raise Undecided(
                f"{path.name}: line {line}: {point[0].strip(chr(34) + '; ')!r} has a decimal point (or one between "
                f"thousands) where others have decimal commas ({found[3]},{found[4]}): export it with one of them"
            )
        note += f" and numbers have decimal commas: {found[3]},{found[4]} is read as {found[3]}.{found[4]}"
        text = _with_points(text, ";")
    if '"' in text or "," in text:
        return _with_commas(path, text, ";"), (note, *notes)
    return text.replace(";", ","), (note, *notes)


def _tabs(path: Path, text: str, knows: Knows) -> tuple[str, tuple[str, ...]]:
    """A text with tabs between its cells as one with decimal points; with commas in place of tabs that none knows."""
    text, thousands = without_thousands(path, text, "\t")
    notes = [*thousands]
    found = _decimal_comma(text, "\t")
    if found and not _with_point(text, "\t"):
        notes = [*notes, f"numbers have decimal commas: {found[3]},{found[4]} is read as {found[3]}.{found[4]}"]
        text = _with_points(text, "\t")
    table = not knows(Head(path, text[:LENGTH].encode()))
    if table and len({line.count("\t") for line in text.split("\n") if line}) == 1:
        notes = ["cells are separated by tabs", *notes]
        text = text.replace("\t", ",") if '"' not in text and "," not in text else _with_commas(path, text, "\t")
    return text, tuple(notes)


def _decimal_comma(text: str, separator: str) -> re.Match[str] | None:
    return _cell(_WITH_COMMA, separator).search(text) if "," in text else None


def _with_point(text: str, separator: str) -> re.Match[str] | None:
    """A number with a decimal point, from the first line of numbers on: titles above may state a rate or a clock so."""
    row = re.compile(rf"(?m)^(?=.*{separator})[0-9eE+.,{separator} \"-]+$")
    first = row.search(text) if "." in text else None
    return _cell(_WITH_POINT, separator).search(text, first.start()) if first else None


def _with_points(text: str, separator: str) -> str:
    """A text with decimal points in place of commas, where a cell is a number."""
    comma, top = _cell(_WITH_COMMA, separator), 0
    for _ in range(8):  # lines of titles; below are numbers only, which is quicker to see of all than of each
        body = text[top:].encode()
        if not body.translate(None, _OF_NUMBERS + separator.encode()):
            return comma.sub(r"\1\2\3.\4", text[:top]) + text[top:].replace(",", ".")
        top = text.find("\n", top) + 1
        if not top:
            break
    return comma.sub(r"\1\2\3.\4", text)


def _with_commas(path: Path, text: str, separator: str) -> str:
    """Lines of cells with another separator as lines of cells with commas; cells that hold commas are quoted."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    *lines, rest = text.split("\n")
    for number, line in enumerate([*lines, rest] if rest else lines, start=1):
        writer.writerow(next(cells_of(path, [line], separator=separator, first_line=number), []))
    return out.getvalue() if not rest else out.getvalue().removesuffix("\n")


def _empty(line: str) -> bool:
    return "," in line and not line.strip(", \t")


def _trimmed(text: str) -> tuple[str, tuple[str, ...]]:
    """A text without the empty columns that end each line, and a sentence on empty rows at its end.

    Rows of commas only are frames in which nothing was seen, unless the first column counts: a table without titles
    (as coefficients), or one with a frame or a time in each row.
    """
    lines = text.split("\n")
    first = lines[0].split(",")
    filled = [line for line in lines if line.strip() and not _empty(line)]
    surplus = min((_surplus(line) for line in filled), default=0) if _surplus(lines[0]) else 0
    if surplus:
        lines = [",".join(line.split(",")[:-surplus]) if "," in line else line for line in lines]
    end = next((i for i in range(len(lines), 0, -1) if lines[i - 1].strip()), 0)
    last = next((i for i in range(end, 0, -1) if lines[i - 1].strip(", \t")), 0)
    if last == end:
        return "\n".join(lines), ()
    what = f"the last {end - last} lines contain nothing but separators".replace(" 1 lines contain", " line contains")
    if _COUNTED.fullmatch(first[0].strip(' "')) or all(_NUMBER.fullmatch(cell) for cell in first):
        return "\n".join([*lines[:last], *lines[end:]]), (f"{what}: left out",)
    return "\n".join(lines), (f"{what}: read as frames in which nothing was seen",)


def _surplus(line: str) -> int:
    return line[len(line.rstrip(", \t")) :].count(",")
