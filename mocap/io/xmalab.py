"""XMALab's CSV exports: 2D points, 3D points and rigid bodies.

The files record neither whether pixels count from 0 or 1, nor from which corner, nor whether they are undistorted.
"""

import re
from pathlib import Path

import numpy as np

from eal.arrays import Array
from mocap.errors import FormatError
from mocap.io.contents import FileContents, pixel_recording, point_recording, table_recording
from mocap.io.csv_table import by_title, read_table
from mocap.io.dltdv import PIXEL, names_of, pixel_cells
from mocap.io.format import Head, Hints, file_format
from mocap.io.lines import frame_numbers, numbers, read_lines

_PIXEL = re.compile(r"(?P<name>.+)_cam(?P<camera>\d+)(?P<axis>_[XY])")
_POINT = re.compile(r"(?P<name>.+)(?P<axis>_[XYZ])")
_OFFSETS = re.compile(r"(?:cam\d+_offset)+")
BODY_ENTRIES = ("R11", "R12", "R13", "01", "R21", "R22", "R23", "02", "R31", "R32", "R33", "03", "TX", "TY", "TZ", "1")
_ACS = ("rxx", "rxy", "rxz", "rx0", "ryx", "ryy", "ryz", "ry0", "rzx", "rzy", "rzz", "rz0", "tx", "ty", "tz", "t1")
"""A coordinate system that XROMM's Maya tools export (``*_acs_tm.csv``): the same 16 numbers under other titles."""
_FIRST = ("_R11", ".rxx")
_NO_PIXELS = (
    "the file states neither where pixels are counted from (0 or 1, upper or lower left) nor whether they "
    "are undistorted"
)


def _is_pixels(head: Head) -> bool:
    return bool(names_of(head, PIXEL)) or (_OFFSETS.match(head.first) is not None and "_X" in head.first)


@file_format("xmalab-2d", "pixel tracks of XMALab (CSV)", _is_pixels, signs="csv _cam1_X _cam1_Y table pixels")
def _pixels(path: Path, _hints: Hints) -> FileContents:
    lines = read_lines(path)
    glued = _OFFSETS.match(lines[0])
    if glued is None:
        names, cameras, uv = pixel_cells(path)
    else:
        # names, cameras and (C, T, M, 2) pixels where offset columns come first, whose titles lack their commas
        count = glued[0].count("_offset")
        titles = [title.strip() for title in lines[0][glued.end() :].lstrip(",").split(",")]
        rows = [line for line in lines[1:] if line.strip()]
        values = numbers(path, rows, separator=",", columns=count + len(titles), first_line=2)[:, count:]
        names, numbered, uv = by_title(
            path, (titles, values), _PIXEL, ["_X", "_Y"], expected=f"name_cam1_X after {count} offsets"
        )
        cameras = [f"cam{number}" for number in numbered]
    return pixel_recording(path, "xmalab-2d", names=names, cameras=cameras, uv_px=uv, findings=(_NO_PIXELS,))


def _is_points(head: Head) -> bool:
    cells = head.cells()
    cells = cells[1:] if cells[:1] == ("Frame",) else cells
    return any(cell.endswith("_Z") for cell in cells) and all(re.fullmatch(r".+_[XYZ]", cell) for cell in cells)


@file_format("xmalab-3d", "points of XMALab (CSV)", _is_points)
def _points(path: Path, _hints: Hints) -> FileContents:
    header, values = read_table(path)
    frames, header, values = _frames(path, header, values)
    axes = ["_X", "_Y", "_Z"]
    names, _, (xyz,) = by_title(path, (header, values), _POINT, axes, expected="names like tip_X")
    # the frequency of a low-pass filter, which ends every name
    ends, hertz = [re.fullmatch(r"(.+)_([\d.]+(?:e[+-]?\d+)?)Hz", name) for name in names], None
    if all(ends) and len({end[2] for end in ends if end}) == 1:
        names, hertz = tuple(end[1] for end in ends if end), next(end[2] for end in ends if end)
    findings = list[str]()
    if hertz is not None:
        findings.append(f"points were low-pass filtered at {hertz} Hz by XMALab")
    if frames is None and hertz is None:
        findings.append("DLTdv 8.4 writes the same columns: the file does not state which program wrote it")
    return point_recording(path, "xmalab-3d", names=names, xyz=xyz, unit=None, frames=frames, findings=tuple(findings))


def _frames(path: Path, header: list[str], values: Array) -> tuple[np.ndarray | None, list[str], Array]:
    """Frame numbers of the column ``Frame``, if there is one, and the table without it."""
    if header[0] != "Frame":
        return None, header, values
    return frame_numbers(path, values[:, 0], first_line=2), header[1:], values[:, 1:]


def _body_pattern(cell: str) -> re.Match[str] | None:
    found = re.fullmatch(rf"(?P<name>.+)_(?P<entry>{'|'.join(BODY_ENTRIES)})(?P<filter>_[\d.]+Hz)?", cell)
    return found or re.fullmatch(rf"(?P<name>.+)\.(?P<entry>{'|'.join(_ACS)})(?P<filter>)", cell)


def _is_bodies(head: Head) -> bool:
    cells = head.cells()
    cells = cells[1:] if cells[:1] == ("Frame",) else cells
    return (
        bool(cells) and len(cells) % 16 == 0 and all(map(_body_pattern, cells)) and cells[0].endswith((*_FIRST, "Hz"))
    )


@file_format(
    "xmalab-rigid-bodies",
    "rigid bodies of XMALab and coordinate systems of Maya (CSV, 16 columns for each)",
    _is_bodies,
)
def _bodies(path: Path, _hints: Hints) -> FileContents:
    """A row holds the transposed 4 x 4 matrix of each body: its first column, ..., its translation."""
    header, values = read_table(path)
    frames, header, values = _frames(path, header, values)
    matches = [_body_pattern(title) for title in header]
    names = list(dict.fromkeys(match["name"] for match in matches if match))
    filters = {match["filter"] or None for match in matches if match}
    entries = [(m["name"], m["entry"]) for m in matches if m]
    layouts = [[(name, entry) for name in names for entry in kind] for kind in (BODY_ENTRIES, _ACS)]
    if not all(matches) or entries not in layouts:
        raise FormatError(
            f"{path.name}: columns are not the 16 entries of a matrix for each rigid body: export it again"
        )
    matrices = np.swapaxes(values.reshape(len(values), len(names), 4, 4), 2, 3)
    lost = np.isnan(matrices.reshape(*matrices.shape[:2], 16)).any(axis=-1)
    matrices[np.asarray(lost)] = np.nan
    rotations = matrices[..., :3, :3]
    off = np.nanmax(np.abs(rotations @ np.swapaxes(rotations, 2, 3) - np.eye(3)), initial=0.0)
    findings = list[str]()
    if entries == layouts[1]:
        findings.append("poses of an anatomical coordinate system, as Maya exports it")
        still = bool((np.ptp(matrices.reshape(len(matrices), -1), axis=0) == 0).all()) and len(matrices) > 1
        findings += ["the coordinate system is the same in all frames: it is fixed to the bone"] if still else []
    if off > 1e-3:
        findings.append(f"matrices are not rotations: entries of R R^T differ from the identity by up to {off:.2g}")
    findings += [
        f"transforms were low-pass filtered at {f[1:-2]} Hz by XMALab" for f in sorted(f for f in filters if f)
    ]
    return table_recording(
        path,
        "xmalab-rigid-bodies",
        names=tuple(names),
        frames=frames,
        tables={"transforms": matrices},
        findings=tuple(findings),
    )
