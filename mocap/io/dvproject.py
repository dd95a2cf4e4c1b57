"""Project files of DLTdv8 (``*dvProject.mat``: MATLAB 7.3, which is HDF5)."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from eal.arrays import Array
from mocap.cameras.camera import Camera, dlt_camera
from mocap.documents import damaged
from mocap.errors import FormatError
from mocap.io.bounds import check_bytes
from mocap.io.easywand import is_tdata, lens_of
from mocap.io.optical import rate
from mocap.records import MarkerTracks, PixelTracks, marker_tracks

_DATA = "udExport/data"


@dataclass(frozen=True, eq=False, kw_only=True)
class DvProject:
    """What a DLTdv8 project holds.

    Attributes:
        pixels: Pixels as digitised, rows counted from the upper left; row n is frame n of the first camera.
        cameras: The C cameras with their lenses and sizes; empty where the project has no DLT coefficients.
        undistort_iterations: What ``mocap.cameras.camera.undistorted`` needs to undistort as DLTdv did.
        stored: Points as DLTdv computed them at some time: some are stale, pixels were edited later.
        fps: Frames a second of the first camera.
        offset_frames: (T, C) frames by which each camera is ahead; 0 where synchronous.
    """

    pixels: PixelTracks
    cameras: tuple[Camera, ...]
    undistort_iterations: int
    stored: MarkerTracks
    fps: float
    offset_frames: Array


def read_project(path: Path, *, fps: float | None = None) -> DvProject:
    """Read a project file, at ``fps`` frames a second (None: as the file says, which may be the rate of playback).

    Raises:
        FormatError: the file is no such project, or its parts contradict each other.
    """
    if not path.is_file():
        raise FormatError(f"{path}: cannot be read: no such file")
    import h5py

    advice = f"expected MATLAB 7.3 with {_DATA}; save it again"
    with damaged(f"{path.name}: not a readable project of DLTdv8", advice), h5py.File(path, "r") as file:
        return _project(path, file, fps)


def _project(path: Path, file: Any, fps: float | None) -> DvProject:
    data: Any = file[_DATA]
    cameras_n, markers_n = int(data["nvid"][0, 0]), int(data["numpts"][0, 0])
    fps = rate(path, np.ravel(data["movFrameRates"][()])[0] if fps is None else fps)
    uv = _sparse(path, data, "xypts", 2 * cameras_n * markers_n, missing=np.nan)
    xyz = _sparse(path, data, "dltpts", 3 * markers_n, missing=np.nan).reshape(-1, markers_n, 3)
    xyz[np.isnan(xyz).any(axis=-1)] = np.nan
    if len(xyz) != len(uv):
        raise FormatError(f"{path.name}: {len(uv)} frames of pixels, {len(xyz)} of points: save the project again")
    names, t_s = _names(path, file, data, markers_n), np.arange(len(uv)) / fps
    cameras, iterations = _cameras(path, file, data, cameras_n)
    return DvProject(
        pixels=PixelTracks(
            names=names,
            cameras=tuple(f"cam{c + 1}" for c in range(cameras_n)),
            t_s=t_s,
            uv_px=np.transpose(uv.reshape(-1, markers_n, cameras_n, 2), (2, 0, 1, 3)),
        ),
        cameras=cameras,
        undistort_iterations=iterations,
        stored=marker_tracks(names, t_s, xyz),
        fps=fps,
        offset_frames=_sparse(path, data, "offset", cameras_n, missing=0.0),
    )


def _sparse(path: Path, data: Any, name: str, columns: int, *, missing: float) -> Array:
    """A MATLAB sparse matrix (compressed columns) as a dense one; what is absent or 0 is ``missing``."""
    import h5py

    group = data[name]
    if isinstance(group, h5py.Dataset):
        dense = np.zeros((0, columns)) if group.attrs.get("MATLAB_empty", 0) else group[()].T.astype(np.float64)
        if dense.shape[1] != columns:
            raise FormatError(f"{path.name}: {name} has {dense.shape[1]} columns, expected {columns}: save it again")
        return np.where(dense == 0, missing, dense)
    rows, ends = int(group.attrs["MATLAB_sparse"]), group["jc"][()].astype(np.int64)
    values = group["data"][()] if "data" in group else np.zeros(0)
    row = group["ir"][()].astype(np.int64) if "ir" in group else np.zeros(0, dtype=np.int64)
    if len(ends) != columns + 1:
        raise FormatError(f"{path.name}: {name} has {len(ends) - 1} columns, expected {columns}: save it again")
    whole = (np.diff(ends) >= 0).all() and ends[0] == 0 and ends[-1] == len(values) == len(row)
    if not whole or (len(row) and (row.min() < 0 or row.max() >= rows)):
        raise FormatError(f"{path.name}: the sparse matrix {name} contradicts its own size: save the project again")
    check_bytes(path, 8 * rows * columns, f"the sparse matrix {name}")
    dense = np.full((rows, columns), missing)
    dense[row, np.repeat(np.arange(columns), np.diff(ends))] = np.where(values == 0, missing, values)
    return dense


def _names(path: Path, file: Any, data: Any, count: int) -> tuple[str, ...]:
    """Names of version 8.4; ``pt1``, ``pt2``, ... where there are none."""
    import h5py

    plain = tuple(f"pt{m + 1}" for m in range(count))
    if "pointNames" not in data or data["pointNames"].dtype != h5py.ref_dtype:
        return plain
    cells: list[Any] = [file[reference] for reference in np.ravel(data["pointNames"][()])]
    names = ["".join(map(chr, np.ravel(cell[()]))) if cell.dtype.kind == "u" else "" for cell in cells]
    names = [name.strip() for name in names]
    if len(names) != count:
        raise FormatError(f"{path.name}: {len(names)} pointNames for {count} points: save the project again")
    return tuple(name or plain[m] for m, name in enumerate(names))


def _cameras(path: Path, file: Any, data: Any, count: int) -> tuple[tuple[Camera, ...], int]:
    """Cameras (none without coefficients) and the iterations of DLTdv's undistortion."""
    coefficients = data["dltcoef"]
    if coefficients.attrs.get("MATLAB_empty", 0):
        return (), 3
    if coefficients.shape != (count, 11) or not np.isfinite(coefficients[()]).all():
        raise FormatError(
            f"{path.name}: DLT coefficients of shape {coefficients.shape[::-1]}; expected 11 finite numbers for each "
            f"of {count} cameras: load them again in DLTdv and save the project"
        )
    lenses = [_tdata(path, file, data, camera) for camera in range(count)]
    iterations = {int(lens[9]) for lens in lenses if lens is not None} or {3}
    if len(iterations) > 1:
        raise FormatError(
            f"{path.name}: cameras are undistorted with {sorted(iterations)} iterations; expected one number"
        )
    sizes = data["movsizes"][()].T.astype(int)[:, ::-1]
    cameras = []
    for c, (row, lens) in enumerate(zip(coefficients[()], lenses, strict=True)):
        camera = dlt_camera(f"cam{c + 1}", row, lens=None if lens is None else lens_of(lens))
        cameras.append(replace(camera, size_px=(int(sizes[c][0]), int(sizes[c][1]))))
    return tuple(cameras), iterations.pop()


def _tdata(path: Path, file: Any, data: Any, camera: int) -> Array | None:
    """The ten numbers of a camera's lens (fx fy cx cy k1 k2 p1 p2 k3 iterations); None without one."""
    import h5py

    if "camud" not in data or data["camud"].dtype != h5py.ref_dtype:
        return None
    struct: Any = file[np.ravel(data["camud"][()])[camera]]
    tdata: Any = struct["tdata"] if hasattr(struct, "keys") and "tdata" in struct else None
    if tdata is None:
        return None
    values: Array = np.ravel(tdata[()])
    if not is_tdata(values):
        raise FormatError(
            f"{path.name}: lens of camera {camera + 1} is {values}; expected fx fy cx cy k1 k2 p1 p2 k3 iterations"
        )
    return values
