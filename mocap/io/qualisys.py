"""Qualisys Track Manager: its text export (.tsv) and its MATLAB export (.mat). Both hold millimetres."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from eal.arrays import Array
from mocap.documents import damaged
from mocap.errors import FormatError
from mocap.io.apart import variables
from mocap.io.contents import Bodies, FileContents, point_recording, table_recording
from mocap.io.format import Format, Head, Hints, file_format
from mocap.io.lines import frame_numbers, numbers, rate, read_lines
from mocap.io.rigid import fixed_markers
from mocap.records import Status

_ORIGIN = np.array([Status.MISSING, Status.MEASURED, Status.INTERPOLATED, Status.INTERPOLATED, Status.INTERPOLATED])
"""By QTM's type of a sample: missing, measured, gap-filled, virtual, edited."""


def _head(lines: Sequence[str]) -> tuple[dict[str, list[str]], int]:
    """Entries of the head by their keys, a line each (several of EVENT), and the number of its lines.

    Titles that do not begin with Frame count as one.
    """
    head: dict[str, list[str]] = {}
    for place, line in enumerate(lines):
        key, *values = line.rstrip("\t").split("\t")
        if key == "Frame" or not key[:1].isalpha():
            return head, place
        head[key.strip()] = values
    return head, len(lines)


@file_format(
    "qualisys-6d",
    "6DOF bodies of Qualisys Track Manager (TSV)",
    lambda head: (
        head.first.startswith("NO_OF_FRAMES\t") and any(line.startswith("BODY_NAMES\t") for line in head.lines[:20])
    ),
)
def read_6d(path: Path, _hints: Hints) -> FileContents:
    """Read a 6D text export: of each body X, Y, Z, three angles, a residual, and its rotation, column by column.

    A body without a pose in a frame has zeros or empty cells there.

    Raises:
        FormatError: the file is not that, is cut, or has a cell that is no number; the message names the line.
    """
    lines = read_lines(path)
    start = next((i for i, line in enumerate(lines[:40]) if "Rot[0]" in line), len(lines))
    head, _ = _head(lines[:start])
    names = [name for name in head.get("BODY_NAMES", []) if name]
    titles = [title.strip() for title in lines[start].split("\t")] if start < len(lines) else []
    first = [i for i, title in enumerate(titles) if title.split(" ")[-1] == "X"]
    turn = [i for i, title in enumerate(titles) if title.endswith("Rot[0]")]
    if not names or len(first) != len(names) or len(turn) != len(names):
        raise FormatError(
            f"{path.name}: BODY_NAMES has {len(names)} bodies, the titles have {len(first)} of X and {len(turn)} of "
            "Rot[0]: export it again from Qualisys Track Manager with column headers"
        )
    rows = [line for line in lines[start + 1 :] if line.strip()]
    if not rows:
        raise FormatError(f"{path.name}: no frames after the header: export it again")
    while titles and not titles[-1]:
        titles.pop()
    cut = ["\t".join(cell.strip() for cell in row.split("\t")[: len(titles)]) for row in rows]
    values = numbers(path, cut, separator="\t", columns=len(titles), first_line=start + 2)
    places = np.stack([values[:, i : i + 3] for i in first], axis=1)
    turns = np.stack([values[:, i : i + 9] for i in turn], axis=1)
    frames = frame_numbers(path, values[:, 0], first_line=start + 2) if titles[0] == "Frame" else None
    return table_recording(
        path,
        "qualisys-6d",
        names=names,
        frames=frames,
        fps=rate(path, head.get("FREQUENCY", [""])[0]),
        unit="mm",
        tables={"transforms": _transforms(places, turns)},
    )


