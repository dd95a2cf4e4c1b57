"""Numbers as other countries and programs spell them, written as all readers take them, where only one can be meant.

``1.234,5`` and ``1,234.5`` are told apart by what follows the thousands, ``1.5D+02`` is what Fortran writes. What may
be either is refused with its line and column: a number that is wrong by a thousand is worse than none.
"""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from mocap.errors import FormatError

_MINUS, _BLANKS = "\u2212", "\u00a0\u202f"
"""The typographic minus of Scandinavian locales, and what French ones put between thousands."""
_ALONE, _END = r'(?<![^\s,;"])', r'(?![^\s,;"])'
"""A number is a whole cell, or stands between blanks."""
_DOUBLE = re.compile(rf"{_ALONE}([+-]?(?:\d+\.\d*|\.\d+))[dD]([+-]\d{{1,3}}){_END}", re.ASCII)
_DOUBLE_SIGNS = (b"D+", b"D-", b"d+", b"d-")
_NO_LETTER = re.compile(rf"{_ALONE}([+-]?\d*\.\d+)([+-]\d{{3}}){_END}", re.ASCII)
"""An exponent of three digits, for which Fortran has no place left for its letter."""
_OF_NUMBERS = re.compile(r'(?m)^(?=.*[,;\t ])[0-9eEdD+.,;\t "-]+$')
"""A line of numbers."""
_FEW = 1000
"""Rows in which whole numbers are looked for beside numbers with three decimals."""


class Undecided(FormatError):
    """A number that may mean two: no other way to lay out the table tells which."""


def is_spelt(blocks: Iterable[bytes], head: str) -> bool:
    """Whether a text in UTF-8, whose first lines are ``head``, has numbers that ``plain_numbers`` spells anew."""
    if any(map(_NO_LETTER.search, _OF_NUMBERS.findall(head))):
        return True
    for block in blocks:
        if any(sign.encode() in block for sign in _MINUS + _BLANKS):
            return True
        if any(sign in block for sign in _DOUBLE_SIGNS) and _DOUBLE.search(block.decode("latin-1")):
            return True
    return False


def plain_numbers(text: str) -> tuple[str, tuple[str, ...]]:
    """A text with the minus sign of ASCII, no narrow or hard blanks between thousands, ``e`` before all exponents."""
    notes = ()
    if _MINUS in text:
        text = re.sub(rf"{_MINUS}(?=[\d.,])", "-", text)
        notes = (f"numbers have the sign {_MINUS} (U+2212): read as a minus",)
    if any(blank in text for blank in _BLANKS):
        text, count = re.subn(rf"(?<=\d)[{_BLANKS}](?=\d{{3}}(?!\d))", "", text)
        notes += ("numbers have blanks between thousands: left out",) if count else ()
    for spelt in (_DOUBLE, _NO_LETTER):
        if (found := spelt.search(text)) is None:
            continue
        if spelt is _DOUBLE:
            text, count = spelt.subn(r"\1e\2", text)
        else:
            before = text
            text = _OF_NUMBERS.sub(lambda line: _NO_LETTER.sub(r"\1e\2", line[0]), text)
            count = text != before
        if count:
            notes += (f"exponents are those of Fortran: {found[0]} is read as {found[1]}e{found[2]}",)
    return text, notes


def without_thousands(path: Path, text: str, separator: str) -> tuple[str, tuple[str, ...]]:
    """A table with semicolons or tabs between its cells without what stands between thousands, and a sentence on it.

    A mark between thousands is one where the other mark follows it (``1.234,5``), or itself (``1.234.567``), in a cell
    of the same column; where both may be meant nothing is.

    Raises:
        Undecided: a cell has such a mark elsewhere, or its column does not say what it means; with line and title.
    """
    rows = text.split("\n")
    top = next((i for i, row in enumerate(rows) if separator in row and _OF_NUMBERS.fullmatch(row)), len(rows))
    start = sum(len(row) + 1 for row in rows[:top])
    mark = next((one for one in ".," if _proof(one).search(text, start)), None)
    if mark is None:
        _check_whole(path, rows, top, separator)
        return text, ()
    number, proof, proven, seen = _grouped(mark), _proof(mark), set[int](), dict[int, tuple[int, str]]()
    example = ""
    for i in range(top, len(rows)):
        cells = rows[i].split(separator)
        for c, cell in enumerate(cells):
            if mark not in cell:
                continue
            bare = cell.strip(' "')
            if not number.fullmatch(bare):
                raise _either(path, rows, top, separator, (i, c), bare)
            seen.setdefault(c, (i, bare))
            if proof.search(bare):
                proven.add(c)
                example = example or bare
            cells[c] = cell.replace(mark, "")
        rows[i] = separator.join(cells)
    for c, (i, bare) in seen.items():
        if c not in proven:
            raise _either(path, rows, top, separator, (i, c), bare)
    what = {".": "points", ",": "commas"}[mark]
    return "\n".join(rows), (f"numbers have {what} between thousands: {example} is read as {_read_as(example, mark)}",)


def _read_as(cell: str, mark: str) -> str:
    return cell.replace(mark, "").replace(",", ".")


def _proof(mark: str) -> re.Pattern[str]:
    """Of a number that can have this mark between thousands alone; OpenSim's vectors, ``1.234,5.6,7.8``, are none."""
    other = "," if mark == "." else "."
    return re.compile(
        rf"(?<![\d.,])[1-9]\d{{0,2}}(?:\{mark}\d{{3}})+(?:(?<=\{mark}\d{{3}}\{mark}\d{{3}})|\{other}\d+)(?![\d.,])",
        re.ASCII,
    )


def _grouped(mark: str) -> re.Pattern[str]:
    """Of a number with this mark between its thousands."""
    other = "," if mark == "." else "."
    return re.compile(rf"[+-]?[1-9]\d{{0,2}}(?:\{mark}\d{{3}})+(?:\{other}\d*)?", re.ASCII)


def _check_whole(path: Path, rows: Sequence[str], top: int, separator: str) -> None:
    """Refuse a column of 1.200, 1.230 and 999: with decimals 999 were 999.000, without trailing zeros 1.200 were 1.2.

    Raises:
        Undecided: there is one.
    """
    kept = [row.split(separator) for row in rows[top : top + _FEW] if row.strip()]
    for c, column in enumerate(zip(*kept, strict=False)):
        cells = [cell.strip(' "') for cell in column]
        pointed = [cell for cell in cells if "." in cell]
        whole = {cell.lstrip("+-") for cell in cells if re.fullmatch(r"[+-]?[1-9]\d{0,2}", cell, re.ASCII)}
        if (
            len(whole) > 1
            and all(re.fullmatch(r"[+-]?[1-9]\d{0,2}\.\d{3}", cell, re.ASCII) for cell in pointed)
            and any(cell.endswith("0") for cell in pointed)
        ):
            i = next(i for i, cell in enumerate(cells) if "." in cell)
            raise _either(path, rows, top, separator, (top + i, c), pointed[0])


def _either(path: Path, rows: Sequence[str], top: int, separator: str, where: tuple[int, int], cell: str) -> Undecided:
    line, column = where
    titles = rows[top - 1].split(separator) if top else []
    title = titles[column].strip(' "') if column < len(titles) else ""
    return Undecided(
        f"{path.name}: line {line + 1}, {title or f'column {column + 1}'}: {cell!r:.40}: its point or comma may stand "
        "between thousands or before decimals, and the other numbers do not say which: export the table with decimal "
        "points and nothing between thousands"
    )
