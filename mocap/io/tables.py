"""What our own tables share: origins as words, and rows that are checked before they are believed."""

import csv
import warnings
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.errors import FormatError
from mocap.io.contents import FileContents
from mocap.io.csv_table import to_the_last_bit
from mocap.io.lines import LARGEST, number
from mocap.records import Status

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
            header = next(csv.reader(stream), [])
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror}") from None
    except (UnicodeDecodeError, csv.Error):
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
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as stream, suppress(csv.Error):
        rows = csv.reader(stream)
        next(rows, [])
        for row in rows:
            for (title, kind), cell in zip(kinds.items(), row, strict=False):
                if kind is float and cell.strip() not in ("", "NaN") and np.isnan(number(cell)):
                    return f"line {rows.line_num}, {title}: {cell!r} is not a number"
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
            f"{path.name}: {wrong.sum()} positions contradict their origin (one of the two was changed): correct it"
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
