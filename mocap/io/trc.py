"""TRC, the marker file of Motion Analysis and OpenSim."""

import re
from pathlib import Path

import numpy as np

from eal.arrays import Array
from mocap.errors import FormatError
from mocap.io.cells import as_cell, from_cell
from mocap.io.contents import FileContents, point_recording, points_of
from mocap.io.format import Format, Hints
from mocap.io.lines import frame_numbers, number, numbers, points, read_lines
from mocap.io.optical import UNIT_M, metres, rate_of_times

_KEYS = ("DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units", "OrigDataRate", "OrigDataStartFrame")
_SAME_RATE = 0.01
"""Times and DataRate may differ by so large a share before that is a finding."""


def _read(path: Path, _hints: Hints) -> FileContents:
    """Positions at the times of the column Time; empty, ``NaN`` and (0, 0, 0) mean not seen.

    Raises:
        FormatError: the head or a row is not that of a TRC file; the message names the line.
    """
    lines = read_lines(path)
    if len(lines) < 6 or not lines[0].startswith("PathFileType"):
        raise FormatError(
            f"{path.name}: does not begin with PathFileType and the four header lines of a TRC file: export it again"
        )
    separator = "\t" if "\t" in lines[1] else ","
    keys, told = ([cell.strip() for cell in lines[i].split(separator)] for i in (1, 2))
    head = dict(zip(keys, told, strict=False))
    lacking = [key for key in ("NumFrames", "NumMarkers", "Units") if not head.get(key)]
    if lacking:
        raise FormatError(f"{path.name}: lines 2 and 3 do not state {lacking[0]}; expected {', '.join(_KEYS)}")
    titles = [cell.strip() for cell in lines[3].split(separator)]
    names = [from_cell(title) for title in titles[2:] if title]
    if not re.match(r"frame", titles[0], re.IGNORECASE) or head["NumMarkers"] != str(len(names)):
        raise FormatError(
            f"{path.name}: NumMarkers is {head['NumMarkers']}, but line 4 names {len(names)} after Frame# and Time: "
            "export it again"
        )
    rows = [(i, line) for i, line in enumerate(lines[5:], start=6) if line.strip(", \t")]
    if not rows:
        raise FormatError(f"{path.name}: no frames after the header: export it again")
    width = 2 + 3 * len(names)
    text = [line for _, line in rows]
    values = numbers(path, text, separator=separator, columns=width, first_line=rows[0][0])
    frames, times = values[:, 0], values[:, 1]
    if not np.isfinite(times).all():
        raise FormatError(f"{path.name}: line {rows[int(np.argmax(np.isnan(times)))][0]}: no time: export it again")
    xyz = points(values[:, 2:], unit_m=1.0)
    zero = (xyz == 0).all(axis=-1)
    xyz[zero] = np.nan
    fps, findings = _rate(path, times, head.get("DataRate", ""))
    if str(len(rows)) != head["NumFrames"]:
        findings.append(f"{len(rows)} rows, but NumFrames says {head['NumFrames']}: the file is cut, or was edited")
    if zero.any():
        findings.append(f"{zero.sum()} samples at exactly (0, 0, 0) were read as missing")
    unit = head["Units"].lower()
    if unit not in UNIT_M:
        metres(path, unit)
    return point_recording(
        path,
        "trc",
        names=names,
        xyz=xyz,
        unit=unit,
        frames=frame_numbers(path, frames, first_line=rows[0][0]),
        fps=fps,
        t_s=times,
        findings=tuple(findings),
    )


def _rate(path: Path, times: Array, told: str) -> tuple[float | None, list[str]]:
    """Frames a second by the column Time, and how that agrees with DataRate."""
    fps, findings = rate_of_times(path, times)
    said = number(told)
    if fps is None:
        return (said if said > 0 else None), []
    if abs(said - fps) < _SAME_RATE * fps:  # times are rounded: what the head says is nearer to the truth
        return (said if abs(said - fps) * (times[-1] - times[0]) < 0.5 else fps), findings
    return fps, [
        *findings,
        f"DataRate says {told or 'nothing'}, the column Time {fps:.6g} frames a second: the column Time is used",
    ]


def _write(path: Path, recording: FileContents) -> None:
    """Write positions in the unit of the recording, at their times; what is not seen is ``NaN``.

    OpenSim of all versions reads that (before 4.2 an empty cell shifts the row); it takes column Time.

    Raises:
        FormatError: there is nothing to write, or a name cannot be said.
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


FORMATS = (
    Format(
        name="trc",
        title="TRC (Motion Analysis, OpenSim)",
        knows=lambda head: head.first.startswith("PathFileType"),
        read=_read,
        write=_write,
        holds=frozenset({"points", "first_frame", "frame_numbers", "fps", "unit"}),
        needs=frozenset({"fps", "unit"}),
        zero_is_missing=True,
        suffixes=(".trc",),
    ),
)
