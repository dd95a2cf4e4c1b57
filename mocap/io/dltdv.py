"""DLTdv's flat CSV set (Hedrick 2008; versions 5 to 8): xypts, xyzpts, xyzres and DLT coefficients."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from eal.arrays import Array
from mocap.cameras.camera import Camera, dlt_camera, dlt_coefficients
from mocap.errors import FormatError
from mocap.io.columns import by_title
from mocap.io.csv_table import decimals_in, decimals_of, first_cells, read_table, write_table
from mocap.records import MarkerTracks, PixelTracks, marker_tracks

_PIXEL = re.compile(r"(?P<name>.+)_cam(?P<camera>\d+)(?P<axis>_[XYUVxyuv])")
_POINT = re.compile(r"(?P<name>.+)(?P<axis>_[XYZxyz]|_sd)")
_X, _Y = "_X _U _x _u", "_Y _V _y _v"


def read_pixels(path: Path, *, fps: float) -> PixelTracks:
    """Read ``xypts.csv``: columns ``<name>_cam<j>_X, _Y`` (version 8.4: ``_U, _V``), in any order.

    Frame n, the n-th row counted from 1, is at (n - 1) / fps seconds. Pixels are kept as the file has them.

    Raises:
        FormatError: the header or a cell is not that; the message names it.
    """
    expected = "names like pt1_cam1_X (DLTdv xypts): is this the 2D file?"
    names, cameras, uv = by_title(path, read_table(path), _PIXEL, [_X, _Y], expected=expected)
    t_s = np.arange(uv.shape[1]) / fps
    return PixelTracks(names=names, cameras=tuple(f"cam{c}" for c in cameras), t_s=t_s, uv_px=uv)


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
    expected, axes = "names like pt1_X (DLTdv xyzpts)", [_X, _Y, "_Z _z", "_sd"]
    names, _, (table,) = by_title(path, read_table(path), _POINT, axes, expected=expected, spare=1)
    xyz, sd = np.split(table, [3], axis=-1)
    xyz = np.where(np.isnan(xyz).any(axis=-1, keepdims=True), np.nan, xyz)
    return marker_tracks(names, np.arange(len(xyz)) / fps, xyz, cov_m2=sd[..., None] ** 2 * np.eye(3))


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
