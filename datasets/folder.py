"""A recording with its truth as files: the DLTdv set, the skeleton, the truth, and what other programs would write."""

import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import h5py
import numpy as np
from mocap.datasets.film import SyntheticRecording
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.cameras.camera import dlt_coefficients, stacked, undistorted
from mocap.cameras.lens import BrownLens
from mocap.cameras.triangulate import linear
from mocap.documents import damaged
from mocap.io.anipose import write_calibration
from mocap.io.c3d import write_c3d
from mocap.io.contents import FileContents
from mocap.io.csv_table import write_table
from mocap.io.dltdv import write_coefficients, write_pixels, write_points
from mocap.io.profile import write_profile
from mocap.records import MarkerTracks, Status, marker_tracks
from mocap.schema import Entry, Schema, checked, names
from mocap.skeleton import write_skeleton

_ITERATIONS = 3  # of undistortion, as DLTdv8 has it


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
    with h5py.File(path, "w", userblock_size=512) as file:
        parent = file.create_group("udExport")
        parent.attrs["MATLAB_class"] = np.bytes_(b"struct")
        data = parent.create_group("data")
        data.attrs["MATLAB_class"] = np.bytes_(b"struct")
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


_KINDS = {
    "pixels": "xypts.csv",
    "coefficients": "dltCoefs.csv",
    "profile": "camera_profile.txt",
    "offsets": "offsets.csv",
    "skeleton": "skeleton.toml",
    "truth": "truth.npz",
    "card": "card.json",
}
_OTHER_KINDS = {
    "calibration": "calibration.toml",
    "project": "dvProject.mat",
    "points": "xyzpts.csv",
    "c3d": "xyzpts.c3d",
}


def write_recording(recording: SyntheticRecording, folder: Path, *, others: bool = False) -> dict[str, Path]:
    """Write a recording into a folder, which is made if need be; files of the same names are replaced.

    The offsets say which frame of a camera shows the instant of a row, as DLTdv
    has them: below zero where the camera starts late, in fractions of frames. The truth holds ``names``, ``t_s``,
    ``xyz_m``, ``fps``, ``start_s``, ``occluded``, ``lost``, ``outlier`` and ``contact``, as in the record.

    Args:
        recording: What to write.
        folder: Where to.
        others: Whether to write the same as other programs do: a calibration of Anipose, a project of DLTdv8 (Brown
            lenses only), and positions triangulated linearly from the pixels as DLTdv's CSV and as C3D.

    Returns:
        Paths by kind: ``pixels``, ``coefficients``, ``profile`` (Brown lenses only: the format knows no other),
        ``offsets``, ``skeleton``, ``truth``, ``card``; of others ``calibration``, ``project``, ``points``, ``c3d``.
    """
    brown = all(isinstance(camera.lens, BrownLens) for camera in recording.cameras)
    kinds = dict(_KINDS)
    if others:
        kinds |= _OTHER_KINDS
    if not brown:
        for kind in ("profile", "project"):
            kinds.pop(kind, None)
    paths = {kind: folder / f"{recording.name}_{ending}" for kind, ending in kinds.items()}
    folder.mkdir(parents=True, exist_ok=True)
    n_cameras, n_frames = len(recording.cameras), len(recording.truth.t_s)
    write_pixels(paths["pixels"], recording.pixels)
    write_coefficients(paths["coefficients"], recording.cameras)
    titles = [f"cam{c}_offset" for c in range(1, n_cameras + 1)]
    write_table(paths["offsets"], titles, np.zeros((n_frames, n_cameras)) - recording.start_s * recording.fps)
    write_skeleton(paths["skeleton"], recording.skeleton)
    np.savez_compressed(
        paths["truth"],
        names=np.array(recording.truth.names),
        t_s=recording.truth.t_s,
        xyz_m=recording.truth.xyz_m,
        fps=np.array(recording.fps),
        start_s=recording.start_s,
        occluded=recording.occluded,
        lost=recording.lost,
        outlier=recording.outlier,
        contact=recording.contact,
    )
    paths["card"].write_text(json.dumps(recording.card, indent=2) + "\n", encoding="utf-8")
    if "profile" in paths:
        write_profile(paths["profile"], recording.cameras)
    if others:
        _write_others(recording, paths)
    return paths


def _write_others(recording: SyntheticRecording, paths: Mapping[str, Path]) -> None:
    write_calibration(paths["calibration"], recording.cameras)
    if "project" in paths:
        write_project(paths["project"], recording)
    names, t_s = recording.pixels.names, recording.pixels.t_s
    xyz_m = linear(stacked(recording.cameras), undistorted(recording.cameras, recording.pixels.uv_px))
    points = marker_tracks(names, t_s, xyz_m)
    write_points(paths["points"], points)
    frames = np.arange(1, len(t_s) + 1)
    file = FileContents(format="c3d", paths=(), names=names, frames=frames, fps=recording.fps, unit="mm", points=points)
    write_c3d(paths["c3d"], file)


_TRUTH: Schema = {
    "names": names("markers", filled=True),
    "t_s": Entry(shape=("frames",), rising=True),
    "xyz_m": Entry(shape=("frames", "markers", 3)),
}


def read_truth(path: Path) -> MarkerTracks:
    """The true markers of ``truth.npz``, complete, with zero covariance.

    Raises:
        FormatError: the file is not such a truth.
    """
    again = "it is not the truth of a synthetic recording: write it again"
    with damaged(f"{path}: cannot be read", again), np.load(path) as table:
        parts = {name: table[name] for name in _TRUTH}
    found = checked(str(path), parts, _TRUTH, again=again)
    xyz_m = found["xyz_m"]
    return MarkerTracks(
        names=tuple(found["names"]),
        t_s=found["t_s"],
        xyz_m=xyz_m,
        cov_m2=np.zeros((*xyz_m.shape, 3)),
        status=np.full(xyz_m.shape[:2], Status.MEASURED),
    )
