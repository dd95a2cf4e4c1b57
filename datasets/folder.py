"""A recording with its truth as files: the DLTdv set, the skeleton, the truth, and what other programs would write."""

import json
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from mocap.datasets.dvproject import write_project
from mocap.datasets.recording import SyntheticRecording

from mocap.cameras.camera import stacked, undistorted
from mocap.cameras.lens import BrownLens
from mocap.cameras.triangulate import linear
from mocap.documents import one_line
from mocap.errors import FormatError
from mocap.io.anipose import write_calibration
from mocap.io.c3d import write_c3d
from mocap.io.contents import FileContents
from mocap.io.csv_table import write_table
from mocap.io.dltdv import write_coefficients, write_pixels, write_points
from mocap.io.profile import write_profile
from mocap.records import MarkerTracks, Status, marker_tracks
from mocap.schema import Entry, Schema, checked, names
from mocap.skeleton import write_skeleton

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
    _write(recording, paths)
    if "profile" in paths:
        write_profile(paths["profile"], recording.cameras)
    if others:
        _write_others(recording, paths)
    return paths


def _write(recording: SyntheticRecording, paths: Mapping[str, Path]) -> None:
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


def _write_others(recording: SyntheticRecording, paths: Mapping[str, Path]) -> None:
    """What other programs would have written of the same pixels."""
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
    try:
        with np.load(path) as table:
            parts = {name: table[name] for name in _TRUTH}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise FormatError(f"{path}: {one_line(error)}: {again}") from None
    found = checked(str(path), parts, _TRUTH, again=again)
    xyz_m = found["xyz_m"]
    return MarkerTracks(
        names=tuple(found["names"]),
        t_s=found["t_s"],
        xyz_m=xyz_m,
        cov_m2=np.zeros((*xyz_m.shape, 3)),
        status=np.full(xyz_m.shape[:2], Status.MEASURED),
    )
