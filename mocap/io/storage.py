"""OpenSim's and SIMM's storage files, .mot and .sto: a head, then quantities over time, which need not be positions."""

import re
from pathlib import Path

import numpy as np

from mocap.errors import FormatError
from mocap.io.contents import FileContents, point_recording, table_recording
from mocap.io.format import Format, Hints
from mocap.io.head import Head
from mocap.io.lines import numbers, read_lines
from mocap.io.optical import rate_of_times

_HEAD = 200
"""Lines in which the head must end."""


def _ends(lines: tuple[str, ...] | list[str]) -> int | None:
    """The line that ends the head."""
    return next((i for i, line in enumerate(lines[:_HEAD]) if line.strip().lower() == "endheader"), None)


def _is_storage(head: Head) -> bool:
    end = _ends(head.lines)
    return end is not None and head.lines[end + 1 :][:1] != () and head.lines[end + 1].lower().startswith("time")


def _read(path: Path, _hints: Hints) -> FileContents:
    """Quantities as the table ``quantities`` (T, N); of data type Vec3 positions, of markers as OpenSim writes them.

    Raises:
        FormatError: the head or a row is not that of a storage file; the message names the line.
    """
    lines = read_lines(path)
    end = _ends(lines)
    if end is None or len(lines) < end + 3:
        raise FormatError(f"{path.name}: no rows after the line endheader: export it again")
    said = dict(re.findall(r"(?m)^\s*(\w+)\s*=\s*(.*?)\s*$", "\n".join(lines[:end])))
    vectors = said.get("DataType", "").lower() == "vec3"
    rows = [re.sub(r"[\s,]+" if vectors else r"\s+", "\t", line.strip()) for line in lines[end + 2 :] if line.strip()]
    title, *names = lines[end + 1].split("\t") if "\t" in lines[end + 1] else lines[end + 1].split()
    names = [name.strip() for name in names if name.strip()]
    if title.strip().lower() != "time" or not names:
        raise FormatError(f"{path.name}: line {end + 2} is not time and the names of quantities: export it again")
    width = 1 + len(names) * (3 if vectors else 1)
    values = numbers(path, rows, separator="\t", columns=width, first_line=end + 3)
    if not np.isfinite(values[:, 0]).all():
        raise FormatError(f"{path.name}: a time is missing in the first column: export it again")
    fps, findings = rate_of_times(path, values[:, 0])
    stated = re.sub(r"\D", "", said.get("nRows", said.get("datarows", "")))
    if stated and int(stated) != len(values):
        findings.append(f"nRows is {stated}, but there are {len(values)} rows")
    if vectors:
        unit = said.get("Units", "").lower() or None
        return point_recording(
            path, "opensim-storage", names=names, xyz=values[:, 1:], unit=unit, fps=fps,
            t_s=values[:, 0], findings=tuple(findings),
        )  # fmt: skip
    angles = {"yes": "angles are in degrees", "no": "angles are in radians"}.get(said.get("inDegrees", "").lower())
    return table_recording(
        path,
        "opensim-storage",
        names=names,
        fps=fps,
        tables={"quantities": values[:, 1:], "time_s": values[:, 0]},
        findings=(*findings, "coordinates, forces or states, not positions", *([angles] if angles else [])),
    )


FORMATS = (
    Format(
        name="opensim-storage",
        title="quantities over time of OpenSim (.mot, .sto)",
        knows=_is_storage,
        read=_read,
    ),
)
