"""Project files of DLTdv8 (``*dvProject.mat``: MATLAB 7.3, which is HDF5)."""

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from eal.arrays import Array
from mocap.cameras.camera import Camera, dlt_camera
from mocap.documents import damaged
from mocap.errors import FormatError
from mocap.io.apart import check_bytes
from mocap.io.contents import FileContents, pixel_recording
from mocap.io.dltdv import ahead
from mocap.io.easywand import is_tdata, lens_of
from mocap.io.format import Hints, file_format
from mocap.io.lines import rate
from mocap.records import marker_tracks

_DATA = "udExport/data"


@file_format(
    "dltdv-project",
    "project of DLTdv8 (MATLAB 7.3)",
    lambda head: "udExport" in head.hdf5,
    signs="hdf5 udExport data xypts dltpts",
)
def read_project(path: Path, _hints: Hints) -> FileContents:
    """Pixels as digitised, row n frame n of the first camera; points as DLTdv once computed them, some stale.

    Raises:
        FormatError: the file is no such project, or its parts contradict each other.
    """
    if not path.is_file():
        raise FormatError(f"{path}: cannot be read: no such file")
    import h5py

    advice = f"expected MATLAB 7.3 with {_DATA}; save it again"
    with damaged(f"{path.name}: not a readable project of DLTdv8", advice), h5py.File(path, "r") as file:
        return _project(path, file)


def _project(path: Path, file: Any) -> FileContents:
    data: Any = file[_DATA]
    cameras_n, markers_n = int(data["nvid"][0, 0]), int(data["numpts"][0, 0])
    fps, findings = None, []
    with suppress(FormatError):
        fps = rate(path, np.ravel(data["movFrameRates"][()])[0])
    uv = _sparse(path, data, "xypts", 2 * cameras_n * markers_n, missing=np.nan)
    xyz = _sparse(path, data, "dltpts", 3 * markers_n, missing=np.nan).reshape(-1, markers_n, 3)
    xyz[np.isnan(xyz).any(axis=-1)] = np.nan
    if len(xyz) != len(uv):
        raise FormatError(f"{path.name}: {len(uv)} frames of pixels, {len(xyz)} of points: save the project again")
    cameras, offset = _cameras(path, file, data, cameras_n), _sparse(path, data, "offset", cameras_n, missing=0.0)
    findings += [] if cameras else ["the project has no DLT coefficients"]
    found = pixel_recording(
        path,
        "dltdv-project",
        names=_names(path, file, data, markers_n),
        cameras=[f"cam{c + 1}" for c in range(cameras_n)],
        uv_px=np.transpose(uv.reshape(-1, markers_n, cameras_n, 2), (2, 0, 1, 3)),
        fps=fps,
        calibration=cameras,
        pixel_origin="upper-left",
        playback=fps is not None,
        tables={"offset_frames": offset},
        findings=(*findings, *filter(None, [ahead(offset)])),
    )
    assert found.pixels is not None
    return replace(found, points=marker_tracks(found.names, found.pixels.t_s, xyz))


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


def _cameras(path: Path, file: Any, data: Any, count: int) -> tuple[Camera, ...]:
    """Cameras; none without coefficients."""
    coefficients = data["dltcoef"]
    if coefficients.attrs.get("MATLAB_empty", 0):
        return ()
    if coefficients.shape != (count, 11) or not np.isfinite(coefficients[()]).all():
        raise FormatError(
            f"{path.name}: DLT coefficients of shape {coefficients.shape[::-1]}; expected 11 finite numbers for each "
            f"of {count} cameras: load them again in DLTdv and save the project"
        )
    lenses = [_tdata(path, file, data, camera) for camera in range(count)]
    iterations = {int(lens[9]) for lens in lenses if lens is not None}
    if len(iterations) > 1:
        raise FormatError(
            f"{path.name}: cameras are undistorted with {sorted(iterations)} iterations; expected one number"
        )
    sizes = data["movsizes"][()].T.astype(int)[:, ::-1]
    cameras = []
    for c, (row, lens) in enumerate(zip(coefficients[()], lenses, strict=True)):
        camera = dlt_camera(f"cam{c + 1}", row, lens=None if lens is None else lens_of(lens))
        cameras.append(replace(camera, size_px=(int(sizes[c][0]), int(sizes[c][1]))))
    return tuple(cameras)


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
