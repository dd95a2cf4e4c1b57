"""Writing DLTdv's flat CSV set, so that DLTdv opens it: xypts, xyzpts, xyzres and offsets, and the calibration."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from mocap.cameras.camera import dlt_coefficients
from mocap.cameras.lens import BrownLens
from mocap.errors import FormatError
from mocap.io.contents import FileContents
from mocap.io.csv_table import write_table
from mocap.io.dltdv import write_coefficients, write_pixels, write_points, write_residuals
from mocap.io.format import Format
from mocap.io.profile import write_profile

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
    knows=lambda _head: False,  # its files are formats of their own
    read=lambda path, _: _not_one(path),
    write=write_set,
    holds=frozenset({"pixels", "points", "cameras", "residual_px", "offset_frames"}),
    both=True,
    suffixes=_ENDS,
    files=lambda path, recording: list(set_files(path, recording).values()),
)


def _not_one(path: Path) -> FileContents:
    raise FormatError(f"{path.name}: dltdv is a set of files: name its files (dltdv-xypts, dltdv-xyzpts, ...)")
