"""What our own tables share: origins as words, and rows that are checked before they are believed."""

import warnings
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.errors import FormatError
from mocap.io.contents import FileContents, point_recording, points_of
from mocap.io.csv_table import as_cells, as_workbook_cell, from_cell, to_the_last_bit
from mocap.io.format import Format, Hints
from mocap.io.lines import LARGEST, cells_of, even_times, frame_numbers, number
from mocap.io.workbook import write_sheets
from mocap.records import Status
from mocap.text import number_of

if TYPE_CHECKING:
    import pandas as pd

WORDS = np.array([origin.name.lower() for origin in Status])
REPAIRED = "repaired"
"""What a run calls a measured sample that bore another marker's name in its file."""
EDITED = "edited"
"""What it calls a measured sample that a person corrected."""
_CODES = {str(word): code for code, word in enumerate(WORDS)} | dict.fromkeys((REPAIRED, EDITED), Status.MEASURED)


def origin_words(status: NDArray[np.int8], repaired: NDArray[np.int8]) -> NDArray[np.str_]:
    """(T, M) origins as tables name them: ``Status``, and of measured samples 1: ``repaired``, 2: ``edited``."""
    measured = status == Status.MEASURED
    return np.array([*WORDS, REPAIRED, EDITED])[np.where(measured & (repaired > 0), len(WORDS) + repaired - 1, status)]


def codes(path: Path, words: Any) -> NDArray[np.int8]:
    """Status codes of their names.

    Raises:
        FormatError: a name is none of them, as where a row is cut.
    """
    found, index = np.unique(np.asarray(words, dtype=str), return_inverse=True)
    unknown = [word for word in found if word not in _CODES]
    if unknown:
        raise FormatError(
            f"{path.name}: origin {str(unknown[0])!r}; expected {', '.join(WORDS)}: correct it, or write it again"
        )
    return np.array([_CODES[word] for word in found], dtype=np.int8)[index]


