"""Argus (Jackson et al. 2016): the flat CSV files of its clicker."""

import re
from pathlib import Path

import numpy as np

from mocap.io.contents import FileContents, pixel_recording, point_recording, table_recording
from mocap.io.csv_table import by_title, read_table
from mocap.io.dltdv import ends, names_of, offsets, residuals
from mocap.io.format import Format, Hints, file_format

ARGUS_PIXEL = re.compile(r"(?P<name>.+)_cam_(?P<camera>\d+)_(?P<axis>[xy])")
_ARGUS_POINT = re.compile(r"(?P<name>.+)(?P<axis>_[xyz])")
_ARGUS_INTERVAL = re.compile(r"(?P<name>.+)(?P<axis>_[xyz]_(lower|upper))")
_ARGUS_ENDS = ("_x_lower", "_x_upper", "_y_lower", "_y_upper", "_z_lower", "_z_upper")


@file_format(
    "argus-xypts",
    "pixel tracks of Argus clicker (CSV)",
    lambda head: bool(names_of(head, ARGUS_PIXEL)),
    signs="csv cam_1_x cam_1_y table pixels",
)
def _argus_pixels(path: Path, _hints: Hints) -> FileContents:
    expected = "names like track_cam_1_x"
    names, numbers, uv = by_title(path, read_table(path), ARGUS_PIXEL, ["x", "y"], expected=expected)
    cameras = [f"cam{number}" for number in numbers]
    return pixel_recording(path, "argus-xypts", names=names, cameras=cameras, uv_px=uv, pixel_origin="lower-left")


@file_format("argus-xyz-cis", "95 % intervals of Argus (CSV)", ends(*_ARGUS_ENDS))
def _argus_intervals(path: Path, _hints: Hints) -> FileContents:
    names, _, (limits,) = by_title(
        path, read_table(path), _ARGUS_INTERVAL, _ARGUS_ENDS, expected="names like track_x_lower"
    )
    note = (
        "with three or more cameras Argus may have shifted the pixels in time before it computed these points: "
        "triangulate them again"
    )
    half = {"interval": np.abs(limits[..., 1::2] - limits[..., ::2]) / 2}
    return table_recording(path, "argus-xyz-cis", names=names, tables=half, findings=(note,))


ARGUS_OFFSETS = Format(
    name="argus-offsets",
    title="camera offsets of Argus (CSV)",
    knows=lambda head: bool(head.cells()) and all(re.fullmatch(r"camera_\d+", cell) for cell in head.cells()),
    read=lambda path, _: offsets(path, "argus-offsets", r"camera_(\d+)"),
)
ARGUS_XYZRES = Format(
    name="argus-xyzres",
    title="triangulation residuals of Argus (CSV named ...-xyzres.csv)",
    knows=lambda head: head.name.endswith("-xyzres.csv") and bool(head.cells()),
    read=lambda path, _: residuals(path, "argus-xyzres", ""),
)


@file_format(
    "argus-xyzpts",
    "points of Argus clicker (CSV)",
    lambda head: bool(names_of(head, _ARGUS_POINT)) and any(cell.endswith("_z") for cell in head.cells()),
    any_names=True,
)
def _argus_points(path: Path, _hints: Hints) -> FileContents:
    names, _, (xyz,) = by_title(path, read_table(path), _ARGUS_POINT, ["_x", "_y", "_z"], expected="names like track_x")
    return point_recording(path, "argus-xyzpts", names=names, xyz=xyz, unit=None)
