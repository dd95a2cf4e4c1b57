"""DLTdv's files as recordings: the flat CSV set, the sparse TSV set, and projects of version 8."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from mocap.cameras.origin import BOTH, PixelCorner
from mocap.errors import FormatError
from mocap.io.columns import by_title
from mocap.io.contents import FileContents, calibration_recording, pixel_recording, point_recording, table_recording
from mocap.io.csv_table import read_table
from mocap.io.dltdv import names_cameras, read_coefficients, read_pixels, read_points
from mocap.io.dvproject import read_project
from mocap.io.format import Format, Hints
from mocap.io.head import Head
from mocap.records import Status

PIXEL = re.compile(r"(?P<name>.+)_cam\d+_[XYUV]")
POINT = re.compile(r"(?P<name>.+)_([XYZ]|sd)")


def names_of(head: Head, pattern: re.Pattern[str]) -> set[str]:
    """Marker names of the first line; none where a column is not of the pattern."""
    matches = [pattern.fullmatch(cell) for cell in head.cells()]
    return {match["name"] for match in matches if match} if matches and all(matches) else set()


def _numbered(names: set[str]) -> bool:
    """Whether points have no names but ``pt1``, ``pt2``, ..., as before version 8.4."""
    return bool(names) and all(re.fullmatch(r"pt\d+(filt)?", name) for name in names)


def _is_pixels(head: Head) -> bool:
    names = names_of(head, PIXEL)
    new = bool(names) and all(cell[-1] in "UV" for cell in head.cells())
    return bool(names) and (new or _numbered(names) or "xypts" in head.name)


def _origin_beside(path: Path) -> PixelCorner | None:
    """The field ``pixel_origin`` of ``NAME_card.json`` beside ``NAME_xypts.csv``, as simulated recordings have it."""
    try:
        card = json.loads(path.with_name(re.sub(r"xypts\.csv$", "card.json", path.name)).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return next((corner for corner in BOTH if isinstance(card, dict) and card.get("pixel_origin") == corner), None)


def _pixels(path: Path, _hints: Hints) -> FileContents:
    pixels, origin = read_pixels(path, fps=1.0), _origin_beside(path)
    told = ("the file does not record the corner that pixel rows are counted from",) if origin is None else ()
    parts = {"names": pixels.names, "cameras": pixels.cameras, "pixel_origin": origin, "findings": told}
    return pixel_recording(path, "dltdv-xypts", uv_px=pixels.uv_px, **parts)


def _is_points(head: Head) -> bool:
    names = names_of(head, POINT)
    return bool(names) and (_numbered(names) or "xyzpts" in head.name or "xyzfilt" in head.name)


def _points(path: Path, _hints: Hints) -> FileContents:
    points = read_points(path, fps=1.0)
    findings = ()
    if all(name.endswith("filt") for name in points.names):
        names = tuple(name.removesuffix("filt") for name in points.names)
        points = replace(points, names=names, status=np.where(points.seen, Status.SMOOTHED, Status.MISSING))
        findings += ("points are spline-filtered by DLTdv",)
    parts = {"names": points.names, "frames": 1 + np.arange(len(points.t_s)), "points": points, "findings": findings}
    return FileContents(format="dltdv-xyzpts", paths=(path,), **parts)


def residuals(path: Path, format: str, end: str) -> FileContents:
    """Residuals in pixels, a column of each marker."""
    pattern = re.compile(rf"(?P<name>.+)(?P<axis>{end})")
    names, _, (table,) = by_title(path, read_table(path), pattern, [end], expected=f"names like pt1{end}")
    return table_recording(path, format, names=names, tables={"residual_px": table[..., 0]})


def _intervals(path: Path, _hints: Hints) -> FileContents:
    pattern = re.compile(r"(?P<name>.+)(?P<axis>_[XYZ]\+-CI)")
    axes = ["_X+-CI", "_Y+-CI", "_Z+-CI"]
    names, _, (table,) = by_title(path, read_table(path), pattern, axes, expected="names like pt1_X+-CI")
    return table_recording(path, "dltdv-xyzci", names=names, tables={"interval": table})


def offsets(path: Path, format: str, pattern: str) -> FileContents:
    """Frames by which each camera is ahead; columns as ``pattern`` has them, with the camera's number as its group.

    Raises:
        FormatError: columns are not that.
    """
    header, values = read_table(path)
    numbers = [match[1] for title in header if (match := re.fullmatch(pattern, title))]
    if len(set(numbers)) != len(header):
        raise FormatError(
            f"{path.name}: columns {', '.join(header[:4])}; expected one for each camera: export it again"
        )
    told = _ahead(values[np.isfinite(values)]) or "the offsets of all cameras are 0"
    cameras = tuple(f"cam{number}" for number in numbers)
    return table_recording(path, format, camera_names=cameras, tables={"offset_frames": values}, findings=(told,))


def _ahead(offset_frames: np.ndarray) -> str:
    """A sentence on offsets; empty where all are 0."""
    if not offset_frames.any():
        return ""
    return f"cameras are offset by {offset_frames.min():g} to {offset_frames.max():g} frames"


def is_number_row(cells: tuple[str, ...]) -> bool:
    """Whether all cells are finite numbers."""
    try:
        return bool(cells) and bool(np.isfinite([float(cell) for cell in cells]).all())
    except ValueError:
        return False


def _is_coefficients(head: Head) -> bool:
    rows = [line for line in head.lines if line.strip()]
    titled = names_cameras(head.cells())
    return len(rows) - titled in (8, 11) and (titled or is_number_row(head.cells())) and len(head.cells()) <= 100


def _project(path: Path, _hints: Hints) -> FileContents:
    project = read_project(path, fps=1.0)
    try:
        told = read_project(path).fps
        findings = [f"the project states {told:g} frames a second, which may be the playback rate"]
    except FormatError:
        told, findings = None, []
    if not project.cameras:
        findings.append("the project has no DLT coefficients")
    findings += filter(None, [_ahead(project.offset_frames)])
    recording = FileContents(
        format="dltdv-project",
        paths=(path,),
        names=project.pixels.names,
        frames=1 + np.arange(len(project.pixels.t_s)),
        fps=None,
        pixels=project.pixels,
        points=project.stored,
        camera_names=project.pixels.cameras,
        cameras=project.cameras,
        pixel_origin="upper-left",
        tables={"offset_frames": project.offset_frames},
        findings=tuple(findings),
    )
    return recording if told is None else recording.with_rate(told)


def _ends(*ends: str):
    return lambda head: bool(head.cells()) and all(cell.endswith(ends) for cell in head.cells())


FORMATS = (
    Format(
        name="dltdv-project",
        title="project of DLTdv8 (MATLAB 7.3)",
        knows=lambda head: "udExport" in head.hdf5,
        read=_project,
    ),
    Format(name="dltdv-xypts", title="pixel tracks of DLTdv (flat CSV)", knows=_is_pixels, read=_pixels),
    Format(name="dltdv-xyzpts", title="points of DLTdv (flat CSV)", knows=_is_points, read=_points),
    Format(
        name="dltdv-xyzres",
        title="triangulation residuals of DLTdv (flat CSV)",
        knows=_ends("_dltres"),
        read=lambda path, _: residuals(path, "dltdv-xyzres", "_dltres"),
    ),
    Format(name="dltdv-xyzci", title="95 % intervals of DLTdv (flat CSV)", knows=_ends("+-CI"), read=_intervals),
    Format(
        name="dltdv-offsets",
        title="camera offsets of DLTdv (flat CSV)",
        knows=lambda head: bool(head.cells()) and all(re.fullmatch(r"cam\d+_offset", cell) for cell in head.cells()),
        read=lambda path, _: offsets(path, "dltdv-offsets", r"cam(\d+)_offset"),
    ),
    Format(
        name="dltdv-coefficients",
        title="DLT coefficients (CSV, 11 rows, one column for each camera)",
        knows=_is_coefficients,
        read=lambda path, _: calibration_recording(path, "dltdv-coefficients", read_coefficients(path)),
    ),
)


ARGUS_PIXEL = re.compile(r"(?P<name>.+)_cam_(?P<camera>\d+)_(?P<axis>[xy])")
_ARGUS_POINT = re.compile(r"(?P<name>.+)(?P<axis>_[xyz])")
_ARGUS_INTERVAL = re.compile(r"(?P<name>.+)(?P<axis>_[xyz]_(lower|upper))")
_ARGUS_ENDS = ("_x_lower", "_x_upper", "_y_lower", "_y_upper", "_z_lower", "_z_upper")


def _argus_pixels(path: Path, _hints: Hints) -> FileContents:
    expected = "names like track_cam_1_x"
    names, numbers, uv = by_title(path, read_table(path), ARGUS_PIXEL, ["x", "y"], expected=expected)
    cameras = [f"cam{number}" for number in numbers]
    return pixel_recording(path, "argus-xypts", names=names, cameras=cameras, uv_px=uv, pixel_origin="lower-left")


def _argus_points(path: Path, _hints: Hints) -> FileContents:
    names, _, (xyz,) = by_title(path, read_table(path), _ARGUS_POINT, ["_x", "_y", "_z"], expected="names like track_x")
    return point_recording(path, "argus-xyzpts", names=names, xyz=xyz, unit=None)


def _argus_intervals(path: Path, _hints: Hints) -> FileContents:
    names, _, (ends,) = by_title(
        path, read_table(path), _ARGUS_INTERVAL, _ARGUS_ENDS, expected="names like track_x_lower"
    )
    told = (
        "with three or more cameras Argus may have shifted the pixels in time before it computed these points: "
        "triangulate them again"
    )
    half = {"interval": np.abs(ends[..., 1::2] - ends[..., ::2]) / 2}
    return table_recording(path, "argus-xyz-cis", names=names, tables=half, findings=(told,))


ARGUS_FORMATS = (
    Format(
        name="argus-xypts",
        title="pixel tracks of Argus clicker (CSV)",
        knows=lambda head: bool(names_of(head, ARGUS_PIXEL)),
        read=_argus_pixels,
    ),
    Format(
        name="argus-xyz-cis", title="95 % intervals of Argus (CSV)", knows=_ends(*_ARGUS_ENDS), read=_argus_intervals
    ),
    Format(
        name="argus-offsets",
        title="camera offsets of Argus (CSV)",
        knows=lambda head: bool(head.cells()) and all(re.fullmatch(r"camera_\d+", cell) for cell in head.cells()),
        read=lambda path, _: offsets(path, "argus-offsets", r"camera_(\d+)"),
    ),
    Format(
        name="argus-xyzres",
        title="triangulation residuals of Argus (CSV named ...-xyzres.csv)",
        knows=lambda head: head.name.endswith("-xyzres.csv") and bool(head.cells()),
        read=lambda path, _: residuals(path, "argus-xyzres", ""),
    ),
    Format(
        name="argus-xyzpts",
        title="points of Argus clicker (CSV)",
        knows=lambda head: bool(names_of(head, _ARGUS_POINT)) and any(cell.endswith("_z") for cell in head.cells()),
        read=_argus_points,
    ),
)
