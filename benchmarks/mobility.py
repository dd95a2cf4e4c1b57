"""How often the interval of ``eal.mobility`` holds the volume of a known cone of rotations.

    python -m benchmarks.mobility [--draws 24] --out DIR

Poses fill a cone evenly by Haar's measure: swing at most alpha, twist at most tau to either side, which is
(1 - cos alpha) / 2 times tau / 180 degrees of all rotations. They are drawn independently or along walks that turn
back at the edges. ``DIR/table.csv`` has a row for each cone: the estimate over the truth (mean, SD over draws), the
median interval over the truth, and how often it held the cone or the share of it that a trial left out spends its
time in.
"""

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from eal import mobility
from eal.arrays import Array
from eal.threads import one_blas_thread

COVER = 0.95
CONES = (
    (30.0, 30.0, 6, 200, None),
    (60.0, 60.0, 6, 200, 0.02),
    (60.0, 60.0, 8, 200, 0.04),
    (45.0, 180.0, 12, 400, 0.04),
    (15.0, 5.0, 12, 400, 0.04),
)
"""Alpha and tau in degrees, trials, frames of each, step of the walk as a share of the range (None: independent)."""


def cone(rng: np.random.Generator, frames: int, alpha_deg: float, tau_deg: float, step: float | None) -> Array:
    """(T, 3, 3) rotations that fill a cone evenly."""
    if step is None:
        at = rng.random((frames, 3))
    else:
        speed = np.zeros(3)
        at = np.empty((frames, 3))
        place = 2.0 * rng.random(3)
        for t in range(frames):
            speed = 0.9 * speed + step * rng.standard_normal(3)
            place = (place + speed) % 2.0
            at[t] = 1.0 - np.abs(1.0 - place)  # there and back again: the walk is reflected
    swing = np.arccos(1.0 - (1.0 - np.cos(np.radians(alpha_deg))) * at[:, 0])
    about, twist = 2.0 * np.pi * at[:, 1], np.radians(tau_deg) * (2.0 * at[:, 2] - 1.0)
    axis = np.stack([np.cos(about), np.sin(about), np.zeros(frames)], axis=1)
    turn = Rotation.from_rotvec(swing[:, None] * axis) * Rotation.from_rotvec(twist[:, None] * [0.0, 0.0, 1.0])
    return turn.as_matrix()


def volume(alpha_deg: float, tau_deg: float) -> float:
    """Share of all rotations."""
    return float((1.0 - np.cos(np.radians(alpha_deg))) / 2.0 * tau_deg / 180.0)


def held(alpha_deg: float, tau_deg: float, trials: int, frames: int, step: float | None, *, draws: int) -> dict:
    """A row of the table."""
    whole = volume(alpha_deg, tau_deg)
    found = []
    for draw in range(draws):
        rng = np.random.default_rng([draw, int(alpha_deg), trials])
        made = mobility([cone(rng, frames, alpha_deg, tau_deg, step) for _ in range(trials)], cover=COVER)
        found.append([made.share, *made.interval])
    share, low, high = np.array(found).T / whole
    return {
        "alpha_deg": alpha_deg,
        "tau_deg": tau_deg,
        "trials": trials,
        "walk": step or 0.0,
        "draws": draws,
        "ratio": share.mean(),
        "ratio_sd": share.std(),
        "low": np.median(low),
        "high": np.median(high),
        "held_cone": np.mean((low <= 1.0) & (high >= 1.0)),
        "held_cover": np.mean((low <= COVER) & (high >= COVER)),
    }


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=24)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    with one_blas_thread():
        table = pd.DataFrame([held(*row, draws=options.draws) for row in CONES])
    table.to_csv(options.out / "table.csv", index=False, float_format="%.3f")
    print(table.to_string(index=False, float_format="%.2f"))


if __name__ == "__main__":
    main()
