"""DLTdv's files (Hedrick 2008; versions 5 to 8): the flat CSV set."""

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from eal.arrays import Array
from mocap.cameras.camera import Camera, dlt_camera, dlt_coefficients
from mocap.cameras.lens import BrownLens
from mocap.errors import FormatError
from mocap.io.contents import FileContents, calibration_recording, half_seen, pixel_recording, table_recording
from mocap.io.csv_table import by_title, decimals_in, decimals_of, first_cells, read_table, write_table
from mocap.io.format import Format, Head, Hints, file_format
from mocap.io.lines import is_number_row
from mocap.io.profile import write_profile
from mocap.records import BOTH, MarkerTracks, PixelCorner, PixelTracks, Status, marker_tracks

_PIXEL = re.compile(r"(?P<name>.+)_cam(?P<camera>\d+)(?P<axis>_[XYUVxyuv])")
_POINT = re.compile(r"(?P<name>.+)(?P<axis>_[XYZxyz]|_sd)")
_X, _Y = "_X _U _x _u", "_Y _V _y _v"


def read_pixels(path: Path, *, fps: float) -> PixelTracks:
    """Read ``xypts.csv``: columns ``<name>_cam<j>_X, _Y`` (version 8.4: ``_U, _V``), in any order.

    Frame n, the n-th row counted from 1, is at (n - 1) / fps seconds. Pixels are kept as the file has them.

    Raises:
        FormatError: the header or a cell is not that; the message names it.
    """
    names, cameras, uv = pixel_cells(path)
    return PixelTracks(names=names, cameras=cameras, t_s=np.arange(uv.shape[1]) / fps, uv_px=uv)


def pixel_cells(path: Path) -> tuple[tuple[str, ...], tuple[str, ...], Array]:
    """Markers, cameras and (C, T, M, 2) pixels of ``xypts.csv``, of which one may be there without the other."""
    expected = "names like pt1_cam1_X (DLTdv xypts): is this the 2D file?"
    names, cameras, uv = by_title(path, read_table(path), _PIXEL, [_X, _Y], expected=expected)
    return tuple(names), tuple(f"cam{c}" for c in cameras), uv


def holds_deviations(path: Path) -> bool:
    """Whether the first line names columns ``<name>_sd``, as only ``write_points`` writes them."""
    with path.open(encoding="utf-8", errors="replace") as stream:
        return any(title.strip().endswith("_sd") for title in stream.readline().split(","))


def write_pixels(path: Path, pixels: PixelTracks) -> None:
    """Write ``xypts.csv``: point-major, then camera, then X, Y; ``%.6f``, missing ``NaN``."""
    cameras = range(1, len(pixels.cameras) + 1)
    header = [f"{name}_cam{c}_{axis}" for name in pixels.names for c in cameras for axis in "XY"]
    write_table(path, header, np.transpose(pixels.uv_px, (1, 2, 0, 3)).reshape(len(pixels.t_s), -1))


def read_points(path: Path, *, fps: float) -> MarkerTracks:
    """Read ``xyzpts.csv``: columns ``<name>_X, _Y, _Z`` in metres; covariance unknown (NaN).

    Columns ``<name>_sd`` (written by ``write_points``) give an isotropic covariance.

    Raises:
        FormatError: the header or a cell is not that; the message names it.
    """
    return _tracks(*_point_cells(path), fps)


def _tracks(names: Sequence[str], table: Array, fps: float) -> MarkerTracks:
    xyz, sd = np.split(table, [3], axis=-1)
    xyz = np.where(np.isnan(xyz).any(axis=-1, keepdims=True), np.nan, xyz)
    return marker_tracks(names, np.arange(len(xyz)) / fps, xyz, cov_m2=sd[..., None] ** 2 * np.eye(3))


def _point_cells(path: Path) -> tuple[tuple[str, ...], Array]:
    """Markers and (T, M, 4) coordinates and standard deviations of ``xyzpts.csv``, as its cells are."""
    expected, axes = "names like pt1_X (DLTdv xyzpts)", [_X, _Y, "_Z _z", "_sd"]
    names, _, (table,) = by_title(path, read_table(path), _POINT, axes, expected=expected, spare=1)
    return tuple(names), table


def write_points(path: Path, tracks: MarkerTracks, *, sd: bool = False) -> None:
    """Write ``xyzpts.csv``: ``<name>_X, _Y, _Z`` and, if asked, ``_sd``; metres, missing ``NaN``.

    DLTdv writes ``%.6f``; more where the greatest coordinate would have less than seven digits (an animal under
    a microscope), and with ``_sd`` nine, or two digits of the smallest deviation.
    """
    header = [f"{name}_{axis}" for name in tracks.names for axis in (*"XYZ", *(["sd"] if sd else []))]
    blocks = [tracks.xyz_m, tracks.sd_m[..., None]] if sd else [tracks.xyz_m]
    decimals = max(6, decimals_in(tracks.xyz_m, digits=7))
    decimals = decimals_of(tracks.xyz_m, tracks.sd_m, least=max(9, decimals)) if sd else decimals
    write_table(path, header, np.concatenate(blocks, axis=-1).reshape(len(tracks.t_s), -1), decimals=decimals)


