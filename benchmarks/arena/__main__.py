"""``python -m benchmarks.arena [--data FOLDER] [--flights N]``: one table of all methods, both networks.

The points of a network's clicks, beside the mean of two people's points in the frames that both digitised; and one
person's points beside the other's. "inside" is the share of coordinates inside stated 95 % intervals.
"""

import argparse
import os
import time
from pathlib import Path

import numpy as np

from benchmarks.arena.flights import NETWORKS, Flight, read_flights
from benchmarks.arena.judge import Errors, Names, errors, names
from benchmarks.arena.methods import METHODS, one_person, one_person_tracked
from benchmarks.arena.peers import anipose, kalman_smoother

_HEAD = f"{'':30}{'n':>5}{'median':>9}{'90 %':>8}{'99 %':>8}{'inside':>9}"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    beside = Path(__file__).resolve().parents[3] / "shared" / "data"
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("MOCAP_REAL_DATA", beside)))
    parser.add_argument("--network", choices=NETWORKS, action="append", help="one of the networks; all if not given")
    given = parser.parse_args()
    for number, network in enumerate(given.network or NETWORKS):
        flights = read_flights(given.data, network)
        if number == 0:
            people(flights)
        print(f"\nnetwork {network!r}: {len(flights)} flights, mm")
        print(f"{_HEAD}{'exchanged':>12}{'put right':>12}{'repairs':>20}")
        peers = {"Anipose's 3D filter": anipose, "EKS, several cameras": kalman_smoother}
        for name, method in {**peers, **METHODS}.items():
            start = time.perf_counter()
            outcomes = [method(flight) for flight in flights]
            found = [errors(o, f.truth_m) for o, f in zip(outcomes, flights, strict=True)]
            told = sum((names(f, o) for o, f in zip(outcomes, flights, strict=True)), Names())
            repairs = f"{told.right} right {told.wrong} wrong" if told.right + told.wrong else "-"
            print(
                f"{line(name, found)}{f'{told.exchanged} of {told.pairs}':>12}"
                f"{f'{told.put_right} of {told.crossed}':>12}{repairs:>20}  {time.perf_counter() - start:.0f} s",
                flush=True,
            )


def people(flights: list[Flight]) -> None:
    """One person from the other; with intervals of this program's, alone and with those of the other's points."""
    print(f"the second person's points beside, mm\n{_HEAD}")
    print(line("one person", [errors(one_person(f), f.people_m[1]) for f in flights]))
    tracked = [one_person_tracked(f) for f in flights]
    print(line("one person, this program", [errors(o, f.people_m[1]) for o, f in zip(tracked, flights, strict=True)]))
    both = [errors(o, f.people_m[1], more_m2=o.cov_m2) for o, f in zip(tracked, flights, strict=True)]
    print(line("  with both persons' deviations", both))


def line(name: str, found: list[Errors]) -> str:
    """A row of the table."""
    off = 1e3 * np.concatenate([one.distance_m for one in found])
    inside = np.concatenate([one.inside for one in found])
    share = f"{100 * inside.mean():.1f} %" if len(inside) else "-"
    median, most, nearly_all = np.quantile(off, [0.5, 0.9, 0.99])
    return f"{name:30}{len(off):5}{median:9.2f}{most:8.2f}{nearly_all:8.1f}{share:>9}"


if __name__ == "__main__":
    main()
