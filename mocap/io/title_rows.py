"""Tables as a person or a script laid them out, as readers take them: one row of titles over rows of numbers.

Notes, blank lines and comments go; names over x, y, z and units under titles become one title of each column; clock
times become seconds. Only a table that no reader takes as it stands is laid out anew: others stay as they are.
"""

import csv
import io
import re
from collections.abc import Mapping, Sequence
from datetime import date
from decimal import Decimal

from mocap.io.lines import MISSING_WORDS, time_unit_s, unit_of
from mocap.text import number_of

Cells = list[str]
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?", re.ASCII)
_COMMENT = re.compile(r"\s*(#+|%+|//+|!+)(?![A-Z/0!?]*[,;|\t])\s*(?P<text>.*)")
"""A line that Python, R, MATLAB, C or Fortran would leave out; its mark does not begin a cell such as ``#N/A``."""
_AXIS = re.compile(r"(?P<axis>[xyz])\d*(?P<unit>\s*[\[(].*[\])])?", re.IGNORECASE)
_COORDINATE = re.compile(r".*[xyz]|[xyz][ _.:-].+", re.IGNORECASE)
_PIXELS = ("px", "pixel", "pixels")
_NO_UNIT = re.compile(r"frames?|n|#|nr|no|counts?|1|-|", re.IGNORECASE)
"""What stands in a row of units over columns that have none."""
_CLOCK = re.compile(r"(?:(\d{4}-\d\d-\d\d)[T ])?(?:(\d{1,3}):)?(\d{1,2}):(\d{1,2}(?:[.,]\d+)?)Z?", re.ASCII)
_KEY = re.compile(r"[A-Z]+(_[A-Z]+)+")
"""Two lines that begin so, as ``NO_OF_MARKERS`` and ``MARKER_NAMES``, are a program's head that is not whole."""
_UNIT_NOTE = re.compile(r"(?:length )?units?[\s:=,;]+[\"'\[(]*([a-z]+)", re.IGNORECASE)
_SEPARATORS = (";", "\t", "|", ",", " ")
"""Semicolons first: cells between them may hold decimal commas. A blank stands for any number of them."""
_DAY_S = 86_400  # seconds
_SHOWN = 3
"""Lines that a sentence quotes."""


def laid_out(text: str) -> tuple[str, tuple[str, ...]] | None:
    """A table with one row of titles (or none) over rows of numbers, commas between cells, and what was done to it.

    None where a text (with line ends of Unix) is no table of numbers to its end, or leaves open what belongs to what.
    """
    lines = text.replace("\xa0", " ").rstrip("\n\x1a\f ").split("\n")
    if max(map(len, lines)) > csv.field_size_limit():
        return None  # the reader says which cell is too long
    comments = {i: found["text"].strip() for i, line in enumerate(lines) if (found := _COMMENT.fullmatch(line))}
    kept = [i for i, line in enumerate(lines) if i not in comments and line.strip(" \f")]
    separator = _separator([lines[i] for i in kept[-50:]])  # rows at the end tell the separator
    if separator is None:
        return None
    cells = [_cells(lines[i], separator) for i in kept]
    start = 1 + max((k for k, row in enumerate(cells[:100]) if not _is_row(row)), default=-1)
    rows, above = cells[start:], {i: row for i, row in zip(kept[:start], cells, strict=False) if any(row)}
    width = len(rows[0]) if rows else 0
    numbers_above = any(len(row) > 1 and any(row) and all(map(_is_value, row)) for row in above.values())
    if len(rows) < 2 or any(len(row) != width for row in rows) or numbers_above:
        return None
    if sum(_KEY.fullmatch(row[0]) is not None for row in above.values()) > 1:
        return None
    titles, used = _titles(above, width)
    if not titles and (last := max((i for i in comments if i < kept[start]), default=-1)) >= 0:
        words = _cells(comments[last], separator)
        titles, used = (words, {last}) if len(words) == width and not _is_row(words) else ([], set())
    if any(i > kept[start] and len(_cells(words, separator)) == width for i, words in comments.items()):
        return None  # somebody took a row out by a mark before it
    notes = [i for i in sorted((*above, *comments)) if i not in used]
    unit = next((found[1] for i in notes if (found := _UNIT_NOTE.match(comments.get(i, lines[i])))), "")
    shown = "; ".join(f"{i + 1}: {lines[i].strip(' ,;|')[:60]!r}" for i in notes[:_SHOWN])
    more = ", ..." if len(notes) > _SHOWN else ""
    left_out = f"{number_of(len(notes), 'line')} beside titles and numbers left out, and not counted ({shown}{more})"
    changes = [left_out] if notes else []
    blank = kept[-1] - kept[start] + 1 - len(rows) - sum(kept[start] < i < kept[-1] for i in comments)
    if blank:
        changes.append(f"{number_of(blank, 'blank line')} among the rows left out, though it may have been a frame")
    table = []
    for title, column in zip(titles or [""] * width, zip(*rows, strict=True), strict=True):
        if titles and not title and not any(column):
            continue  # separators at the end of each line, or a column to keep others apart
        try:
            made, note = _numbers(title, column, quoted=separator == ",")
        except ValueError:
            return None
        if note.startswith("clock") and "(" not in title:
            title = f"{title} (s)"
        elif unit_of(unit) and "(" not in title and _COORDINATE.fullmatch(title):
            title = f"{title} ({unit_of(unit)})"
        changes += [note] if note else []
        table.append([title, *made])
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows(list(zip(*table, strict=True))[0 if titles else 1 :])
    return out.getvalue(), tuple(dict.fromkeys(changes))