def titles(path: Path) -> list[str]:
    """The header.

    Raises:
        FormatError: the file cannot be read, or a column appears twice.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            header = next(cells_of(path, stream), [])
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise FormatError(f"{path.name}: not a text file; expected a CSV table") from None
    if len(set(header)) != len(header):
        raise FormatError(f"{path.name}: the column {max(header, key=header.count)} appears twice: rename one")
    return header


def read_rows(path: Path, kinds: dict[str, type]) -> "pd.DataFrame":
    """The rows of a CSV file, each column of the kind ``str`` or ``float``.

    Raises:
        FormatError: it is cut or empty, or holds a cell that is no finite number.
    """
    import pandas as pd

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # a row longer than the header
            table = pd.read_csv(
                path,
                dtype=kinds,  # type: ignore[arg-type]
                na_values={title: ["", "NaN"] for title, kind in kinds.items() if kind is float},  # NaN may be a name
                keep_default_na=False,
                encoding="utf-8-sig",
                index_col=False,
                **to_the_last_bit(),
            )
    except (ValueError, OverflowError, pd.errors.ParserWarning) as error:  # UnicodeDecodeError is a ValueError
        trouble = _bad_cell(path, kinds) or " ".join(str(error).split())[:200]
        raise FormatError(f"{path.name}: {trouble}; correct it or export it again") from None
    if table.empty:
        raise FormatError(f"{path.name}: contains no rows: export it again")
    for title in table.select_dtypes("number"):
        wrong = np.abs(table[title].to_numpy(dtype=np.float64)) > LARGEST
        if wrong.any():
            row = int(np.argmax(wrong))
            raise FormatError(
                f"{path.name}: line {row + 2}, {title}: {table[title].iloc[row]:g} is not a plausible measurement; "
                "correct it or write NaN"
            )
    return table


def _bad_cell(path: Path, kinds: dict[str, type]) -> str | None:
    """Where the first cell is that should be a number and is none; None where no such cell is found."""
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as stream:
        rows = cells_of(path, stream)
        next(rows, [])
        for line, row in enumerate(rows, start=2):
            for (title, kind), cell in zip(kinds.items(), row, strict=False):
                if kind is float and cell.strip() not in ("", "NaN") and np.isnan(number(cell)):
                    return f"line {line}, {title}: {cell!r:.80} is not a number"
    return None


def check_origins(path: Path, xyz: Array, origin: NDArray[np.int8]) -> None:
    """A sample is missing if and only if it has no position (one that was rejected may have none).

    Raises:
        FormatError: it is not so, as where a number was cut out.
    """
    empty = np.isnan(xyz).any(axis=-1)
    wrong = np.where(empty, ~np.isin(origin, (Status.MISSING, Status.REJECTED)), origin == Status.MISSING)
    if wrong.any():
        raise FormatError(
            f"{path.name}: {number_of(int(wrong.sum()), 'position contradicts its', 'positions contradict their')} "
            "origin (one of the two was changed): correct it"
        )


def with_sd(recording: FileContents, sd: Array) -> FileContents:
    """The recording with isotropic covariances of (T, M) standard deviations.

    Raises:
        FormatError: one is below 0.
    """
    if recording.points is None or not np.isfinite(sd).any():
        return recording
    if (sd < 0).any():
        row, marker = np.argwhere(sd < 0)[0]
        raise FormatError(
            f"{recording.paths[0].name}: the standard deviation of marker {recording.names[marker]!r} in frame "
            f"{recording.frames[row]} is {sd[row, marker]:g}: correct it or write NaN"
        )
    points = replace(recording.points, cov_m2=sd[..., None, None] ** 2 * np.eye(3))
    return replace(recording, points=points)


_ENDS = ("x", "y", "z", "sd", "origin")


def _read_wide(path: Path, hints: Hints) -> FileContents:
    written = titles(path)
    header = [from_cell(title) for title in written]
    names = [title.removesuffix("_origin") for title in header if title.endswith("_origin")]
    sd = [f"{name}_sd" for name in names if f"{name}_sd" in header]
    needed = ["frame", *(f"{name}_{end}" for name in names for end in _ENDS if end != "sd")]
    odd = [title for title in needed if title not in header] or [t for t in header if t not in (*needed, *sd, "t_s")]
    if odd or not names or len(sd) not in (0, len(names)):
        raise FormatError(
            f"{path.name}: the columns are not frame, t_s and <name>_x, _y, _z, _sd, _origin of each marker: "
            f"{odd[0] if odd else '_sd of some'} is missing or too many"
        )
    table = read_rows(path, {title: str if title.endswith("_origin") else float for title in written})
    table.columns = header
    xyz = table[[f"{n}_{axis}" for n in names for axis in "xyz"]].to_numpy().reshape(len(table), -1, 3)
    words = table[[f"{name}_origin" for name in names]].fillna("").to_numpy(dtype=str)
    origin = codes(path, words)
    check_origins(path, xyz, origin)
    fps, findings, times = None, [], None
    if "t_s" in header:
        times = table["t_s"].to_numpy()
        if np.isnan(times).any():
            raise FormatError(
                f"{path.name}: row {int(np.argmax(np.isnan(times))) + 1} has no t_s: give it, or leave the column out"
            )
        times, fps, findings = even_times(path, times, frames=frame_numbers(path, table["frame"]), stated=hints.fps)
    if (words == REPAIRED).any():
        findings.append(
            f"{number_of(int((words == REPAIRED).sum()), 'measured sample')} had another marker's name in the original "
            "file (repaired identity switches)"
        )
    recording = point_recording(
        path,
        "csv-wide",
        names=names,
        xyz=xyz,
        unit="m",
        frames=frame_numbers(path, table["frame"], first_line=2),
        fps=fps,
        t_s=times,
        status=origin,
        findings=tuple(findings),
    )
    return with_sd(recording, table[sd].to_numpy()) if sd else recording


def _write_wide(path: Path, recording: FileContents) -> None:
    columns: dict[str, Any] = {"frame": recording.frames}
    if "quantities" in recording.tables:
        columns |= {"t_s": recording.tables["time_s"]}
        _write_columns(path, columns | dict(zip(recording.names, recording.tables["quantities"].T, strict=True)))
        return
    points = points_of(path, recording)
    columns |= {"t_s": points.t_s} if recording.fps else {}
    deviations = np.isfinite(points.sd_m).any()
    for m, name in enumerate(points.names):
        own = {f"{name}_{axis}": points.xyz_m[:, m, k] for k, axis in enumerate("xyz")}
        own |= {f"{name}_sd": points.sd_m[:, m]} if deviations else {}
        own[f"{name}_origin"] = WORDS[points.status[:, m]]
        if own.keys() & columns.keys():
            raise FormatError(
                f"{path.name}: marker {name!r} would have the same column titles as another marker: rename it"
            )
        columns |= own
    _write_columns(path, columns)


def _write_columns(path: Path, columns: dict[str, Any]) -> None:
    import pandas as pd

    table = pd.DataFrame(columns)
    if path.suffix.lower() == ".xlsx":
        cells = [as_workbook_cell(title) for title in columns]
        write_sheets(path, {"markers": (cells, table.itertuples(index=False))})
    else:
        table.to_csv(path, index=False, header=as_cells(columns), na_rep="NaN", lineterminator="\n")


CSV_WIDE = Format(
    name="csv-wide",
    title="mocap's CSV or workbook, one row for each frame (frame, t_s, <name>_x, ...)",
    knows=lambda head: head.cells()[:1] == ("frame",) and any(c.endswith("_origin") for c in head.cells()),
    read=_read_wide,
    write=_write_wide,
    holds=frozenset({"points", "first_frame", "frame_numbers", "fps", "unit", "origin", "sd", "quantities", "time_s"}),
    needs=frozenset({"unit"}),
    suffixes=(".csv", ".xlsx"),
    signs="csv time x y z table",
)
