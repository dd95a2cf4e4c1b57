"""Whether methods of filling gaps rank on a twin as they do on real flights: ``python -m benchmarks.twin_ranking``.

The protocol is that of ``benchmarks.gaps`` on two sets with the same 15 markers, 4 cameras and 700 Hz: ``bat``, real
flights, and as many of the wind-tunnel twin. Printed are each method's error against the geometric mean of all methods
in the same cell (kind and length of gap), and Spearman's rank correlation between both sets, in all and by length of
gap; beside it, as what one can hope for, that between two of the real flights.
"""

import argparse
import sys

import numpy as np
import pandas as pd
from scipy.stats import spearmanr

from benchmarks.gaps.cells import Extent, Task, run
from benchmarks.gaps.method import Trial
from benchmarks.gaps.sets import SETS, WIND_TUNNEL_POINTS, noise_sd, positions
from benchmarks.gaps.table import FOLDS, by_cell, pooled
from benchmarks.twins import POINTS
from datasets.bats import make_bat_wind_tunnel
from mocap.records import PixelTracks
from mocap.skeleton import Skeleton

TWIN = "twin_bat_wind_tunnel"
METHODS = (
    *("linear", "cubic", "pchip", "butterworth", "constant_velocity", "constant_acceleration", "low_rank_kalman"),
    *("pca_gloersen_federolf", "knn", "conditional_gaussian", "conditional_gaussian_delay", "isomap_ukf"),
)
"""Those that take seconds."""

OURS = ("EAL", "EAL, no potential", "EAL, quadratic potential")


def twin() -> list[Trial]:
    """Four flights of the twin, triangulated and cleaned as the real ones are."""
    left, right = ("t3L", "wstL", "t5L", "elbL"), ("t3R", "wstR", "t5R", "elbR")
    trunk = ("str", "lmb", "nl", "shdL", "shdR", "ankL", "ankR")
    skeleton = Skeleton(name="markers only", markers=WIND_TUNNEL_POINTS)
    flights = []
    for seed in range(11, 15):
        film = make_bat_wind_tunnel(seed=seed)
        chosen = [film.pixels.names.index(POINTS[name]) for name in WIND_TUNNEL_POINTS]
        pixels = PixelTracks(
            names=WIND_TUNNEL_POINTS,
            cameras=film.pixels.cameras,
            t_s=film.pixels.t_s,
            uv_px=film.pixels.uv_px[:, :, chosen],
        )
        xyz = positions(pixels, film.cameras, skeleton, WIND_TUNNEL_POINTS, biased=False)
        flights.append((f"twin_{seed}", pixels.t_s, xyz))
    sd_m = noise_sd([(t_s, xyz) for _, t_s, xyz in flights], WIND_TUNNEL_POINTS)
    return [
        Trial(name=name, names=WIND_TUNNEL_POINTS, t_s=t_s, xyz_m=xyz, sd_m=sd_m, trunk=trunk, limbs=(left, right))
        for name, t_s, xyz in flights
    ]


def errors(name: str, trial: int, methods: tuple[str, ...], extent: Extent) -> pd.DataFrame:
    """Logarithmic errors, a row a cell, a column a method, the mean of each row taken off."""
    rows = []
    for method in methods:
        found, trouble = run(Task(name=name, trial=trial, method=method, extent=extent))
        print(f"{name} {trial} {method}" + (f": {trouble}" if trouble else ""), file=sys.stderr, flush=True)
        rows += found
    cells = by_cell(pooled(pd.DataFrame(rows, columns=FOLDS)))
    return cells.sub(cells.mean(axis=1), axis=0)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ours", action="store_true", help="EAL and its controls too (minutes a fold)")
    parser.add_argument("--folds", type=int, default=2, help="flights of each set that are left out, 2 or more")
    arguments = parser.parse_args()
    SETS[TWIN] = twin
    methods = METHODS + (OURS if arguments.ours else ())
    extent = Extent(seeds=(0,))
    sets = {name: [errors(name, fold, methods, extent) for fold in range(arguments.folds)] for name in ("bat", TWIN)}
    mean = {name: pd.concat(parts).mean() for name, parts in sets.items()}
    print(f"{'error against the mean of all, per cent':44}{'real':>8}{'twin':>8}")
    for method in mean["bat"].sort_values().index:
        print(f"{method:44}" + "".join(f"{100 * np.expm1(mean[name][method]):+8.0f}" for name in sets))
    print(f"\n{'rank correlation':44}{'twin':>8}{'another flight':>16}")
    lengths = sorted(sets["bat"][0].index.get_level_values("gap").unique())
    for length in [None, *lengths]:
        real, ours = ([_at(part, length) for part in sets[name]] for name in ("bat", TWIN))
        both = spearmanr(pd.concat(real).mean(), pd.concat(ours).mean()).statistic
        other = spearmanr(real[0].mean(), real[1].mean()).statistic
        print(f"{'all gaps' if length is None else f'gaps of {length} frames':44}{both:8.2f}{other:16.2f}")


def _at(cells: pd.DataFrame, length: int | None) -> pd.DataFrame:
    return cells if length is None else cells[cells.index.get_level_values("gap") == length]


if __name__ == "__main__":
    main()