@file_format(
    "qualisys-tsv",
    "3D text export of Qualisys Track Manager (TSV)",
    lambda head: head.first.startswith("NO_OF_FRAMES\t"),
    signs="tsv NO_OF_FRAMES NO_OF_CAMERAS MARKER_NAMES FREQUENCY table",
)
def read_tsv(path: Path, _hints: Hints) -> FileContents:
    """Read a 3D text export: head lines from ``NO_OF_FRAMES`` to ``MARKER_NAMES``, column titles, a row a frame.

    Titles, and the columns Frame and Time, may be left out: then the first row is frame 1. QTM's frame n is at
    (n - 1) / FREQUENCY seconds; the first frame need not be 1. The file does not tell filled samples from measured
    ones: all that have a position are called measured.

    Raises:
        FormatError: the file is not that, is cut, or has a cell that is no number; the message names the line.
    """
    lines = read_lines(path)
    head, start = _head(lines)
    for key in ("NO_OF_FRAMES", "NO_OF_MARKERS", "FREQUENCY", "MARKER_NAMES"):
        if not head.get(key):
            raise FormatError(f"{path.name}: no line {key}; expected a 3D text export of Qualisys Track Manager (.tsv)")
    titles = lines[start].removesuffix("\t").split("\t") if start < len(lines) else []
    start += titles[:1] == ["Frame"]
    names, fps = head["MARKER_NAMES"], rate(path, head["FREQUENCY"][0])
    timed = len(titles) == 2 + 3 * len(names)
    if head["NO_OF_MARKERS"][0].strip() != str(len(names)) or not (timed or len(titles) == 3 * len(names)):
        raise FormatError(
            f"{path.name}: NO_OF_MARKERS is {head['NO_OF_MARKERS'][0]}, with {len(names)} names and {len(titles)} "
            "columns (expected three for each marker, with or without Frame and Time before them): export it again"
        )
    rows = lines[start:]
    while rows and not rows[-1].strip():
        rows.pop()
    if not rows:
        raise FormatError(f"{path.name}: no frames after the header: export it again")
    findings = ["this format does not distinguish filled from measured samples"]
    if str(len(rows)) != head["NO_OF_FRAMES"][0].strip():  # also of a part that somebody took out
        findings.append(f"NO_OF_FRAMES is {head['NO_OF_FRAMES'][0]}, but there are {len(rows)} rows")
    values = numbers(path, rows, separator="\t", columns=len(titles), first_line=start + 1)
    if not timed:
        count = 1.0 + np.arange(len(values))
        values = np.column_stack([count, (count - 1) / fps, values])
    t_s = (values[:, 0] - 1) / fps
    if t_s[0] > 0 == values[0, 1]:  # a part that was cut out, whose times begin anew
        findings.append(f"Time begins at 0 in frame {values[0, 0]:g}: times are those of the frames")
        values[:, 1] += t_s[0]
    off = np.flatnonzero(~(np.abs(t_s - values[:, 1]) < 0.5 / fps))
    if len(off):
        raise FormatError(
            f"{path.name}: line {off[0] + start + 1}: frame {values[off[0], 0]:g} at {fps:g} Hz does not fall on "
            f"{values[off[0], 1]:g} s: correct one of them"
        )
    return point_recording(
        path,
        "qualisys-tsv",
        names=names,
        xyz=values[:, 2:],
        unit="mm",
        frames=frame_numbers(path, values[:, 0], first_line=start + 1),
        fps=fps,
        t_s=t_s,
        findings=tuple(findings),
    )


def _transforms(places_mm: Array, turns: Array) -> Array:
    """(T, B, 4, 4) world from body in metres, of positions (T, B, 3) and rotations (T, B, 9), column by column."""
    out = np.zeros((*turns.shape[:2], 4, 4))
    out[..., :3, :3] = np.swapaxes(turns.reshape(*turns.shape[:2], 3, 3), 2, 3)
    out[..., :3, 3], out[..., 3, 3] = 1e-3 * places_mm, 1.0
    whole = np.isfinite(out).all(axis=(2, 3)) & (np.abs(turns).max(axis=-1) > 0)
    out[~whole] = np.nan
    return out


