"""What came of a batch: tables of trials, of their cycles and of times, and a page that needs no other file."""

import csv
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from html import escape
from importlib.resources import files
from math import isfinite
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pandas as pd

from mocap.audit import across
from mocap.batches.find import DATA
from mocap.batches.trial import Record, some
from mocap.documents import one_line, regular_bytes
from mocap.errors import FormatError
from mocap.findings import Finding, alarms
from mocap.io.csv_table import as_cell, from_cell
from mocap.io.output import result_file

SUMMARY, PAGE, TIMES = "summary.csv", "summary.html", "times"
CYCLES, ANGLES, PEAKS = "cycles.csv", "angles.csv", "peaks.csv"
"""Of every trial, and of all trials together."""
FIGURES = (
    "animal",
    "frames",
    "fps",
    "markers",
    "cameras",
    "measured_percent",
    "gaps",
    "longest_gap_frames",
    "filled",
    "extrapolated",
    "rejected",
    "residual_px",
    "model",
    "hidden_samples",
    "rmse_mm",
    "coverage95",
    *across.COLUMNS,
    "warnings",
    "warning",
    "unlike",
    "version",
)
COLUMNS = ("trial", "status", "error", *FIGURES)
SHOWN = {
    "trial": "trial",
    "status": "status",
    "animal": "animal",
    "frames": "frames",
    "markers": "markers",
    "gaps": "gaps",
    "longest_gap_frames": "longest gap (frames)",
    "filled": "filled samples",
    "fps": "frames a second",
    "cameras": "cameras",
    "residual_px": "residual (px)",
    **{
        "size_mm": "size (mm)",
        "mirrored": "mirrored",
        "unit": "unit",
        "worst_camera_px": "worst camera (px)",
        "lag_frames": "lag (frames)",
        "noise_px": "noise (px)",
        "seen_percent": "digitised (%)",
    },
    "rmse_mm": "held-out error (mm)",
    "coverage95": "inside 95 % intervals (%)",
    "warnings": "warnings",
    "unlike": "unlike the other trials",
    "seconds": "time (s)",
    "error": "error",
}
"""Columns of the page, and their titles."""


def with_siblings(record: Record, told: Sequence[Finding]) -> Record:
    """A record whose row also has what it is compared by, and what the other trials tell of it."""
    row = dict(record.row)
    if record.facts is not None:
        row |= {name: value(record.facts) for name, value in across.COLUMNS.items()}
    if told:
        row["unlike"] = " | ".join(" ".join(one.text.split()) for one in told)
    wrong = [" ".join(one.text.split()) for one in alarms([*told, *record.found])]
    if wrong or (record.row and record.status == "done"):
        row |= {"warnings": len(wrong), "warning": " | ".join(wrong)}
    return replace(record, row=row)


def worst_first(records: Sequence[Record]) -> list[Record]:
    """Those that failed, then those with most that is wrong."""

    def wrong(record: Record) -> float:
        return float(str(record.row.get("warnings") or 0))

    return sorted(records, key=lambda one: (one.status != "failed", one.status == "skipped", -wrong(one)))


def table(records: Sequence[Record]) -> pd.DataFrame:
    """The records as a table, a row a trial, with the columns of ``summary.csv``."""
    return pd.DataFrame(_rows(records), columns=list(COLUMNS))


def _rows(records: Sequence[Record]) -> list[dict[str, object]]:
    return [{"trial": r.trial, "status": r.status, "error": r.error, **r.row} for r in records]


def write_summary(records: Sequence[Record], out: Path) -> None:
    """Write ``summary.csv``, ``summary.html``, ``cycles.csv``, ``angles.csv``, ``peaks.csv``, in place of earlier ones.

    All or none are written. The tables depend on the records alone, and on the tables of the trials; the page also
    shows the times that are in ``times*.csv``.

    Raises:
        OutputError: they cannot be written there, or somebody has changed them.
    """
    with result_file(out / SUMMARY, replace=True) as file:
        with file.open("w", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(COLUMNS)
            writer.writerows([_cell(row.get(column)) for column in COLUMNS] for row in _rows(records))
        file.with_name(PAGE).write_text(page(records, read_times(out)), encoding="utf-8")
        for name in (CYCLES, ANGLES, PEAKS):
            _write_together(name, records, out, file.with_name(name))


def _write_together(name: str, records: Sequence[Record], out: Path, path: Path) -> None:
    """One table of those of all trials that were tracked, with ``trial`` and ``animal`` in place of ``recording``."""
    titles: dict[str, None] = dict.fromkeys(("trial", "animal"))
    for _, table in _tables(name, records, out):
        titles |= dict.fromkeys(table.fieldnames or ())
    titles.pop("recording", None)
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, list(titles), restval="", extrasaction="ignore", lineterminator="\n")
        writer.writeheader()
        for record, table in _tables(name, records, out):  # one at a time: a thousand do not fit into memory
            whose = {"trial": as_cell(record.trial), "animal": as_cell(str(record.row.get("animal", "")))}
            with suppress(csv.Error):
                writer.writerows(row | whose for row in table)


def _tables(name: str, records: Sequence[Record], out: Path) -> "Iterator[tuple[Record, csv.DictReader[str]]]":
    """A table of each trial that was tracked; those deleted since are left out: these trials are tracked again."""
    for record in (record for record in records if record.status == "done"):
        with suppress(OSError, UnicodeDecodeError, csv.Error):
            yield record, csv.DictReader((out / record.trial / name).read_text(encoding="utf-8").splitlines())


