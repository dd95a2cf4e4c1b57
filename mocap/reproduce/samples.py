"""Joint samples of the built-in bat and lizard, and of a real bat where its recording lies."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from eal.arrays import Array
from mocap.datasets.bats import make_bat
from mocap.datasets.lizards import make_lizard
from mocap.pipeline.prepare import prepare
from mocap.pipeline.reading import read


def wrist_about_elbow(shoulder_m: Array, elbow_m: Array, wrist_m: Array) -> Array:
    """The wrist in the plane of the arm: along the upper arm, and across it; section 2.3.

    Args:
        shoulder_m: (T, 3) positions.
        elbow_m: (T, 3) positions, the origin.
        wrist_m: (T, 3) positions.

    Returns:
        (T, 2) coordinates in metres.
    """
    axis = elbow_m - shoulder_m
    axis = axis / np.linalg.norm(axis, axis=1, keepdims=True)
    arm = wrist_m - elbow_m
    along = np.einsum("ti,ti->t", arm, axis)
    across = np.linalg.norm(arm - along[:, None] * axis, axis=1)
    return np.stack([along, across], axis=1)


def built_in_samples() -> Mapping[str, Array]:
    """``bat`` and ``lizard``: (N, 2) samples in metres of the left wrist about its elbow."""
    found = {}
    for recording in (make_bat(), make_lizard()):
        names, xyz_m = recording.truth.names, np.asarray(recording.truth.xyz_m, dtype=np.float64)
        shoulder, elbow, wrist = (xyz_m[:, names.index(f"{joint}_l")] for joint in ("shoulder", "elbow", "wrist"))
        samples = wrist_about_elbow(shoulder, elbow, wrist)
        found["bat" if "bat" in recording.name else "lizard"] = samples[np.isfinite(samples).all(axis=1)]
    return found


REAL_BAT = Path("bat_windtunnel_dltdv8/derived_csv/078A3_F5")
"""A Carollia in a wind tunnel, 700 frames a second; points 5, 4, 2 are the left shoulder, elbow and wrist."""


def real_bat_samples(folder: Path) -> Array | None:
    """(N, 2) samples in metres of a real bat's left wrist about its elbow, cleaned; None where the recording is not.

    Args:
        folder: Folder of real recordings.
    """
    files = [folder / REAL_BAT / f"{REAL_BAT.name}_{kind}.csv" for kind in ("xypts", "dltCoefs")]
    if not all(file.exists() for file in files):
        return None
    prepared = prepare(read(files[0], calibration=files[1], fps=700.0))
    xyz_m = np.asarray(prepared.xyz_m, dtype=np.float64)
    shoulder, elbow, wrist = (xyz_m[:, prepared.names.index(name)] for name in ("pt5", "pt4", "pt2"))
    samples = wrist_about_elbow(shoulder, elbow, wrist)
    return samples[np.isfinite(samples).all(axis=1)]
