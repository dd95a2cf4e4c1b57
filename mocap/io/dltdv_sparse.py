"""Sparse TSV files of DLTdv 7 and 8 and of Argus: sizes, then a row, a column and a value for each sample."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from eal.arrays import Array
from mocap.errors import FormatError
from mocap.io.apart import check_bytes
from mocap.io.contents import FileContents, pixel_recording, point_recording, table_recording
from mocap.io.format import Format, Head, Hints, head
from mocap.io.lines import numbers, read_lines
from mocap.text import number_of

POINT_NAMES = "PointNames_to_go_with_DLTdv8a_sparsesave_arrays"
_TITLES = {
    "camera coordinates": "xypts",
    "3d coordinates": "xyzpts",
    "smoothed 3d data": "xyzpts",
    "residuals": "xyzres",
    "confidence": "xyzci",
    "offsets": "offsets",
}
"""What the titles of DLTdv's files say; Argus tells by the file's name alone."""
_ARGUS = "Row\tColumn\tEntry"


def read_sparse(path: Path) -> Array:
    """The dense (rows, columns) table; NaN where no value is, as DLTdv and Argus mean it.

    Raises:
        FormatError: sizes and rows contradict each other, or a cell is no number.
    """
    lines = read_lines(path)
    body = [line for line in lines[1:] if line.strip()]
    if not body:
        raise FormatError(
            f"{path.name}: line 2 lacks the size of the table; expected rows, columns, count: export it again"
        )
    sizes = numbers(path, body[:1], separator="\t", columns=3, first_line=2)[0]
    if not (np.isfinite(sizes).all() and (sizes == np.round(sizes)).all() and (sizes >= 0).all()):
        raise FormatError(f"{path.name}: line 2 should hold rows, columns and count, but is {body[0]!r}")
    rows, columns, count = (int(size) for size in sizes)
    if rows == 0 or columns == 0:
        raise FormatError(
            f"{path.name}: line 2 says {rows} rows x {columns} columns: there is no table; export it again"
        )
    check_bytes(path, 8 * rows * columns, f"the table of {rows} rows x {columns} columns that line 2 states")
    if count != len(body) - 1:
        raise FormatError(f"{path.name}: {len(body) - 1} values, but line 2 says {count}: copy or export it again")
    dense = np.full((rows, columns), np.nan)
    if count:
        table = numbers(path, body[1:], separator="\t", columns=3, first_line=3)
        index = table[:, :2]
        with np.errstate(invalid="ignore"):
            wrong = ~((index == np.round(index)) & (index >= 1) & (index <= (rows, columns))).all(axis=1)
        if wrong.any():
            raise FormatError(
                f"{path.name}: line {int(np.argmax(wrong)) + 3}: row and column {index[np.argmax(wrong)]} are not in "
                f"the table of {rows} x {columns}: export it again"
            )
        row, column = index.astype(np.int64).T - 1
        if len(np.unique(row * columns + column)) != count:
            raise FormatError(f"{path.name}: a cell appears twice: export it again")
        dense[row, column] = np.where(table[:, 2] == 0, np.nan, table[:, 2])
    return dense


def _kind(head: Head) -> str | None:
    title = head.first.lower()
    if title.startswith("sparse format"):
        return next((kind for words, kind in _TITLES.items() if words in title), None)
    if head.first.strip() == _ARGUS:
        return next((kind for kind in ("xypts", "xyzpts", "xyzres", "offsets") if kind in head.name), None)
    return None


def _names(path: Path, kind: str, count: int) -> Sequence[str]:
    """Names of ``pointNames.tsv`` beside the file, if they are as many; else ``pt1``, ``pt2``, ..."""
    beside = path.with_name(path.name.replace(f"{kind}.tsv", "pointNames.tsv"))
    if beside != path and beside.is_file():
        names = read_names(beside)
        if len(names) == count:
            return names
    return [f"pt{m + 1}" for m in range(count)]


def read_names(path: Path) -> list[str]:
    """The names of a ``pointNames.tsv``, a line each after the title.

    Raises:
        FormatError: it is not that.
    """
    title, *names = read_lines(path)
    if title.strip() != POINT_NAMES:
        raise FormatError(f"{path.name}: the first line is {title!r}; expected {POINT_NAMES}")
    return [name.strip() for name in names if name.strip()]


def _cameras(path: Path, columns: int, hints: Hints) -> tuple[int, list[str]]:
    """Number of cameras of a pixel file: stated, or that of the offsets beside it, or one."""
    count = hints.cameras
    beside = path.with_name(path.name.replace("xypts.tsv", "offsets.tsv"))
    if count is None and beside != path and beside.is_file():
        count = read_sparse(beside).shape[1]
    if count is None:
        if columns % 2:
            raise FormatError(
                f"{path.name}: {number_of(columns, 'column is', 'columns are')} not pairs of X and Y: export it again"
            )
        fits = [c for c in range(1, columns // 2 + 1) if columns // 2 % c == 0]
        return 1, [
            "the number of cameras is not in the file: 1 is assumed (it may be "
            f"{', '.join(map(str, fits))}); state it with `cameras`"
        ]
    if count < 1 or columns % (2 * count):
        raise FormatError(
            f"{path.name}: {number_of(columns, 'column is', 'columns are')} not a whole number of points for "
            f"{count} cameras (2 each)"
        )
    return count, []


def _read(path: Path, hints: Hints, *, argus: bool) -> FileContents:
    kind, table = _kind(head(path)), read_sparse(path)
    maker = "argus" if argus else "dltdv"
    if kind == "xypts":
        count, notes = _cameras(path, table.shape[1], hints)
        uv = table.reshape(len(table), -1, count, 2)
        return pixel_recording(
            path,
            f"{maker}-sparse",
            names=_names(path, kind, uv.shape[1]),
            cameras=[f"cam{c + 1}" for c in range(count)],
            uv_px=np.transpose(uv, (2, 0, 1, 3)),
            pixel_origin="lower-left" if argus else None,
            findings=tuple(notes),
        )
    if kind == "offsets":
        cameras = tuple(f"cam{c + 1}" for c in range(table.shape[1]))
        offset = {"offset_frames": np.nan_to_num(table)}
        return table_recording(path, f"{maker}-sparse", camera_names=cameras, tables=offset)
    if kind in ("xyzpts", "xyzci") and table.shape[1] % 3:
        raise FormatError(
            f"{path.name}: {number_of(table.shape[1], 'column is', 'columns are')} not X, Y, Z of points: "
            "export it again"
        )
    values = table.reshape(len(table), -1, 3) if kind in ("xyzpts", "xyzci") else table
    names = _names(path, kind or "", values.shape[1])
    if kind == "xyzpts":
        return point_recording(path, f"{maker}-sparse", names=names, xyz=values, unit=None)
    tables = {"interval" if kind == "xyzci" else "residual_px": values}
    return table_recording(path, f"{maker}-sparse", names=names, tables=tables)


DLTDV_SPARSE = Format(
    name="dltdv-sparse",
    title="sparse TSV of DLTdv",
    knows=lambda head: head.first.lower().startswith("sparse format") and _kind(head) is not None,
    read=lambda path, hints: _read(path, hints, argus=False),
    signs="tsv sparse format camera coordinates file table",
)
ARGUS_SPARSE = Format(
    name="argus-sparse",
    title="sparse TSV of Argus (named ...xypts, xyzpts, xyzres or offsets.tsv)",
    knows=lambda head: re.match(_ARGUS, head.first) is not None and _kind(head) is not None,
    read=lambda path, hints: _read(path, hints, argus=True),
)
DLTDV_POINT_NAMES = Format(
    name="dltdv-point-names",
    title="point names of DLTdv's sparse files",
    knows=lambda head: head.first.strip() == POINT_NAMES,
    read=lambda path, _: FileContents(format="dltdv-point-names", paths=(path,), names=tuple(read_names(path))),
)
