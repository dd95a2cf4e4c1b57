"""Our wide CSV, a row a frame: ``frame, t_s, <name>_x, _y, _z, _sd, _origin`` in metres, as ``mocap track`` writes."""

from pathlib import Path
from typing import Any

import numpy as np

from mocap.errors import FormatError
from mocap.io.contents import FileContents, point_recording, points_of
from mocap.io.csv_table import as_cells, as_workbook_cell, from_cell
from mocap.io.format import Format, Hints
from mocap.io.lines import frame_numbers
from mocap.io.optical import rate_of_times
from mocap.io.tables import REPAIRED, WORDS, check_origins, codes, read_rows, titles, with_sd
from mocap.io.workbook import write_sheet

_ENDS = ("x", "y", "z", "sd", "origin")


def _read(path: Path, _hints: Hints) -> FileContents:
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
        fps, findings = rate_of_times(path, times)
    if (words == REPAIRED).any():
        findings.append(
            f"{(words == REPAIRED).sum()} measured samples had another marker's name in the original "
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


def _write(path: Path, recording: FileContents) -> None:
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
        write_sheet(path, [as_workbook_cell(title) for title in columns], table.itertuples(index=False))
    else:
        table.to_csv(path, index=False, header=as_cells(columns), na_rep="NaN", lineterminator="\n")


FORMATS = (
    Format(
        name="csv-wide",
        title="mocap's CSV or workbook, one row for each frame (frame, t_s, <name>_x, ...)",
        knows=lambda head: head.cells()[:1] == ("frame",) and any(c.endswith("_origin") for c in head.cells()),
        read=_read,
        write=_write,
        holds=frozenset(
            {"points", "first_frame", "frame_numbers", "fps", "unit", "origin", "sd", "quantities", "time_s"}
        ),
        needs=frozenset({"unit"}),
        suffixes=(".csv", ".xlsx"),
    ),
)
