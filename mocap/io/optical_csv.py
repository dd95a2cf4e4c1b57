"""OptiTrack Motive: markers in its CSV export of tracking data (format versions 1.2 and later)."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from mocap.errors import FormatError
from mocap.io.contents import FileContents, point_recording
from mocap.io.format import Hints, file_format
from mocap.io.lines import cells_of, frame_numbers, number, numbers, rate, read_lines, told_apart

KINDS = (("marker",), ("rigid body marker", "bone marker"), ("rigid body", "bone"))
"""What columns are of, what was measured first: markers, places of a body's markers as it was fitted, bodies."""
_UNITS = {"meters": "m", "millimeters": "mm", "centimeters": "cm"}
_SHOW = "export it again from Motive (Tracking Data, CSV, with header)"


@file_format(
    "vicon-csv",
    "trajectories of Vicon Nexus (CSV)",
    lambda head: any(line.strip(", \t").lower() == "trajectories" for line in head.lines),
    signs="csv Trajectories Frame Sub table",
)
def read_vicon(path: Path, _hints: Hints) -> FileContents:
    """Read the section ``Trajectories``: rate, names, ``Frame,Sub Frame,X,Y,Z,...``, units, a row a frame.

    Cells are separated by commas or tabs; velocities and accelerations of a marker may follow its X, Y, Z. Other
    sections (devices, model outputs) may come before or after it. Frame n is at (n - 1) / rate seconds. An empty
    cell was not seen. The file does not tell filled samples from measured ones: all that have a position are measured.

    Raises:
        FormatError: there is no such section, it is cut, or a cell is no number; the message names the line.
    """
    lines = read_lines(path)
    titles = [line.strip(", \t").lower() for line in lines]
    if "trajectories" not in titles:
        raise FormatError(f"{path.name}: no line Trajectories; expected a CSV export of trajectories from Vicon Nexus")
    start = titles.index("trajectories")
    separator = "\t" if "\t" in "".join(lines[start + 3 : start + 4]) else ","
    head = [line.rstrip(separator).split(separator) for line in lines[start + 1 : start + 5]]
    if len(head) < 4 or [cell.strip() for cell in head[2][:2]] != ["Frame", "Sub Frame"]:
        raise FormatError(
            f"{path.name}: lines {start + 2} to {start + 5} should contain the rate, marker names, Frame,Sub "
            "Frame,X,Y,Z and units: export it again"
        )
    axes = [cell.strip().upper() for cell in head[2][2:]]
    named = [column for column, cell in enumerate(head[1][2:]) if cell.strip()]
    names = [head[1][2 + column].strip() for column in named]
    if not names or any(axes[i : i + 3] != ["X", "Y", "Z"] for i in named) or axes.count("X") != len(names):
        raise FormatError(
            f"{path.name}: line {start + 4} has {len(axes)} columns, {axes.count('X')} of X, for {len(names)} marker "
            "names; expected X, Y, Z below each: export it again"
        )
    units = {cell.strip() for i in named for cell in head[3][2 + i : 5 + i]} - {""}
    if len(units) != 1:
        raise FormatError(
            f"{path.name}: line {start + 5}: units are {sorted(units)}; expected one for all: export again"
        )
    empty = (i for i in range(start + 5, len(lines)) if not lines[i].strip(", \t"))
    end = next(empty, len(lines))
    rows = lines[start + 5 : end]
    following = next((i for i in range(end, len(lines)) if lines[i].strip(", \t")), None)
    cells = [] if following is None else lines[following].split(separator)
    if following is not None and len(cells) > 1 and np.isfinite(number(cells[0])):
        raise FormatError(
            f"{path.name}: line {following + 1}: frames go on after the empty line {end + 1}: remove that line, or "
            "export it again"
        )
    if not rows:
        raise FormatError(f"{path.name}: no frames after the header: export it again")
    values = numbers(path, rows, separator=separator, columns=2 + len(axes), first_line=start + 6)
    return point_recording(
        path,
        "vicon-csv",
        names=names,
        xyz=values[:, [2 + i + k for i in named for k in range(3)]],
        unit=units.pop(),
        frames=frame_numbers(path, values[:, 0], first_line=start + 6),
        fps=rate(path, head[0][0]),
        findings=("this format does not distinguish filled from measured samples",),
    )


