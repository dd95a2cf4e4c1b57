"""``python -m benchmarks.arena [--data FOLDER] [--quick] [--out DIR]``: one table of all methods, both networks.

``DIR/table.csv`` has a row for each network and method (``people``: one person's points beside the other's): the
points of a network's clicks, beside the mean of two people's points in the frames that both digitised. "inside" is the
share of coordinates inside stated 95 % intervals.
"""

import argparse
import os
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.arena.flights import NETWORKS, Flight, read_flights
from benchmarks.arena.judge import Errors, Names, errors, names
from benchmarks.arena.methods import METHODS, one_person, one_person_tracked
from benchmarks.arena.peers import anipose, kalman_smoother

_HEAD = f"{'':30}{'n':>5}{'median':>9}{'90 %':>8}{'99 %':>8}{'inside':>9}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    beside = Path(__file__).resolve().parents[3] / "shared" / "data"
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("MOCAP_REAL_DATA", beside)))
    parser.add_argument("--network", choices=NETWORKS, action="append", help="one of the networks; all if not given")
    parser.add_argument("--quick", action="store_true", help="one flight of one network")
    parser.add_argument("--out", type=Path, help="folder for table.csv")
    given = parser.parse_args(arguments)
    networks, rows = (given.network or list(NETWORKS))[: 1 if given.quick else None], list[dict[str, object]]()
    for number, network in enumerate(networks):
        flights = read_flights(given.data, network, most=1 if given.quick else None)
        if number == 0:
            rows += people(flights)
        print(f"\nnetwork {network!r}: {len(flights)} flights, mm")
        print(f"{_HEAD}{'exchanged':>12}{'put right':>12}{'repairs':>20}")
        peers = {"Anipose's 3D filter": anipose, "EKS, several cameras": kalman_smoother}
        for name, method in {**peers, **METHODS}.items():
            start = time.perf_counter()
            outcomes = [method(flight) for flight in flights]
            found = [errors(o, f.truth_m) for o, f in zip(outcomes, flights, strict=True)]
            told = sum((names(f, o) for o, f in zip(outcomes, flights, strict=True)), Names())
            row = measured(network, name, found)
            rows.append(row | vars(told) | {"wall_s": time.perf_counter() - start})
            repairs = f"{told.right} right {told.wrong} wrong" if told.right + told.wrong else "-"
            print(
                f"{line(row)}{f'{told.exchanged} of {told.pairs}':>12}"
                f"{f'{told.put_right} of {told.crossed}':>12}{repairs:>20}  {time.perf_counter() - start:.0f} s",
                flush=True,
            )
    if given.out is not None:
        given.out.mkdir(parents=True, exist_ok=True)
        pd.DataFrame(rows).to_csv(given.out / "table.csv", index=False, float_format="%.6g")


def people(flights: list[Flight]) -> list[dict[str, object]]:
    """One person from the other; with intervals of this program's, alone and with those of the other's points."""
    tracked, plain = [one_person_tracked(f) for f in flights], [one_person(f) for f in flights]
    truths = [f.people_m[1] for f in flights]
    both = [errors(o, truth, more_m2=o.cov_m2) for o, truth in zip(tracked, truths, strict=True)]
    rows = [
        measured("people", "one person", [*map(errors, plain, truths)]),
        measured("people", "one person, this program", [*map(errors, tracked, truths)]),
        measured("people", "  with both persons' deviations", both),
    ]
    print("\n".join([f"the second person's points beside, mm\n{_HEAD}", *map(line, rows)]))
    return rows


def measured(network: str, name: str, found: list[Errors]) -> dict[str, object]:
    """A row of the table: quantiles of distances in mm, and the share of coordinates inside 95 % intervals."""
    off = 1e3 * np.concatenate([one.distance_m for one in found])
    inside = np.concatenate([one.inside for one in found])
    at = dict(zip(("median_mm", "q90_mm", "q99_mm"), np.quantile(off, [0.5, 0.9, 0.99]).tolist(), strict=True))
    share = float(inside.mean()) if len(inside) else np.nan
    return {"network": network, "method": name.strip(), "n": len(off), **at, "inside": share}


def line(row: Mapping[str, object]) -> str:
    """A row as it is printed."""
    inside = row["inside"]
    share = f"{100 * inside:.1f} %" if isinstance(inside, float) and np.isfinite(inside) else "-"
    return f"{row['method']:30}{row['n']:5}{row['median_mm']:9.2f}{row['q90_mm']:8.2f}{row['q99_mm']:8.1f}{share:>9}"


if __name__ == "__main__":
    main()