def read_together(path: Path) -> pd.DataFrame:
    """A table of a batch (``summary.csv``, ``cycles.csv``, ``angles.csv``, ``peaks.csv``), names as they are called.

    Raises:
        FormatError: there is none.
    """
    names = (
        "trial", "status", "error", "animal", "kind", "of", "model", "warning", "version", "reason", "side", "quantity",
        "statistic", "unit", "unlike", "mirrored", "camera_names",
    )  # fmt: skip
    try:
        data = regular_bytes(path)
        table = pd.read_csv(io.BytesIO(data), dtype=dict.fromkeys(names, str), keep_default_na=False, na_values=[""])
    except (OSError, ValueError) as error:
        raise FormatError(
            f"{path}: {one_line(error)}: expected what mocap batch wrote: give the folder of its --out, or track again"
        ) from None
    texts = [name for name in names if name in table]
    table[texts] = table[texts].fillna("").map(from_cell)
    return table


def _cell(value: object) -> str:
    if value is None:
        return ""
    return as_cell(value.replace(";", ",")) if isinstance(value, str) else str(value)


def read_times(out: Path) -> dict[str, float]:
    """Seconds that each trial took, as far as they are known."""
    found: dict[str, float] = {}
    for path in sorted(out.glob(f"{TIMES}*.csv")):
        with suppress(OSError, ValueError, KeyError, TypeError, csv.Error, FormatError):  # a damaged one tells nothing
            rows = csv.DictReader(regular_bytes(path).decode("utf-8").splitlines())
            found |= {row["trial"]: seconds for row in rows if isfinite(seconds := float(row["seconds"]))}
    return found


def write_times(seconds: Mapping[str, float], path: Path) -> None:
    """Write what each trial took: the file of this run or shard, ``times.csv`` or ``times_3_of_100.csv``."""
    with result_file(path, replace=True) as file, file.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["trial", "seconds"])
        writer.writerows([as_cell(trial), f"{value:.3f}"] for trial, value in sorted(seconds.items()))


def page(records: Sequence[Record], seconds: Mapping[str, float]) -> str:
    """The page: what came of it in a line, then a row a trial, sorted by a click on a title."""
    titles = "".join(f"<th>{escape(title)}</th>" for title in SHOWN.values())
    rows = "\n".join(_row(record, seconds.get(record.trial)) for record in worst_first(records))
    template = files("mocap.batches").joinpath("page.html").read_text(encoding="utf-8")
    filled = {"COUNTS": escape(counted(records)), "SUMMED": escape(summed(records)), "TITLES": titles, "ROWS": rows}
    for name, text in filled.items():
        template = template.replace(f"<!--{name}-->", text)
    return template


def counted(records: Sequence[Record]) -> str:
    """``100 trials: 90 done, 8 failed, 2 skipped``."""
    count = {status: sum(r.status == status for r in records) for status in ("done", "failed", "skipped")}
    numbers = ", ".join(f"{number} {status}" for status, number in count.items() if number)
    return f"{len(records)} trial{'' if len(records) == 1 else 's'}: {numbers or 'none finished yet'}"


def reasons(errors: Mapping[str, str]) -> list[str]:
    """Why trials were not tracked, in the order of their names, equal reasons once.

    Args:
        errors: The reason of each, by its name. Where several have one but for the name of the file that it begins
            with, that is left out.

    Returns:
        ``bat1/t1: t1.csv: ...`` of one trial, ``60 trials (a, b, c, d, ...): ...`` of several.
    """
    found: dict[str, list[str]] = {}
    for trial, error in sorted(errors.items()):
        file, _, rest = error.partition(": ")
        found.setdefault(rest if Path(file).suffix.lower() in DATA else error, []).append(trial)
    return [
        f"{trials[0]}: {errors[trials[0]]}" if len(trials) == 1 else f"{len(trials)} trials ({some(trials)}): {reason}"
        for reason, trials in found.items()
    ]


def summed(records: Sequence[Record]) -> str:
    """Medians over the trials that were tracked, and coverage of all hidden samples together."""
    rows = [r.row for r in records if r.status == "done"]
    found = []
    for name, text in (("residual_px", "residual {:.2f} px"), ("rmse_mm", "held-out error {:.2f} mm")):
        values = [float(str(row[name])) for row in rows if row.get(name) is not None]
        if values:
            found.append(f"median {text.format(np.median(values))}")
    scores = [(r["hidden_samples"], r["coverage95"]) for r in rows if r.get("coverage95") is not None]
    hidden, inside = np.array(scores, dtype=float).reshape(-1, 2).T
    if hidden.sum() > 0:
        share = (hidden * inside).sum() / hidden.sum()
        found.append(f"{share:.1f} % of {hidden.sum():.0f} hidden samples inside 95 % intervals")
    return "; ".join(found)


def _row(record: Record, seconds: float | None) -> str:
    values = {**_rows([record])[0], "seconds": None if seconds is None else f"{seconds:.1f}"}
    name = escape(record.trial)
    done = record.status == "done"  # then there is a folder
    cells = [f'<td><a href="{escape(quote(record.trial))}/">{name}</a></td>' if done else f"<td>{name}</td>"]
    for name in list(SHOWN)[1:]:
        value = values.get(name)
        text = "" if value is None else escape(f"{value:.4g}" if isinstance(value, float) else str(value))
        hint = f' title="{escape(str(values.get("warning", "")))}"' if name == "warnings" and value else ""
        kind = "" if name in ("status", "error", "animal", "unlike", "mirrored", "unit") else ' class="n"'
        cells.append(f"<td{kind}{hint}>{text}</td>")
    return f'<tr class="{record.status}">{"".join(cells)}</tr>'


def as_json(records: Sequence[Record]) -> str:
    """The records for programs."""
    return json.dumps(_rows(records))
