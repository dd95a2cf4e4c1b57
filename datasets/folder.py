"""A recording with its truth as files: the DLTdv set, the skeleton, and the truth beside them."""

import json
import os
import tempfile
from pathlib import Path

import numpy as np

from datasets.recording import SyntheticRecording
from mocap.errors import FormatError
from mocap.formats.csv_table import write_table
from mocap.formats.dltdv import write_coefficients, write_pixels
from mocap.formats.profile import write_profile
from mocap.lens import BrownLens
from mocap.records import MarkerTracks, Origin
from mocap.skeleton import write_skeleton


def write_recording(recording: SyntheticRecording, folder: Path) -> dict[str, Path]:
    """Write a recording into a folder, which is made if need be; files of the same names are replaced.

    Each file appears when all are whole. The offsets say which frame of a camera shows the instant of a row, as DLTdv
    has them: below zero where the camera starts late, in fractions of frames. The truth holds ``names``, ``t_s``,
    ``xyz_m``, ``fps``, ``start_s``, ``occluded``, ``lost``, ``outlier`` and ``contact``, as in the record.

    Args:
        recording: What to write.
        folder: Where to.

    Returns:
        Paths by kind: ``pixels``, ``coefficients``, ``profile`` (of Brown lenses only: the format knows no other),
        ``offsets``, ``skeleton``, ``truth``, ``card``.
    """
    paths = {
        kind: folder / f"{recording.name}_{ending}"
        for kind, ending in (
            ("pixels", "xypts.csv"),
            ("coefficients", "dltCoefs.csv"),
            ("profile", "camera_profile.txt"),
            ("offsets", "offsets.csv"),
            ("skeleton", "skeleton.toml"),
            ("truth", "truth.npz"),
            ("card", "card.json"),
        )
    }
    if not all(isinstance(camera.lens, BrownLens) for camera in recording.cameras):
        del paths["profile"]
    n_cameras, n_frames = len(recording.cameras), len(recording.truth.t_s)
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        draft = {kind: Path(scratch) / path.name for kind, path in paths.items()}
        write_pixels(draft["pixels"], recording.pixels)
        write_coefficients(draft["coefficients"], recording.cameras)
        if "profile" in draft:
            write_profile(draft["profile"], recording.cameras)
        titles = [f"cam{c}_offset" for c in range(1, n_cameras + 1)]
        offsets = np.zeros((n_frames, n_cameras)) - recording.start_s * recording.fps
        write_table(draft["offsets"], titles, offsets)
        write_skeleton(draft["skeleton"], recording.skeleton)
        np.savez_compressed(
            draft["truth"],
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
        draft["card"].write_text(json.dumps(recording.card, indent=2) + "\n", encoding="utf-8")
        for kind, path in paths.items():
            os.replace(draft[kind], path)
    return paths


def read_truth(path: Path) -> MarkerTracks:
    """The true markers of ``truth.npz``, complete, with zero covariance.

    Raises:
        FormatError: the file is not such a truth.
    """
    try:
        with np.load(path) as table:
            names, t_s, xyz_m = tuple(map(str, table["names"])), table["t_s"], table["xyz_m"]
    except (OSError, ValueError, KeyError) as error:
        raise FormatError(f"{path}: not the truth of a synthetic recording: {error}; write it again") from None
    return MarkerTracks(
        names=names,
        t_s=t_s,
        xyz_m=xyz_m,
        cov_m2=np.zeros((*xyz_m.shape, 3)),
        origin=np.full(xyz_m.shape[:2], Origin.MEASURED),
    )
