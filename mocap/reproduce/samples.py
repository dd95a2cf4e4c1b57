"""Joint samples of the built-in bat and lizard, and of a real bat where its recording lies."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from eal.arrays import Array
from mocap.datasets.bats import bat_motion, make_bat
from mocap.datasets.lizards import lizard_motion, make_lizard
from mocap.pipeline.cleaning import clean
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


BEATS_S, STEPS_S = np.arange(240) / 240.0, np.arange(240) / 120.0
"""Times of a simulated trial: nine wing beats, and six strides."""


def elbow_flights(real: Path | None = None) -> Mapping[str, list[Array]]:
    """Angles of the left elbow, a trial each: 0 where the arm is straight.

    Args:
        real: Folder of real recordings, whose six flights of two bats are added; None: simulated animals alone.

    Returns:
        (N, 1) degrees of each trial of ``bat`` and of ``lizard``.
    """
    found: dict[str, list[Array]] = {"bat": [], "lizard": []}
    for seed in range(8):
        for animal, scene in (("bat", bat_motion(seed)(BEATS_S)), ("lizard", lizard_motion(seed)(STEPS_S))):
            names = scene.skeleton.markers
            arm = (scene.xyz_m[:, names.index(f"{joint}_l")] for joint in ("shoulder", "elbow", "wrist"))
            found[animal].append(_angle_deg(wrist_about_elbow(*arm)))
    for file in sorted((real / REAL_BAT.parts[0]).glob("*/*/*dvProject.mat")) if real is not None else ():
        prepared = clean(read(file, fps=700.0))
        samples = wrist_about_elbow(*(np.asarray(prepared.xyz_m)[:, prepared.names.index(n)] for n in REAL_ARM))
        found["bat"].append(_angle_deg(samples[np.isfinite(samples).all(axis=1)]))
    return found


def _angle_deg(samples_m: Array) -> Array:
    return np.degrees(np.arctan2(samples_m[:, 1], samples_m[:, 0]))[:, None]


REAL_ARM = ("pt5", "pt4", "pt2")
"""The left shoulder, elbow and wrist of the bats in the wind tunnel."""
REAL_BAT = Path("bat_windtunnel_dltdv8/derived_csv/078A3_F5")
"""A Carollia in a wind tunnel, 700 frames a second."""


def real_bat_samples(folder: Path) -> Array | None:
    """(N, 2) samples in metres of a real bat's left wrist about its elbow, cleaned; None where the recording is not.

    Args:
        folder: Folder of real recordings.
    """
    files = [folder / REAL_BAT / f"{REAL_BAT.name}_{kind}.csv" for kind in ("xypts", "dltCoefs")]
    if not all(file.exists() for file in files):
        return None
    prepared = clean(read(files[0], calibration=files[1], fps=700.0))
    xyz_m = np.asarray(prepared.xyz_m, dtype=np.float64)
    shoulder, elbow, wrist = (xyz_m[:, prepared.names.index(name)] for name in REAL_ARM)
    samples = wrist_about_elbow(shoulder, elbow, wrist)
    return samples[np.isfinite(samples).all(axis=1)]
