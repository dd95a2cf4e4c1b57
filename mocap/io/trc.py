"""TRC, the marker file of Motion Analysis and OpenSim."""

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.errors import FormatError
from mocap.io.contents import FileContents, point_recording, points_of, table_recording
from mocap.io.csv_table import as_cell, from_cell
from mocap.io.format import Format, Head, Hints, file_format
from mocap.io.lines import even_times, frame_numbers, metres, number, numbers, read_lines, told_apart, unit_of

_KEYS = ("DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units", "OrigDataRate", "OrigDataStartFrame")


def _read(path: Path, hints: Hints) -> FileContents:
    """Positions at the times of the column Time; empty and ``NaN`` mean not seen.

    Raises:
        FormatError: the head or a row is not that of a TRC file; the message names the line.
    """
    lines = read_lines(path)
    if len(lines) < 6 or not lines[0].startswith("PathFileType"):
        raise FormatError(
            f"{path.name}: does not begin with PathFileType and the four header lines of a TRC file: export it again"
        )
    separator = next((mark for mark in "\t," if mark in lines[1]), None)
    mark = separator or "\t"
    keys, entries, titles = ([cell.strip() for cell in line.split(separator)] for line in lines[1:4])
    head = dict(zip(keys, entries, strict=False))
    if not head.get("Units"):
        raise FormatError(f"{path.name}: lines 2 and 3 do not state Units; expected {', '.join(_KEYS)}")
    if not titles or not re.match(r"frame", titles[0], re.IGNORECASE):
        raise FormatError(f"{path.name}: line 4 does not begin with Frame#: export it again")
    rows = [(i, line) for i, line in enumerate(lines[5:], start=6) if line.strip(", \t")]
    if not rows:
        raise FormatError(f"{path.name}: no frames after the header: export it again")
    counts = [line.count(mark) + 1 for _, line in rows]
    usual = max(set(counts), key=counts.count)
    for (line, _), count in zip(rows, counts, strict=True):
        if count > usual and (count - usual) % 3:  # no whole trajectory more
            raise FormatError(f"{path.name}: line {line} has {count} cells, expected {usual}: export it again")
    text = [line.rstrip("\t, ") if separator else "\t".join(line.split()) for _, line in rows]
    names, findings = _names(path, titles, text, mark)
    if head.get("NumMarkers") != str(len(names)):
        findings.append(f"NumMarkers is {head.get('NumMarkers', 'missing')}, but there are {len(names)} trajectories")
    width = 2 + 3 * len(names)
    ends = [separator is not None and line.count(separator) + 1 < width for _, line in rows]
    whole = [(line.count(mark) - 1) % 3 == 0 for line in text]
    short = sum(end and full for end, full in zip(ends, whole, strict=True))
    if short:  # Cortex ends a row after the last trajectory that it saw
        findings.append(f"{short} rows end before the last trajectory, which was read as not seen there")
    filled = zip(text, ends, whole, strict=True)
    text = [
        line + mark * max(0, width - 1 - line.count(mark)) if full or not end else line for line, end, full in filled
    ]
    values = numbers(path, text, separator=mark, columns=width, first_line=rows[0][0])
    frames, times = frame_numbers(path, values[:, 0], first_line=rows[0][0]), values[:, 1]
    if not np.isfinite(times).all():
        raise FormatError(f"{path.name}: line {rows[int(np.argmax(np.isnan(times)))][0]}: no time: export it again")
    times, fps, rate_findings = _rate(path, times, frames, head.get("DataRate", ""), hints.fps)
    findings += rate_findings
    if str(len(rows)) != head.get("NumFrames"):
        findings.append(f"NumFrames is {head.get('NumFrames', 'missing')}, but there are {len(rows)} rows")
    unit = unit_of(head["Units"]) or head["Units"]  # which point_recording refuses
    return point_recording(
        path,
        "trc",
        names=names,
        xyz=values[:, 2:],
        unit=unit,
        frames=frames,
        fps=fps,
        t_s=times,
        findings=tuple(findings),
    )


