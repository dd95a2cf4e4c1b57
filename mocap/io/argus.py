"""Argus clicker's CSV set (Jackson et al. 2016): columns are found by name, never by position."""

import re
from pathlib import Path

import numpy as np

from mocap.errors import FormatError
from mocap.io.contents import FileContents, pixel_recording, point_recording
from mocap.io.csv_table import read_table
from mocap.io.dltdv_files import names_of, offset_recording, table_recording
from mocap.io.format import Format, Hints
from mocap.io.head import Head

PIXEL = re.compile(r"(?P<name>.+)_cam_(?P<camera>\d+)_(?P<axis>[xy])")
POINT = re.compile(r"(?P<name>.+)_(?P<axis>[xyz])")
_ENDS = ("_x_lower", "_x_upper", "_y_lower", "_y_upper", "_z_lower", "_z_upper")


def _pixels(path: Path, _hints: Hints) -> FileContents:
    header, values = read_table(path)
    where: dict[tuple[str, int, str], int] = {}
    for column, title in enumerate(header):
        match = PIXEL.fullmatch(title)
        if match is None:
            raise FormatError(f"{path.name}: column {column + 1} is {title!r}; expected names like track_cam_1_x")
        key = (match["name"], int(match["camera"]), match["axis"])
        if key in where:
            raise FormatError(f"{path.name}: column {title} appears twice: rename one track")
        where[key] = column
    names = list(dict.fromkeys(name for name, _, _ in where))
    cameras = sorted({camera for _, camera, _ in where})
    keys = [(name, camera, axis) for camera in cameras for name in names for axis in "xy"]
    lacking = next((key for key in keys if key not in where), None)
    if lacking is not None:
        raise FormatError(
            f"{path.name}: no column {lacking[0]}_cam_{lacking[1]}_{lacking[2]}; expected x and y of every track "
            "in every camera: add it, empty where nothing was seen"
        )
    uv = values[:, [where[key] for key in keys]].reshape(len(values), len(cameras), len(names), 2)
    return pixel_recording(
        path,
        "argus-xypts",
        names=names,
        cameras=[f"cam{camera}" for camera in cameras],
        uv_px=np.moveaxis(uv, 1, 0),
        pixel_origin="lower-left",
    )


def _points(path: Path, _hints: Hints) -> FileContents:
    names, xyz = xyz_columns(path, *read_table(path), ends=("_x", "_y", "_z"))
    return point_recording(
        path,
        "argus-xyzpts",
        names=names,
        xyz=xyz,
        unit=None,
    )


def xyz_columns(
    path: Path, header: list[str], values: np.ndarray, *, ends: tuple[str, ...]
) -> tuple[list[str], np.ndarray]:
    """Names, and (T, M, len(ends)) values, of columns ``<name><end>`` in any order.

    Raises:
        FormatError: another column is there, one is missing, or one appears twice.
    """
    where: dict[str, int] = {}
    names: dict[str, None] = {}
    for column, title in enumerate(header):
        end = next((end for end in ends if title.endswith(end) and len(title) > len(end)), None)
        if end is None or title in where:
            trouble = "appears twice" if end else f"is not one of <name>{', <name>'.join(ends)}"
            raise FormatError(f"{path.name}: column {column + 1}, {title!r}, {trouble}: correct the header")
        where[title] = column
        names[title.removesuffix(end)] = None
    lacking = next((name + end for name in names for end in ends if name + end not in where), None)
    if lacking is not None:
        raise FormatError(
            f"{path.name}: no column {lacking}; expected <name>{', <name>'.join(ends)} of each point: add it, or "
            "rename what is none of a point"
        )
    order = [where[name + end] for name in names for end in ends]
    return list(names), values[:, order].reshape(len(values), len(names), len(ends))


def _intervals(path: Path, _hints: Hints) -> FileContents:
    names, ends = xyz_columns(path, *read_table(path), ends=_ENDS)
    return FileContents(
        format="argus-xyz-cis",
        paths=(path,),
        names=tuple(names),
        frames=1 + np.arange(len(ends)),
        tables={"interval": np.abs(ends[..., 1::2] - ends[..., ::2]) / 2},
        findings=(
            "with three or more cameras Argus may have shifted the pixels in time before it computed these points: "
            "triangulate them again",
        ),
    )


def _residuals(path: Path, _hints: Hints) -> FileContents:
    recording = table_recording(path, "argus-xyzres", "residual_px", ("",))
    return recording


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
        read=lambda path, _: offset_recording(path, "argus-offsets", r"camera_(\d+)"),
    ),
    Format(
        name="argus-xyzres",
        title="triangulation residuals of Argus (CSV named ...-xyzres.csv)",
        knows=_is_residuals,
        read=_residuals,
    ),
    Format(
        name="argus-xyzpts",
        title="points of Argus clicker (CSV)",
        knows=lambda head: bool(names_of(head, POINT)) and any(cell.endswith("_z") for cell in head.cells()),
        read=_points,
    ),
)
