"""How far fills are from those of a recording's authors: ``python -m benchmarks.gaps.authors [--methods NAME ...]``.

The gliding snakes come raw and as their authors filled them (gaps of mostly up to ten frames, in Qualisys' program, by
hand). A fill is no truth: the table says how much methods differ from what an expert accepted, nothing more.
"""

import argparse
import sys
from collections.abc import Sequence

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.gaps.method import Method
from benchmarks.gaps.registry import methods
from benchmarks.gaps.sets import DATA, GLIDES, STATIONS, load, stations
from benchmarks.gaps.takes import believed
from eal.arrays import Array
from mocap.io.qualisys import read_tsv


def authors_fill() -> list[Array]:
    """(T, M, 3) what the authors filled in each trial of ``snake_glide``; NaN elsewhere."""
    out = []
    for name, trial in zip(GLIDES, load("snake_glide"), strict=True):
        raw, filled = (
            read_tsv(DATA / "snake_glide_qualisys" / f"{name}{ending}.tsv").points for ending in ("", "_filled")
        )
        chosen = stations(believed(raw.t_s, raw.xyz_m, raw.names), STATIONS)
        first = int(np.flatnonzero(raw.seen[:, chosen].any(axis=1))[0])  # trials begin with their first sighting
        xyz = filled.xyz_m[first : first + len(trial.t_s), chosen]
        out.append(np.where(np.isnan(trial.xyz_m), xyz, np.nan))
    return out


def distances(method: Method, fills: Sequence[Array]) -> Array:
    """(K,) distances in metres to all samples that the authors filled; trials are left out in turn."""
    trials = load("snake_glide")
    parts = []
    for left_out, fill in enumerate(fills):
        known = np.isfinite(fill[..., 0])
        if known.any():
            filler = method.learn([trial for i, trial in enumerate(trials) if i != left_out])
            parts.append(np.linalg.norm(filler(trials[left_out]).xyz_m - fill, axis=-1)[known])
    return np.concatenate(parts)


def main() -> int:
    """Print the table; exit 0."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.gaps.authors", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--methods", nargs="+", help="names; default: all")
    wanted = parser.parse_args().methods
    fills = authors_fill()
    count = sum(int(np.isfinite(fill[..., 0]).sum()) for fill in fills)
    print(f"{count} samples filled by the authors, {len(fills)} trials")
    print(f"{'method':28}{'median mm':>11}{'90 % mm':>9}{'rms mm':>9}")
    for method in methods():
        if wanted and method.name not in wanted:
            continue
        try:
            with threadpool_limits(1):
                mm = 1e3 * distances(method, fills)
        except Exception as error:  # a method may fail in any way; the others go on
            print(f"{method.name}: FAILED: {error}", file=sys.stderr)
            continue
        row = (np.median(mm), np.quantile(mm, 0.9), np.sqrt(np.mean(mm**2)))
        print(f"{method.name:28}{row[0]:11.2f}{row[1]:9.2f}{row[2]:9.2f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