@file_format(
    "optitrack-csv",
    "markers of OptiTrack Motive (CSV)",
    lambda head: head.first.startswith("Format Version,") and "Take Name" in head.first,
    signs="csv Format Version Take Name Frame Time (Seconds) table",
)
def read_optitrack(path: Path, _hints: Hints) -> FileContents:
    """Read the line ``Format Version,...``, rows of types, names and IDs, and ``Frame,Time (Seconds),X,Y,Z,...``.

    Where there are markers, bodies and the places that Motive fits their markers to are left out; where there are
    none, these are read. Markers that are named after a rigid body are its markers. Rotations and errors are not read.
    An empty cell was not seen. The file does not tell filled samples from measured ones.

    Raises:
        FormatError: the header is another, a row is cut, or a cell is no number; the message names the line.
    """
    lines = read_lines(path)
    about = _cells(path, lines[0], 1)
    head = dict(zip(about[::2], about[1::2], strict=False))
    if about[0] != "Format Version":
        raise FormatError(f"{path.name}: the first line is not Format Version,...: {_SHOW}")
    start = next((i for i, line in enumerate(lines[:20]) if line.startswith("Frame,Time")), None)
    if start is None:
        raise FormatError(f"{path.name}: no line Frame,Time (Seconds),X,Y,Z: {_SHOW}")
    titles = [_cells(path, line, n) for n, line in enumerate(lines[1:start], start=2) if line.strip(", \t")]
    axes = _cells(path, lines[start], start + 1)
    if len(titles) < 3 or any(len(row) != len(axes) for row in titles):
        raise FormatError(
            f"{path.name}: lines 2 to {start} should contain the types, names, IDs and kinds of {len(axes) - 2} "
            f"columns: {_SHOW}"
        )
    types, names, what = titles[0], titles[1], titles[-1]
    kinds = [[c for c in range(2, len(axes)) if types[c].lower() in kind and what[c] == "Position"] for kind in KINDS]
    columns: Sequence[int] = next((found for found in kinds if found), [])
    if not columns or [axes[c] for c in columns] != ["X", "Y", "Z"] * (len(columns) // 3):
        raise FormatError(f"{path.name}: no columns of positions X, Y, Z of markers or bodies: {_SHOW}")
    unit = head.get("Length Units", "")
    if unit.lower() not in _UNITS:
        raise FormatError(
            f"{path.name}: Length Units is {unit!r}, expected Meters, Centimeters or Millimeters: {_SHOW}"
        )
    if len(lines) == start + 1:
        raise FormatError(f"{path.name}: no frames after the header: {_SHOW}")
    values = numbers(path, lines[start + 1 :], separator=",", columns=len(axes), first_line=start + 2)
    unique, renamed = told_apart([names[c] for c in columns[::3]])
    named = dict.fromkeys(names[c] for c in range(2, len(axes)) if types[c].lower() == "rigid body")
    of_body = {body: {m: np.full(3, np.nan) for m in unique if _is_of(m, body, named)} for body in named}
    bodies = () if columns == kinds[0] else ("no markers: positions of rigid bodies or bones, as Motive fitted them",)
    fps = rate(path, head.get("Export Frame Rate", head.get("Capture Frame Rate", "")))
    frames = frame_numbers(path, values[:, 0], first_line=start + 2)
    return point_recording(
        path,
        "optitrack-csv",
        names=unique,
        xyz=np.ascontiguousarray(values[:, columns]),
        unit=_UNITS[unit.lower()],
        frames=frames,
        first=0,
        fps=fps,
        bodies={body: own for body, own in of_body.items() if len(own) >= 3},
        findings=(
            *renamed,
            *bodies,
            "y points up, as Motive counts; this format does not distinguish filled from measured samples",
        ),
    )


def _is_of(marker: str, body: str, bodies: Iterable[str]) -> bool:
    """Whether a marker is named after a body (``box:Marker1``, ``box_1``), and after no other of a longer name."""
    after = [one for one in bodies if marker.startswith(one) and not marker[len(one) :][:1].isalnum()]
    return bool(after) and marker not in after and max(after, key=len) == body


def _cells(path: Path, line: str, number: int) -> list[str]:
    return [cell.strip() for cell in next(cells_of(path, [line], first_line=number))]
