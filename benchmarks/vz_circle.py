"""A curved gap held by V_z, beside the exact posterior: how well the iterated smoother states what it does not know.

    python -m benchmarks.vz_circle [--quick] --out DIR

A point walks at random near a circle of which V_z was learned, seen for ten steps on both sides of a gap. Ground truth
is drawn from the walk; the exact posterior is had on a grid (``tests/reference/circle_posterior.py``). The smoother is
that of recordings of one camera (``mocap/filters/trajectory.py``). ``DIR/table.csv`` has one row per walk: deviation
of a step, weight of the potential, length of the gap, draws; RMS errors in the gap and share of coordinates inside 95 %
intervals, of the exact posterior and of the smoother; ``sd_ratio``, root of the ratio of mean variances; ``inside_sd``,
standard error over draws of the difference of both shares; ``steps`` of the smoother.
"""

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from mocap.filters.trajectory import covariance, factor, most_probable

from eal import EmpiricalPotential
from eal.arrays import Z95
from tests.reference.circle_posterior import SEEN, Circle, drawn, exact, potential

WALKS = ((0.06, 30, 10), (0.06, 300, 10), (0.06, 30, 30), (0.06, 300, 30), (0.15, 30, 20), (0.06, 300, 60))
DRAWS, QUICK = 200, 8


def row(v: EmpiricalPotential, walk: float, weight: float, gap: int, draws: int) -> dict[str, float]:
    """One row of the table."""
    rng, hidden = np.random.default_rng(0), slice(SEEN, SEEN + gap)
    found = []
    for _ in range(draws):
        problem = Circle(v, drawn(v, walk, weight, gap, rng))
        mean, sd = exact(v, problem.walk)
        costs: list[float] = []
        at = most_probable(problem, problem.start(), tell=costs.append)
        own = np.sqrt(np.einsum("tii->ti", covariance(factor(problem.quadratic(at)))[0]))
        miss = [np.abs(x - problem.walk.truth)[hidden] for x in (mean, at)]
        inside = [np.mean(m < Z95 * s[hidden]) for m, s in zip(miss, (sd, own), strict=True)]
        squares = [np.mean(x**2) for x in (*miss, sd[hidden], own[hidden])]
        found.append([*squares, *inside, len(costs)])
    a, b, exact_var, own_var, exact_in, own_in, steps = np.mean(found, axis=0)
    apart = np.std([one[5] - one[4] for one in found], ddof=1) / np.sqrt(draws)
    return {
        "walk_sd": walk,
        "weight": weight,
        "gap": gap,
        "draws": draws,
        "rmse_exact": np.sqrt(a),
        "rmse": np.sqrt(b),
        "inside_exact": exact_in,
        "inside": own_in,
        "inside_sd": apart,
        "sd_ratio": np.sqrt(own_var / exact_var),
        "steps": steps,
    }


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} draws a row")
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    v, rows = potential(), []
    for walk, weight, gap in WALKS:
        rows.append(row(v, walk, weight, gap, QUICK if given.quick else DRAWS))
        print(" ".join(f"{name} {value:.3g}" for name, value in rows[-1].items()), flush=True)
        pd.DataFrame(rows).to_csv(given.out / "table.csv", index=False)


if __name__ == "__main__":
    main()