def read_mat(path: Path) -> FileContents:
    """Read the labelled trajectories of a MATLAB export.

    A sample's type is missing, measured, or filled (also edited or virtual): Status missing, measured, interpolated.
    Exports without types tell filled samples by a residual of exactly 0.

    Raises:
        FormatError: the file is not such an export, or its parts contradict each other.
    """
    # the one struct of the file that holds trajectories
    table = variables(path)
    found = [value for value in table.values() if isinstance(value, dict) and "Trajectories" in value]
    if len(found) != 1:
        raise FormatError(
            f"{path.name}: {len(found)} variables contain Trajectories; expected one, as Qualisys Track Manager exports"
        )
    measurement = found[0]
    advice = "label them in Qualisys Track Manager and export again"
    with damaged(f"{path.name}: no labelled trajectories", advice):
        labelled = measurement["Trajectories"]["Labeled"]
        frames, start = int(measurement["Frames"]), int(measurement.get("StartFrame", 1))
        names = [str(name) for name in np.atleast_1d(labelled["Labels"])]
        data = np.asarray(labelled["Data"], dtype=np.float64)
    if data.size != len(names) * 4 * frames:
        raise FormatError(
            f"{path.name}: Labeled.Data has shape {data.shape}; expected {len(names)} markers x 4 (x, y, z, residual) "
            f"x {frames} frames: export it again"
        )
    data = data.reshape(len(names), 4, frames)
    xyz = np.transpose(data[:, :3], (2, 0, 1)).copy()
    xyz[~np.isfinite(xyz).all(axis=-1)] = np.nan
    kind = _kinds(path, labelled, data)
    origin = np.where(np.isnan(xyz[..., 0]), Status.MISSING, _ORIGIN[kind])
    xyz[origin == Status.MISSING] = np.nan
    unnamed = _count(measurement["Trajectories"].get("Unidentified"))
    bodies = _bodies(path, measurement.get("RigidBodies"), names, 1e-3 * xyz)
    return point_recording(
        path,
        "qualisys-mat",
        names=names,
        xyz=xyz,
        unit="mm",
        frames=start + np.arange(frames),
        fps=rate(path, measurement.get("FrameRate")),
        status=origin,
        bodies=bodies,
        findings=(f"{unnamed} trajectories without a label were left out",) if unnamed else (),
    )


def _bodies(path: Path, group: Any, names: Sequence[str], xyz_m: Array) -> Bodies:
    """Bodies of the struct RigidBodies, whose arrays are bodies x 3 (9) x frames; none where there is none."""
    if not isinstance(group, dict) or not _count({"Count": group.get("Bodies", 0)}):
        return {}
    with damaged(f"{path.name}: RigidBodies is not as Qualisys Track Manager exports it", "export it again"):
        bodies = [str(name) for name in np.atleast_1d(group["Name"])]
        shape = len(bodies), -1, len(xyz_m)
        places, turns = (
            np.transpose(np.asarray(group[key], dtype=np.float64).reshape(shape), (2, 0, 1))
            for key in ("Positions", "Rotations")
        )
        return fixed_markers(names, xyz_m, bodies, _transforms(places, turns))


def _count(group: Any) -> int:
    return int(np.max(group.get("Count", 0), initial=0)) if isinstance(group, dict) else 0


def _kinds(path: Path, labelled: dict[str, Any], data: Array) -> np.ndarray:
    if "Type" not in labelled:
        kind = np.where(np.isnan(data[:, 3]), 0, np.where(data[:, 3] == 0, 2, 1))
    else:
        kind = np.asarray(labelled["Type"])
        if kind.size != data[:, 0].size:
            raise FormatError(f"{path.name}: Labeled.Type has shape {kind.shape}, unlike Data: export it again")
        kind = kind.reshape(data[:, 0].shape).astype(int)
    if kind.min() < 0 or kind.max() >= len(_ORIGIN):
        raise FormatError(f"{path.name}: samples of type {kind.max()}; expected 0 to {len(_ORIGIN) - 1}")
    return kind.T


def _has_trajectories(head: Head) -> bool:
    """Whether a MATLAB file has one struct, with trajectories in it; whatever its variable is called."""
    if not head.mat or head.mat & {"easyWandData", "camud"}:
        return False
    return any(isinstance(value, dict) and "Trajectories" in value for value in variables(head.path).values())


QUALISYS_MAT = Format(
    name="qualisys-mat",
    title="MATLAB export of Qualisys Track Manager",
    knows=_has_trajectories,
    read=lambda path, _: read_mat(path),
)
