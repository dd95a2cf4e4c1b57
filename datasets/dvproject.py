"""A recording as a project of DLTdv8: what MATLAB 7.3 and DLTdv put around the numbers, and the numbers."""

import time
from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np
from mocap.datasets.recording import SyntheticRecording
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.cameras.camera import dlt_coefficients, stacked, undistorted
from mocap.cameras.lens import BrownLens
from mocap.cameras.triangulate import linear

_ITERATIONS = 3
_USER_BLOCK = 512


def write_project(path: Path, recording: SyntheticRecording) -> None:
    """Write ``udExport/data`` of a ``dvProject.mat`` as DLTdv8 does: the pixels, cameras, lenses, and its own points.

    Points are triangulated as DLTdv would, linearly after three iterations of undistortion. Video and window settings,
    which only DLTdv itself needs, are left out.

    Args:
        path: A new file.
        recording: With Brown lenses, which are all that DLTdv knows.

    Raises:
        ValueError: a lens of another kind.
    """
    cameras, pixels = recording.cameras, recording.pixels
    for camera in cameras:
        if not isinstance(camera.lens, BrownLens) or camera.size_px is None:
            raise ValueError(f"camera {camera.name!r}: a DLTdv8 project holds Brown lenses and image sizes only")
    n_cameras, n_frames, n_markers = pixels.seen.shape
    ideal = undistorted(cameras, pixels.uv_px, iterations=_ITERATIONS)
    xyz_m = linear(stacked(cameras), ideal)
    with h5py.File(path, "w", userblock_size=_USER_BLOCK) as file:
        data = _struct(file.create_group("udExport"), "data")
        for name, value in {"nvid": n_cameras, "numpts": n_markers, "dlt": 1, "sp": 1}.items():
            _double(data, name, np.array([[float(value)]]))
        _double(data, "movFrameRates", np.full((n_cameras, 1), recording.fps))
        _double(data, "movsizes", np.array([c.size_px for c in cameras if c.size_px], dtype=float)[:, ::-1].T)
        _double(data, "dltcoef", np.stack([dlt_coefficients(c) for c in cameras]))
        _sparse(data, "xypts", np.transpose(pixels.uv_px, (1, 2, 0, 3)).reshape(n_frames, -1))
        _sparse(data, "dltpts", xyz_m.reshape(n_frames, -1))
        _sparse(data, "offset", np.zeros((n_frames, n_cameras)) - recording.start_s * recording.fps)
        lenses = [(*c.lens.f_px, *c.lens.centre_px, *c.lens.coefficients) for c in cameras if c.lens]
        _cells(data, "camud", [np.array([[*lens, _ITERATIONS]]).T for lens in lenses], field="tdata")
        _cells(data, "pointNames", [np.array([list(map(ord, name))], dtype=np.uint16).T for name in pixels.names])
    with path.open("r+b") as stream:
        head = f"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: {time.asctime(time.gmtime(0))} HDF5 schema 1.00 ."
        stream.write(head.encode().ljust(116) + bytes(8) + b"\x00\x02IM")


def _struct(parent: h5py.Group, name: str) -> h5py.Group:
    parent.attrs["MATLAB_class"] = np.bytes_(b"struct")
    group = parent.create_group(name)
    group.attrs["MATLAB_class"] = np.bytes_(b"struct")
    return group


def _double(parent: h5py.Group, name: str, transposed: Array) -> None:
    """A matrix; HDF5 holds MATLAB's columns as rows."""
    parent[name] = transposed
    parent[name].attrs["MATLAB_class"] = np.bytes_(b"double")


def _sparse(parent: h5py.Group, name: str, table: Array) -> None:
    """A sparse matrix in compressed columns; what is NaN is absent."""
    group = parent.create_group(name)
    group.attrs["MATLAB_class"] = np.bytes_(b"double")
    group.attrs["MATLAB_sparse"] = np.uint64(len(table))
    kept = np.isfinite(table) & (table != 0)
    group["jc"] = np.append(0, np.cumsum(kept.sum(axis=0))).astype(np.uint64)
    if kept.any():
        group["ir"] = np.nonzero(kept.T)[1].astype(np.uint64)
        group["data"] = table.T[kept.T]


def _cells(parent: h5py.Group, name: str, values: Sequence[NDArray], *, field: str | None = None) -> None:
    """A cell array of character rows, or of structs with one field of numbers."""
    references = []
    for i, value in enumerate(values):
        where = parent.file.require_group("#refs#")
        key = f"{name}{i + 1}"
        if field is None:
            where[key] = value
            where[key].attrs["MATLAB_class"] = np.bytes_(b"char")
            where[key].attrs["MATLAB_int_decode"] = np.int32(2)
        else:
            struct = where.create_group(key)
            struct.attrs["MATLAB_class"] = np.bytes_(b"struct")
            _double(struct, field, value)
        references.append(where[key].ref)
    parent.create_dataset(name, data=np.array(references, dtype=h5py.ref_dtype).reshape(-1, 1), dtype=h5py.ref_dtype)
    parent[name].attrs["MATLAB_class"] = np.bytes_(b"cell")
