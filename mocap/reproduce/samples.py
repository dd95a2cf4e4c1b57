"""Joint samples of the built-in bat and lizard, and of a real bat where its recording lies."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from eal.arrays import Array
from mocap.cleaning.cleaning import clean
from mocap.datasets.bats import bat_motion, make_bat
from mocap.datasets.lizards import lizard_motion, make_lizard
from mocap.reading.reading import read


def wrist_about_elbow(xyz_m: Array, names: Sequence[str], arm: tuple[str, str, str]) -> Array:
    """The wrist in the plane of the arm, where it is seen: along the upper arm, and across it; section 2.3.

    Args:
        xyz_m: (T, M, 3) positions.
        names: The M markers.
        arm: Shoulder, elbow (the origin) and wrist.

    Returns:
        (N, 2) coordinates in metres.
    """
    shoulder, elbow, wrist = (np.asarray(xyz_m, dtype=np.float64)[:, names.index(name)] for name in arm)
    axis = elbow - shoulder
    axis = axis / np.linalg.norm(axis, axis=1, keepdims=True)
    along = np.einsum("ti,ti->t", wrist - elbow, axis)
    across = np.linalg.norm(wrist - elbow - along[:, None] * axis, axis=1)
    samples = np.stack([along, across], axis=1)
    return samples[np.isfinite(samples).all(axis=1)]


ARM = ("shoulder_l", "elbow_l", "wrist_l")
"""Of the built-in animals."""


def built_in_samples() -> Mapping[str, Array]:
    """``bat`` and ``lizard``: (N, 2) samples in metres of the left wrist about its elbow."""
    truths = {"bat": make_bat().truth, "lizard": make_lizard().truth}
    return {animal: wrist_about_elbow(truth.xyz_m, truth.names, ARM) for animal, truth in truths.items()}


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
            found[animal].append(_angle_deg(wrist_about_elbow(scene.xyz_m, scene.skeleton.markers, ARM)))
    for file in sorted((real / REAL_BAT.parts[0]).glob("*/*/*dvProject.mat")) if real is not None else ():
        prepared = clean(read(file, fps=700.0))
        found["bat"].append(_angle_deg(wrist_about_elbow(prepared.xyz_m, prepared.names, REAL_ARM)))
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
    return wrist_about_elbow(prepared.xyz_m, prepared.names, REAL_ARM)
