"""Clicks until the error at 90 % is below 4.2 mm: where the desk asks, at random, at the largest reprojection errors.

    python -m benchmarks.desk_clicks [--quick] [--places 80] [--data FOLDER] --out DIR

The flights of ``benchmarks.arena`` are tracked from a network's points and proof-read as the desk does it. The person
is the first of the two who digitised them: at a place (a marker in a frame) he clicks in each camera in which he did,
and the marker is solved again around it. All flights are one pile of places, ``AT_A_TIME`` of which are asked between
two rankings. Errors are distances from the mean of both people's points, of all points that have one. ``table.csv`` has
a row for each way and seed: clicks and places until ``ENOUGH_M`` is reached (``reached`` 0: not with all that it asks
for), the error at 90 % after some numbers of places, and of the places themselves, as they are solved at the end, how
far they lie from where the person's clicks meet (``mm_from_clicks``, median) and how many were not believed
(``rejected``). ``--places``: no more than so many. ``--quick``: one flight, one seed, half as many places.
"""

import argparse
import csv
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

import mocap
from benchmarks.arena.flights import FPS, Flight, read_flights
from eal.arrays import Array
from mocap.cameras.triangulate import linear, residual_px
from mocap.desk.proof import Proof, places
from mocap.records import Status
from mocap.results.tracked import Tracked

ENOUGH_M = 4.2e-3
AT_A_TIME = 5
SHOWN = (0, 20, 40, 60, 80)
COLUMNS = (
    "way",
    "seed",
    "reached",
    "clicks",
    "places",
    "mm_from_clicks",
    "rejected",
    *(f"mm_90_after_{n}" for n in SHOWN),
)


@dataclass(eq=False, kw_only=True)
class Sitting:
    """A flight with the person before it.

    Attributes:
        flight: Which.
        proof: As the desk has it.
        clicks: (C, T, M, 2) the person's pixels, as the files count; NaN where he did not click.
        left: (T, M) places that he can still be asked for.
    """

    flight: Flight
    proof: Proof
    clicks: Array = field(init=False)
    left: NDArray[np.bool_] = field(init=False)

    def __post_init__(self) -> None:
        """Take the person's pixels."""
        person = self.flight.people[0]
        assert person.pixels is not None
        self.clicks = np.full(self.flight.filmed.ideal_px.shape, np.nan)
        self.clicks[:, np.rint(person.t_s * FPS).astype(np.int64)] = person.pixels.uv_px
        self.left = np.isfinite(self.flight.truth_m[..., 0])

    def answer(self, frame: int, marker: int) -> int:
        """Click a place in all cameras in which the person did; how many clicks that took."""
        raw, own = self.proof.raw, np.flatnonzero(np.isfinite(self.clicks[:, frame, marker, 0])).tolist()
        for c in own:
            uv = tuple(self.clicks[c, frame, marker].tolist())
            where = {"frame": frame + 1, "marker": raw.names[marker], "camera": raw.camera_names[c]}
            self.proof.edit(what="place", uv_px=uv, **where)
        del self.proof.pending[:-1]  # the last one is solved with all of them
        self.proof.settle()
        self.left[frame, marker] = False
        return len(own)

    def answered(self) -> tuple[Array, int]:
        """How far places lie from where the person's clicks meet, in metres, and how many were not believed."""
        there = np.isfinite(self.flight.truth_m[..., 0]) & ~self.left
        off = np.linalg.norm(self.proof.tracks.xyz_m - self.flight.people_m[0], axis=-1)[there]
        return off, int((self.proof.tracks.status[there] == Status.REJECTED).sum())


Way = Callable[[Sitting], Array]
"""(T, M) by which places are asked, the largest first; NaN: never."""


def as_the_desk(sitting: Sitting) -> Array:
    """Its ranking (``mocap.desk.proof.places``) of the places that are left."""
    raw = sitting.proof.raw
    out = np.full(sitting.left.shape, np.nan)
    for place in places(sitting.proof.tracks, linear(raw.matrices, raw.ideal_px), ~sitting.left):
        out[place.frame, place.marker] = place.worth_m2
    return out


def by_residual(sitting: Sitting) -> Array:
    """The reprojection error of the network's points, as other programs list it."""
    raw = sitting.proof.raw
    return np.where(sitting.left, residual_px(raw.matrices, raw.ideal_px, linear(raw.matrices, raw.ideal_px)), np.nan)


def at_random(seed: int) -> Way:
    """By lot."""
    rng = np.random.default_rng(seed)
    return lambda sitting: np.where(sitting.left, rng.random(sitting.left.shape), np.nan)


def sit(flights: list[Flight], tracked: list[Tracked], way: Way, most: int) -> dict[str, float]:
    """Answer until enough is right, or nothing more is asked; what it took, and how the error fell."""
    with TemporaryDirectory() as folder:
        sittings = [
            Sitting(
                flight=flight,
                proof=Proof(name=flight.name, raw=flight.filmed, result=result, log=Path(folder) / f"{n}.jsonl"),
            )
            for n, (flight, result) in enumerate(zip(flights, tracked, strict=True))
        ]
        clicks = done = 0
        told = {"mm_90_after_0": 1e3 * error_m(sittings)}
        reached = error_m(sittings) < ENOUGH_M
        while not reached and done < most:
            ranks = [way(one) for one in sittings]
            asked = [(-rank[at], n, *at) for n, rank in enumerate(ranks) for at in map(tuple, np.argwhere(rank > 0))]
            if not asked:
                break
            for _, n, frame, marker in sorted(asked)[:AT_A_TIME]:
                clicks += sittings[n].answer(int(frame), int(marker))
                done += 1
            told[f"mm_90_after_{done}"] = 1e3 * error_m(sittings)
            reached = error_m(sittings) < ENOUGH_M
        off, rejected = zip(*(one.answered() for one in sittings), strict=True)
    own = {"mm_from_clicks": 1e3 * float(np.nanmedian(np.concatenate(off))), "rejected": sum(rejected)}
    return {"reached": int(reached), "clicks": clicks, "places": done, **own, **told}


def error_m(sittings: list[Sitting]) -> float:
    """What 90 % of the distances from the people are below."""
    off = [np.linalg.norm(one.proof.tracks.xyz_m - one.flight.truth_m, axis=-1).ravel() for one in sittings]
    return float(np.nanquantile(np.concatenate(off), 0.9))


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("MOCAP_REAL_DATA", beside)))
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--places", type=int, default=80)
    parser.add_argument("--quick", action="store_true")
    given = parser.parse_args()
    flights = read_flights(given.data, "augmented")[: 1 if given.quick else None]
    tracked = [mocap.track(flight.recording, validate=False) for flight in flights]
    ways: list[tuple[str, int, Way]] = [("desk", 0, as_the_desk), ("reprojection", 0, by_residual)]
    ways += [("random", seed, at_random(seed)) for seed in range(1 if given.quick else 3)]
    given.out.mkdir(parents=True, exist_ok=True)
    with (given.out / "table.csv").open("w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, COLUMNS, extrasaction="ignore", lineterminator="\n")
        table.writeheader()
        for name, seed, way in ways:
            found = sit(flights, tracked, way, given.places // 2 if given.quick else given.places)
            row = {"way": name, "seed": seed} | {k: round(v, 2) for k, v in found.items()}
            table.writerow(row)
            file.flush()
            print(row, flush=True)


if __name__ == "__main__":
    main()