def write_residuals(path: Path, names: Sequence[str], residual_px: Array) -> None:
    """Write ``xyzres.csv``: (T, M) residuals sqrt(sum r^2 / (2 n_cameras - 3)) in pixels."""
    write_table(path, [f"{name}_dltres" for name in names], residual_px)


def names_cameras(titles: Sequence[str]) -> bool:
    """Whether a line of titles numbers the cameras from 1: ``cam1, cam2, ...`` or ``Camera 1, Camera 2, ...``."""
    return bool(titles) and all(
        re.fullmatch(rf"(camera|cam|view)[ _.#-]*0*{i}", title.strip(), re.IGNORECASE)
        for i, title in enumerate(titles, start=1)
    )


def read_coefficients(path: Path) -> tuple[Camera, ...]:
    """Read DLT coefficients: 11 rows, one column for each camera, with or without a line of camera titles.

    Raises:
        FormatError: the table has another shape, or a cell is not a number.
    """
    _, values = read_table(path, header=names_cameras(first_cells(path)))
    if values.shape[0] != 11:
        reason = {8: "8 rows are a 2D DLT, from which no 3D points can be computed"}.get(values.shape[0])
        if values.shape[1] == 11:
            reason = "it seems to be transposed"
        raise FormatError(
            f"{path.name}: {values.shape[0]} rows x {values.shape[1]} columns; expected DLT coefficients: 11 rows, "
            f"one column for each camera{f' ({reason})' if reason else ''}"
        )
    if np.isnan(values).any():
        row, column = np.argwhere(np.isnan(values))[0]
        raise FormatError(f"{path.name}: coefficient L{row + 1} of camera {column + 1} is missing: calibrate again")
    return tuple(dlt_camera(f"cam{i + 1}", values[:, i]) for i in range(values.shape[1]))


def write_coefficients(path: Path, cameras: Sequence[Camera]) -> None:
    """Write DLT coefficients: 11 rows, a column a camera; 12 digits, so that pixels keep 1e-6."""
    values = np.stack([dlt_coefficients(c) for c in cameras], axis=1)
    write_table(path, [], values, decimals=12)


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


@file_format(
    "dltdv-xypts",
    "pixel tracks of DLTdv (flat CSV)",
    _is_pixels,
    signs="csv pt1_cam1_X pt1_cam1_Y pt1_cam2_X table pixels",
)
def _pixels(path: Path, _hints: Hints) -> FileContents:
    (names, cameras, uv), origin = pixel_cells(path), _origin_beside(path)
    notes = ("the file does not record the corner that pixel rows are counted from",) if origin is None else ()
    parts = {"names": names, "cameras": cameras, "pixel_origin": origin, "findings": notes}
    return pixel_recording(path, "dltdv-xypts", uv_px=uv, **parts)


def _is_points(head: Head) -> bool:
    names = names_of(head, POINT)
    return bool(names) and (_numbered(names) or "xyzpts" in head.name or "xyzfilt" in head.name)


@file_format("dltdv-xyzpts", "points of DLTdv (flat CSV)", _is_points, signs="csv pt1_X pt1_Y pt1_Z table")
def _points(path: Path, _hints: Hints) -> FileContents:
    names, table = _point_cells(path)
    points = _tracks(names, table, 1.0)
    findings = half_seen(table[..., :3], names, 1 + np.arange(len(table)))
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
    note = ahead(values[np.isfinite(values)]) or "the offsets of all cameras are 0"
    cameras = tuple(f"cam{number}" for number in numbers)
    return table_recording(path, format, camera_names=cameras, tables={"offset_frames": values}, findings=(note,))


def ahead(offset_frames: np.ndarray) -> str:
    """By how many frames cameras are offset, in words; empty: by none."""
    if not offset_frames.any():
        return ""
    return f"cameras are offset by {offset_frames.min():g} to {offset_frames.max():g} frames"


def _is_coefficients(head: Head) -> bool:
    rows = [line for line in head.lines if line.strip()]
    titled = names_cameras(head.cells())
    return len(rows) - titled in (8, 11) and (titled or is_number_row(head.cells())) and len(head.cells()) <= 100


def ends(*words: str) -> Callable[[Head], bool]:
    """Whether every title ends with one of some words."""
    return lambda head: bool(head.cells()) and all(cell.endswith(words) for cell in head.cells())


