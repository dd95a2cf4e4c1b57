"""Sheets of Excel workbooks (.xlsx) as text tables, through openpyxl, an extra: ``pip install eal-mocap[excel]``."""

import csv
import io
import math
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from eal.needs import installing
from mocap.documents import damaged
from mocap.errors import FormatError
from mocap.io.apart import check_bytes

_OLD = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"
"""The signature of .xls."""
_SHEETS = "xl/worksheets/"


def is_workbook(path: Path) -> bool:
    """Whether a file is a workbook of Excel.

    Raises:
        FormatError: it is a spreadsheet of another kind, which is not read.
    """
    try:
        with path.open("rb") as stream:
            start = stream.read(8)
    except OSError:
        return False
    if start == _OLD and path.suffix.lower() == ".xls":
        raise FormatError(f"{path.name}: a workbook of Excel before 2007: save it as .xlsx, or as CSV")
    if not start.startswith(b"PK\3\4"):
        return False
    try:
        with zipfile.ZipFile(path) as pack:
            names = set(pack.namelist())
    except (zipfile.BadZipFile, OSError, ValueError):
        names = set()
    if path.suffix.lower() == ".ods":
        raise FormatError(f"{path.name}: a spreadsheet of LibreOffice: save it as .xlsx, or as CSV")
    if path.suffix.lower() == ".xlsx" and "xl/workbook.xml" not in names:
        raise FormatError(
            f"{path.name}: named .xlsx, but there is no workbook in it: save it again as .xlsx, or as CSV"
        )
    return "xl/workbook.xml" in names


def sheet_text(path: Path, sheet: str | None) -> tuple[str, tuple[str, ...]]:
    """A sheet, named or by its number from 1 (None: the only one that holds something), as the text of a CSV file.

    With sentences on how it was read.

    Raises:
        FormatError: openpyxl is not there, the file is damaged or too large unpacked, or the sheet is not told.
    """
    try:
        import openpyxl
    except ImportError:
        raise FormatError(
            f"{path.name}: workbooks need openpyxl: {installing('excel')}, or save the sheet as CSV"
        ) from None
    with damaged(f"{path.name}: cannot be read as a workbook", "save it again, or as CSV"):
        with zipfile.ZipFile(path) as pack:
            check_bytes(path, sum(entry.file_size for entry in pack.infolist()), "its sheets")
            formulas = any(_holds(pack, n, b"<f") for n in pack.namelist() if n.startswith(_SHEETS))
        book = openpyxl.load_workbook(path, read_only=True, data_only=True, keep_links=False)
        try:
            sheets = {found.title: found for found in book.worksheets}
            name = _chosen(path, sheets, sheet)
            rows = list(_rows(path, sheets[name]))
        finally:
            book.close()
        if formulas:
            _check_computed(path, name, rows)
    while rows and not any(rows[-1]):
        rows.pop()
    width = max((len(row) for row in rows), default=0)
    if not width:
        raise FormatError(
            f"{path.name}: the sheet {name!r} is empty: state another one (there are {', '.join(sheets)})"
        )
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows([*row, *[""] * (width - len(row))] for row in rows)
    return out.getvalue(), ((f"read from the sheet {name!r}",) if len(sheets) > 1 else ())


def _holds(pack: zipfile.ZipFile, name: str, what: bytes) -> bool:
    """Whether a member holds some bytes, which do not begin inside of themselves."""
    with pack.open(name) as stream:
        end = b""
        while block := stream.read(1 << 20):
            if what in end + block:
                return True
            end = block[-len(what) :]
    return False


def _chosen(path: Path, sheets: dict[str, Any], sheet: str | None) -> str:
    names, listed = list(sheets), ", ".join(f"{i} {name!r}" for i, name in enumerate(sheets, start=1))
    if sheet is None:
        names = [name for name in names if any(_rows(path, sheets[name]))]
        if len(names) == 1:
            return names[0]
        raise FormatError(
            f"{path.name}: has {len(names)} sheets with cells; state one with `sheet`, or save it alone: {listed}"
        )
    if sheet in names:
        return sheet
    if sheet.isdecimal() and 1 <= int(sheet) <= len(names):
        return names[int(sheet) - 1]
    raise FormatError(f"{path.name}: no sheet {sheet!r}; there are {listed}: state one with `sheet`")


def _rows(path: Path, sheet: Any) -> Iterator[list[str]]:
    """The rows of a sheet without the empty cells at their ends."""
    sheet.reset_dimensions()  # what the file says of them may be wrong
    n_cells = 0
    for values in sheet.iter_rows(values_only=True):
        n_cells += len(values) + 1
        check_bytes(path, 8 * n_cells, "the cells of a sheet")
        cells = [_text(value) for value in values]
        while cells and not cells[-1]:
            cells.pop()
        yield cells


def _text(value: Any) -> str:
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else "NaN"
    return "" if value is None else str(value).strip()


def _check_computed(path: Path, name: str, rows: list[list[str]]) -> None:
    """Every formula has the value that it had when the workbook was saved."""
    import openpyxl

    book = openpyxl.load_workbook(path, read_only=True, data_only=False, keep_links=False)
    try:
        book[name].reset_dimensions()
        for r, values in enumerate(book[name].iter_rows(values_only=True)):
            for c, value in enumerate(values):
                formula = str(value).startswith("=") or type(value).__name__ in ("ArrayFormula", "DataTableFormula")
                if formula and not (r < len(rows) and c < len(rows[r]) and rows[r][c]):
                    raise FormatError(
                        f"{path.name}: row {r + 1}, column {c + 1} of {name!r}: the formula {str(value)[:40]!r} has no "
                        "value: open the workbook in a spreadsheet, let it compute, and save it"
                    )
    finally:
        book.close()


COLUMNS, ROWS = 16_384, 1_048_576
"""What a sheet of Excel holds."""


def write_sheets(path: Path, sheets: Mapping[str, tuple[Sequence[Any], Iterable[Sequence[Any]]]]) -> None:
    """A workbook of sheets by name, each with titles and rows; numbers that are not finite become empty cells.

    Raises:
        FormatError: openpyxl is not there, or a table is larger than a sheet.
    """
    try:
        import openpyxl
    except ImportError:
        raise FormatError(f"{path.name}: workbooks need openpyxl: {installing('excel')}") from None
    book = openpyxl.Workbook(write_only=True)
    for name, (titles, rows) in sheets.items():
        if len(titles) > COLUMNS:
            raise FormatError(
                f"{path.name}: {len(titles)} columns, but a sheet of Excel has {COLUMNS}: write .csv or .nc"
            )
        sheet = book.create_sheet(name)
        sheet.append(list(titles))
        for number, row in enumerate(rows, start=2):
            if number > ROWS:
                raise FormatError(f"{path.name}: a sheet of Excel has {ROWS} rows: write .csv, .parquet or .nc")
            sheet.append([None if isinstance(cell, float) and not math.isfinite(cell) else cell for cell in row])
    book.save(path)