def _names(path: Path, titles: list[str], rows: list[str], separator: str) -> tuple[list[str], list[str]]:
    """The name of each trajectory (U_1, U_2, ... without one), and a finding on what was renamed."""
    lengths = [row.count(separator) + 1 for row in rows]
    named = [(place, from_cell(title)) for place, title in enumerate(titles[2:]) if title]
    count = max(-(-(max(lengths) - 2) // 3), len(named))
    if count > len(named):
        placed = all(place % 3 == 0 and place < 3 * count for place, _ in named)
        if (max(lengths) - 2) % 3 or not (placed or [place for place, _ in named] == list(range(len(named)))):
            raise FormatError(
                f"{path.name}: rows have up to {max(lengths)} cells, line 4 names {len(named)} after Frame# and Time: "
                "expected X, Y and Z for each: export it again"
            )
        by_place = {place // 3 if placed else place: name for place, name in named}
        return told_apart([by_place.get(place, "") for place in range(count)])
    return told_apart([name for _, name in named])


def _rate(
    path: Path, times: Array, frames: NDArray[np.int64], text: str, stated: float | None
) -> tuple[Array, float | None, list[str]]:
    """Times, frames a second by the column Time, and how that agrees with DataRate."""
    rate = number(text)
    times, fps, findings = even_times(path, times, frames=frames, header=rate if rate > 0 else None, stated=stated)
    if fps is None:
        return times, (rate if rate > 0 else None), findings
    if fps == stated:
        return times, fps, findings
    if abs(rate - fps) < 0.01 * fps:  # times are rounded: what the head says is nearer to the truth
        return times, (rate if abs(rate - fps) * (times[-1] - times[0]) < 0.5 else fps), findings
    return (
        times,
        fps,
        [
            *findings,
            f"DataRate says {text or 'nothing'}, the column Time {fps:.6g} frames a second: the column Time is used",
        ],
    )


def _write(path: Path, recording: FileContents) -> None:
    """Write positions in the unit of the recording, at their times; what is not seen is ``NaN``.

    OpenSim of all versions reads that (before 4.2 an empty cell shifts the row); it takes column Time.
    """
    tracks = points_of(path, recording)
    bad = next((name for name in tracks.names if not name.strip() or re.search(r"[\t\r\n]", name)), None)
    if bad is not None:
        raise FormatError(f"{path.name}: marker name {bad!r} is empty or contains a tab or line end: rename it")
    unit = recording.unit or "m"
    fps, count = recording.fps or 1.0, len(tracks.t_s)
    values = tracks.xyz_m / metres(path, unit)
    decimals = 9 + round(np.log10(metres(path, unit)))  # a nanometre
    with path.open("w", encoding="utf-8", newline="") as stream:
        stream.write(f"PathFileType\t4\t(X/Y/Z)\t{as_cell(path.name)}\n")
        stream.write("\t".join([*_KEYS, "OrigNumFrames"]) + "\n")
        start = int(recording.frames[0]) if count else 1
        stream.write("\t".join(map(str, [f"{fps:.10g}", f"{fps:.10g}", count, len(tracks.names), unit])))
        stream.write(f"\t{fps:.10g}\t{start}\t{count}\n")
        stream.write("Frame#\tTime\t" + "\t\t\t".join(as_cell(name.strip()) for name in tracks.names) + "\t\t\n")
        axes = [f"{axis}{m}" for m in range(1, len(tracks.names) + 1) for axis in "XYZ"]
        stream.write("\t\t" + "\t".join(axes) + "\n\n")
        for frame, t_s, row in zip(recording.frames, tracks.t_s, values.reshape(count, -1), strict=True):
            cells = ["NaN" if np.isnan(value) else f"{value:.{decimals}f}" for value in row]
            stream.write(f"{frame}\t{t_s:.9f}\t" + "\t".join(cells) + "\n")


def _ends(lines: tuple[str, ...] | list[str]) -> int | None:
    """The line that ends the head."""
    return next((i for i, line in enumerate(lines[:200]) if line.strip().lower() == "endheader"), None)


def _is_storage(head: Head) -> bool:
    end = _ends(head.lines)
    return end is not None and head.lines[end + 1 :][:1] != () and head.lines[end + 1].lower().startswith("time")


@file_format("opensim-storage", "quantities over time of OpenSim (.mot, .sto)", _is_storage)
def _read_storage(path: Path, hints: Hints) -> FileContents:
    """Quantities as the table ``quantities`` (T, N); of data type Vec3 positions, of markers as OpenSim writes them.

    Raises:
        FormatError: the head or a row is not that of a storage file; the message names the line.
    """
    lines = read_lines(path)
    end = _ends(lines)
    if end is None or len(lines) < end + 3:
        raise FormatError(f"{path.name}: no rows after the line endheader: export it again")
    head = dict(re.findall(r"(?m)^\s*(\w+)\s*=\s*(.*?)\s*$", "\n".join(lines[:end])))
    vectors = head.get("DataType", "").lower() == "vec3"
    rows = [re.sub(r"[\s,]+" if vectors else r"\s+", "\t", line.strip()) for line in lines[end + 2 :] if line.strip()]
    title, *names = lines[end + 1].split("\t") if "\t" in lines[end + 1] else lines[end + 1].split()
    names = [name.strip() for name in names if name.strip()]
    if title.strip().lower() != "time" or not names:
        raise FormatError(f"{path.name}: line {end + 2} is not time and the names of quantities: export it again")
    width = 1 + len(names) * (3 if vectors else 1)
    values = numbers(path, rows, separator="\t", columns=width, first_line=end + 3)
    if not np.isfinite(values[:, 0]).all():
        raise FormatError(f"{path.name}: a time is missing in the first column: export it again")
    times, fps, findings = even_times(path, values[:, 0], stated=hints.fps)
    count = re.sub(r"\D", "", head.get("nRows", head.get("datarows", "")))
    if count and int(count) != len(values):
        findings.append(f"nRows is {count}, but there are {len(values)} rows")
    if vectors:
        unit = head.get("Units", "").lower() or None
        return point_recording(
            path, "opensim-storage", names=names, xyz=values[:, 1:], unit=unit, fps=fps,
            t_s=times, findings=tuple(findings),
        )  # fmt: skip
    angles = {"yes": "angles are in degrees", "no": "angles are in radians"}.get(head.get("inDegrees", "").lower())
    return table_recording(
        path,
        "opensim-storage",
        names=names,
        fps=fps,
        tables={"quantities": values[:, 1:], "time_s": times},
        findings=(*findings, "coordinates, forces or states, not positions", *([angles] if angles else [])),
    )


TRC = Format(
    name="trc",
    title="TRC (Motion Analysis, OpenSim)",
    knows=lambda head: head.first.startswith("PathFileType"),
    read=_read,
    write=_write,
    holds=frozenset({"points", "first_frame", "frame_numbers", "fps", "unit"}),
    needs=frozenset({"fps", "unit"}),
    zero_is_missing=True,
    suffixes=(".trc",),
    signs="tsv PathFileType DataRate NumMarkers table",
)