DLTDV_XYZRES = Format(
    name="dltdv-xyzres",
    title="triangulation residuals of DLTdv (flat CSV)",
    knows=ends("_dltres"),
    read=lambda path, _: residuals(path, "dltdv-xyzres", "_dltres"),
)
DLTDV_XYZCI = Format(
    name="dltdv-xyzci", title="95 % intervals of DLTdv (flat CSV)", knows=ends("+-CI"), read=_intervals
)
DLTDV_OFFSETS = Format(
    name="dltdv-offsets",
    title="camera offsets of DLTdv (flat CSV)",
    knows=lambda head: bool(head.cells()) and all(re.fullmatch(r"cam\d+_offset", cell) for cell in head.cells()),
    read=lambda path, _: offsets(path, "dltdv-offsets", r"cam(\d+)_offset"),
)
DLTDV_COEFFICIENTS = Format(
    name="dltdv-coefficients",
    title="DLT coefficients (CSV, 11 rows, one column for each camera)",
    knows=_is_coefficients,
    read=lambda path, _: calibration_recording(path, "dltdv-coefficients", read_coefficients(path)),
    signs="csv table numbers eleven-rows",
)


_ENDS = ("xypts.csv", "xyzpts.csv", "dltCoefs.csv")
_SMALLEST = 1e-6
"""The last digit that is written; DLTdv takes 0 as missing."""


def set_files(path: Path, recording: FileContents) -> dict[str, Path]:
    """The files that ``write_set`` writes, by what they hold."""
    name = next((path.name[: -len(end)] for end in _ENDS if path.name.lower().endswith(end.lower())), None)
    prefix = f"{path.stem}_" if name is None else name
    kinds = {}
    if recording.pixels is not None:
        kinds = {kind: f"{kind}.csv" for kind in ("xypts", "xyzpts", "xyzres", "offsets")}
        if recording.points is None or not recording.points.seen.any():
            del kinds["xyzpts"]
        if not np.isfinite(recording.tables.get("residual_px", np.nan)).any():
            del kinds["xyzres"]
    elif recording.points is not None:
        kinds = {"xyzpts": "xyzpts.csv"}
    if recording.cameras:
        kinds["dltCoefs"] = "dltCoefs.csv"
    # whether a camera profile can say the lenses
    lenses = [camera.lens for camera in recording.cameras]
    sized = all(camera.size_px is not None for camera in recording.cameras)
    if sized and bool(lenses) and all(isinstance(lens, BrownLens) for lens in lenses):
        kinds["profile"] = "profile.txt"
    return {kind: path.with_name(prefix + end) for kind, end in kinds.items()}


def write_set(path: Path, recording: FileContents) -> list[str]:
    """Write all files of the set beside each other; lengths in metres, or in the recording's unknown unit.

    Raises:
        FormatError: a camera has no DLT coefficients.
    """
    files, remarks = set_files(path, recording), []
    for camera in recording.cameras:
        try:
            dlt_coefficients(camera)
        except ValueError as error:
            raise FormatError(f"{path.name}: {error}") from None
    shape = (len(recording.frames), len(recording.names))
    if recording.pixels is not None:
        corner = (np.abs(recording.pixels.uv_px) < _SMALLEST / 2).all(axis=-1, keepdims=True)
        uv = np.where(corner, _SMALLEST, recording.pixels.uv_px)  # DLTdv takes 0 as missing
        write_pixels(files["xypts"], replace(recording.pixels, uv_px=uv))
        offsets = recording.tables.get("offset_frames", np.zeros((shape[0], len(recording.camera_names))))
        write_table(files["offsets"], [f"cam{c + 1}_offset" for c in range(offsets.shape[1])], offsets)
        if "xyzres" in files:
            write_residuals(files["xyzres"], recording.names, recording.tables["residual_px"])
        if "xyzpts" not in files:
            remarks.append("no xyzpts file: there are no 3D points yet; mocap triangulate writes them")
    if recording.points is not None and "xyzpts" in files:
        xyz = recording.points.xyz_m
        zero = np.abs(xyz) < _SMALLEST / 2
        if zero.any():
            remarks.append(f"{zero.sum()} coordinates of 0 are written as {_SMALLEST:.6f}: DLTdv takes 0 as missing")
        write_points(files["xyzpts"], replace(recording.points, xyz_m=np.where(zero, _SMALLEST, xyz)))
        if recording.unit is not None:
            remarks.append("lengths are written in metres, to a micrometre")
    if recording.cameras:
        write_coefficients(files["dltCoefs"], recording.cameras)
    if "profile" in files:
        write_profile(files["profile"], recording.cameras)
    elif any(camera.lens is not None for camera in recording.cameras):
        remarks.append(
            "not written: the lenses of the cameras, because not all are Brown lenses with a known image size"
        )
    remarks.append("written: " + ", ".join(file.name for file in files.values()))
    return remarks


DLTDV = Format(
    name="dltdv",
    title="DLTdv's flat CSV set",
    knows=lambda _head: False,
    is_set=True,
    read=lambda path, _: _not_one(path),
    write=write_set,
    holds=frozenset({"pixels", "points", "cameras", "residual_px", "offset_frames"}),
    both=True,
    suffixes=_ENDS,
    files=lambda path, recording: list(set_files(path, recording).values()),
)


def _not_one(path: Path) -> FileContents:
    raise FormatError(f"{path.name}: dltdv is a set of files: name its files (dltdv-xypts, dltdv-xyzpts, ...)")
