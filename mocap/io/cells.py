r"""Text in cells of CSV and TSV files: a spreadsheet must not run it, and a reader must get it back.

A spreadsheet takes a cell that begins with =, +, -, @, a tab or a line's end for a formula, which may run programs.
An apostrophe before it makes it text (OWASP, CSV injection). Here a cell that begins with an apostrophe holds the text
that follows, in which a backslash, and what would begin another cell for some spreadsheet (a tab, a line's end, a
semicolon), are escaped as \\, \t, \r, \n and \x3b. Other text is written as it is.
"""

import re
from collections.abc import Iterable

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
