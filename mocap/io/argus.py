"""Argus clicker's CSV set (Jackson et al. 2016): columns are found by name, never by position."""

import re
from pathlib import Path

import numpy as np

from mocap.io.columns import by_title
from mocap.io.contents import FileContents, pixel_recording, point_recording, table_recording
from mocap.io.csv_table import read_table
from mocap.io.dltdv_files import names_of, offsets, residuals
from mocap.io.format import Format, Hints
from mocap.io.head import Head

PIXEL = re.compile(r"(?P<name>.+)_cam_(?P<camera>\d+)_(?P<axis>[xy])")
POINT = re.compile(r"(?P<name>.+)(?P<axis>_[xyz])")
_INTERVAL = re.compile(r"(?P<name>.+)(?P<axis>_[xyz]_(lower|upper))")
_ENDS = ("_x_lower", "_x_upper", "_y_lower", "_y_upper", "_z_lower", "_z_upper")


def _pixels(path: Path, _hints: Hints) -> FileContents:
    expected = "names like track_cam_1_x"
    names, cameras, uv = by_title(path, read_table(path), PIXEL, ["x", "y"], expected=expected)
    return pixel_recording(
        path,
        "argus-xypts",
        names=names,
        cameras=[f"cam{camera}" for camera in cameras],
        uv_px=uv,
        pixel_origin="lower-left",
    )


def _points(path: Path, _hints: Hints) -> FileContents:
    names, _, (xyz,) = by_title(path, read_table(path), POINT, ["_x", "_y", "_z"], expected="names like track_x")
    return point_recording(path, "argus-xyzpts", names=names, xyz=xyz, unit=None)


def _intervals(path: Path, _hints: Hints) -> FileContents:
    names, _, (ends,) = by_title(path, read_table(path), _INTERVAL, _ENDS, expected="names like track_x_lower")
    told = (
        "with three or more cameras Argus may have shifted the pixels in time before it computed these points: "
        "triangulate them again"
    )
    half = {"interval": np.abs(ends[..., 1::2] - ends[..., ::2]) / 2}
    return table_recording(path, "argus-xyz-cis", names=names, tables=half, findings=(told,))


def _is_residuals(head: Head) -> bool:
    return head.path.name.lower().endswith("-xyzres.csv") and bool(head.cells())


def _is_intervals(head: Head) -> bool:
    return bool(head.cells()) and all(cell.endswith(_ENDS) for cell in head.cells())


FORMATS = (
    Format(
        name="argus-xypts",
        title="pixel tracks of Argus clicker (CSV)",
        knows=lambda head: bool(names_of(head, PIXEL)),
        read=_pixels,
    ),
    Format(
        name="argus-xyz-cis",
        title="95 % intervals of Argus (CSV)",
        knows=_is_intervals,
        read=_intervals,
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
        knows=_is_residuals,
        read=lambda path, _: residuals(path, "argus-xyzres", ""),
    ),
    Format(
        name="argus-xyzpts",
        title="points of Argus clicker (CSV)",
        knows=lambda head: bool(names_of(head, POINT)) and any(cell.endswith("_z") for cell in head.cells()),
        read=_points,
    ),
)
