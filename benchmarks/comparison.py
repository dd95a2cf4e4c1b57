"""How often ``eal.compare`` calls trials of one kind different, and how often it sees a range that has changed.

python -m benchmarks.comparison [--quick] --out DIR

A joint swings through its range, in degrees; what differs between trials of one animal (the animal effect) is drawn
for each: posture, range, or both. Frames of one trial are as alike as those of a trajectory are.
"""

import argparse
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd

from eal import compare
from eal.arrays import Array
from eal.threads import one_blas_thread

SD_DEG = 4.0
VARYING = {"posture": (SD_DEG, 0.0), "range": (0.0, SD_DEG), "both": (SD_DEG, SD_DEG)}
"""SD between trials of the posture, and of the reach to either side of it."""


def draw(
    rng: np.random.Generator, count: int, *, posture: tuple[float, float], reach: tuple[float, float], frames: int = 150
) -> list[Array]:
    """Trials of three swings, with 1 degree of noise a frame.

    Args:
        rng: For all of it.
        count: Number of trials.
        posture: Middle of the range in degrees, and its standard deviation between trials.
        reach: Of the swing to either side, and its standard deviation between trials.
        frames: N.

    Returns:
        (N, 1) samples of each trial, in degrees.
    """
    found = []
    for _ in range(count):
        middle, half = rng.normal(*posture), rng.normal(*reach)
        phase = rng.uniform(0.0, 2.0 * np.pi) + np.linspace(0.0, 6.0 * np.pi, frames)
        found.append((middle + half * np.sin(phase) + rng.standard_normal(frames))[:, None])
    return found


def rate(rng: np.random.Generator, trials: int, varying: str, changed: float, draws: int) -> float:
    """Share of draws with p <= 0.05: ``changed`` is what the reach of b grows by, in sd between trials."""
    posture, reach = VARYING[varying]
    real = 0
    for _ in range(draws):
        a = draw(rng, trials, posture=(90.0, posture), reach=(40.0, reach))
        b = draw(rng, trials, posture=(90.0, posture), reach=(40.0 + changed * SD_DEG, reach))
        real += compare(a, b).p_value <= 0.05
    return real / draws


def main() -> None:
    """Measure, print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    rng = np.random.default_rng(0)
    rows = []
    with one_blas_thread():
        for varying, trials, changed in product(VARYING, (4, 8), (0.0, 1.0)):
            draws = (40 if options.quick else 400) if changed == 0 else (20 if options.quick else 200)
            share = rate(rng, trials, varying, changed, draws)
            rows.append({"varying": varying, "trials": trials, "changed_sd": changed, "draws": draws, "real": share})
    table = pd.DataFrame(rows)
    options.out.mkdir(parents=True, exist_ok=True)
    table.to_csv(options.out / "table.csv", index=False)
    print(table.to_string(index=False))


if __name__ == "__main__":
    main()
