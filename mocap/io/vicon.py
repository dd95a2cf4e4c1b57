"""Vicon Nexus: trajectories in its CSV export."""

from pathlib import Path

import numpy as np

from mocap.errors import FormatError
from mocap.io.contents import FileContents, point_recording
from mocap.io.format import Format
from mocap.io.lines import frame_numbers, number, numbers, read_lines
from mocap.io.optical import rate


def read_csv(path: Path) -> FileContents:
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
            "Frame,X,Y,Z "
            "and units: export it again"
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
    if (
        following is not None
        and np.isfinite(number(lines[following].split(separator)[0]))
        and separator in lines[following]
    ):
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


FORMATS = (
    Format(
        name="vicon-csv",
        title="trajectories of Vicon Nexus (CSV)",
        knows=lambda head: any(line.strip(", \t").lower() == "trajectories" for line in head.lines),
        read=lambda path, _: read_csv(path),
    ),
)