def _cells(line: str, separator: str) -> Cells:
    if separator == " ":
        return line.split()
    cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True)) if '"' in line else None
    return [cell.strip() for cell in cells or line.split(separator)]


def _is_value(cell: str) -> bool:
    return cell in MISSING_WORDS or _NUMBER.fullmatch(cell) is not None or _CLOCK.fullmatch(cell) is not None


def _is_row(cells: Cells) -> bool:
    """Whether most cells that are not empty are values: a column of words may stand among them."""
    filled = [cell for cell in cells if cell]
    return len(cells) > 1 and 2 * sum(map(_is_value, filled)) >= len(filled) + 1 - (not filled)


def _separator(rows: Sequence[str]) -> str | None:
    """What splits rows into as many cells each, of which most are values."""
    for separator in _SEPARATORS:
        cells = [_cells(row, separator) for row in rows[len(rows) // 2 :]]
        if len({len(row) for row in cells}) == 1 and all(map(_is_row, cells)):
            return separator
    return None


def _titles(above: Mapping[int, Cells], width: int) -> tuple[Cells, set[int]]:
    """The title of each column, with its unit, and the lines that these are from; none where no line is of titles."""
    lines = [(i, [*row, *[""] * width][:width]) for i, row in above.items() if not any(row[width:])]
    used, units = set[int](), [""] * width
    titles = lines.pop() if lines else (-1, [])
    if lines and _are_units(titles[1]):
        used, units, titles = {titles[0]}, titles[1], lines.pop()
    elif lines and _are_units(lines[-1][1]):
        used, units = {lines[-1][0]}, lines.pop()[1]
    used.add(titles[0])
    found = titles[1]
    for i, row in reversed(lines):  # Visual3D writes what its columns are between names and axes
        if named := _named(row, found):
            used.add(i)
            found = named
            break
    if sum(map(bool, found)) < 2:
        return [], set()
    bare = [unit.strip("[]() ") for unit in units]
    return [
        f"{title} ({unit_of(unit) or unit})" if _is_unit(unit) else title
        for title, unit in zip(found, bare, strict=True)
    ], used


def _is_unit(word: str) -> bool:
    return unit_of(word) is not None or time_unit_s(word) is not None


def _are_units(row: Cells) -> bool:
    """Whether a line is one of units, and of what stands over columns that have none."""
    words = [cell.strip("[]() ") for cell in row]
    units = [_is_unit(word) or word.lower() in _PIXELS for word in words]
    return any(units) and all(unit or _NO_UNIT.fullmatch(word) for unit, word in zip(units, words, strict=True))


def _named(names: Cells, axes: Cells) -> Cells | None:
    """Titles ``<name>_<axis>`` of names over x, y, z; None where a line is not of axes, or one has not one name.

    A name stands over one of its columns, or over each.
    """
    letters = [_AXIS.fullmatch(cell) for cell in axes]
    if 2 * sum(map(bool, letters)) <= sum(map(bool, axes)) or sum(map(bool, letters)) < 2:
        return None
    titles, group, taken = list(axes), list[int](), set[str]()
    for c, letter in enumerate([*letters, None]):
        if group and (letter is None or letter["axis"] in [axes[k][0] for k in group]):
            over = {names[k] for k in group} - {""}
            if len(over) != 1 or over & taken:
                return None
            taken |= over
            for k in group:
                found = letters[k]
                titles[k] = f"{names[k] or next(iter(over))}_{axes[k][0]}{found['unit'] or '' if found else ''}"
            group = []
        if letter is not None:
            group.append(c)
        elif c < len(axes):
            titles[c] = axes[c] or names[c]
    return titles


def _numbers(title: str, column: Sequence[str], *, quoted: bool) -> tuple[Cells, str]:
    """A column as numbers with decimal points, clock times as seconds, words as empty cells; and what was done.

    Where commas separate cells 1,234 in quotes (``quoted``) may be a thousand.

    Raises:
        ValueError: it holds both words and numbers, decimal commas and points, or commas that may be of thousands.
    """
    entries = [cell for cell in column if cell not in MISSING_WORDS]
    if entries and all(map(_CLOCK.fullmatch, entries)):
        # clock times as seconds from the midnight before the first; a clock without a date goes on after midnight
        found, day, last = [], 0, Decimal(0)
        dates = [date.fromisoformat(match[1]) for cell in column if (match := _CLOCK.fullmatch(cell)) and match[1]]
        for cell in column:
            if (match := _CLOCK.fullmatch(cell)) is None:
                found.append("")
                continue
            time = 3600 * int(match[2] or 0) + 60 * int(match[3]) + Decimal(match[4].replace(",", "."))
            if match[1]:
                day = (date.fromisoformat(match[1]) - dates[0]).days
            elif last - time > _DAY_S // 2:
                day += 1
            last = time
            found.append(str(_DAY_S * day + time))
        return found, f"clock times of the column {title!r} were read as seconds, {entries[0]} as the first"
    numbers = sum(_NUMBER.fullmatch(cell) is not None for cell in entries)
    if entries and not numbers and not re.search(r"\d:\d", entries[0]):  # no clock of another kind
        return [""] * len(column), f"the column {title!r} holds words ({entries[0][:20]!r}, ...) and was left out"
    commas = [cell for cell in entries if "," in cell]
    if numbers < len(entries) or (commas and any("." in cell for cell in entries)):
        raise ValueError(title)
    if quoted and commas and all(re.fullmatch(r"[+-]?\d{1,3},\d{3}", cell) for cell in commas):
        raise ValueError(title)
    note = f"numbers have decimal commas: {commas[0]} is read as {commas[0].replace(',', '.')}" if commas else ""
    return [cell.replace(",", ".") for cell in column], note
