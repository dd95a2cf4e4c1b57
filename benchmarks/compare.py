"""How often ``eal.compare`` calls the same movement different, and how often it sees a range that has changed.

python -m benchmarks.compare [--quick] [--draws N] [--rows TEXT] [--peers] --out DIR

A joint swings through its range, in degrees. What differs between trials of one animal is drawn for each: posture,
range, or both; trials and animals of a and b may last longer or shorter, vary more or less, and be more or fewer. In
rows of the null nothing else differs; in rows of power the reach of b is one standard deviation larger.
``DIR/draws.csv`` has a row for each draw (a run that ends early goes on there), ``DIR/table.csv`` one for each kind:
per cent of draws with p at most 0.05 and 0.01, with a band that is crossed, with intervals of the shift and of the
ratio of variances that hold what was made, and with a p of variances at most 0.05. ``--peers`` measures what the field
uses on the same draws (``benchmarks.compare_peers``), in ``peers_draws.csv`` and ``peers.csv``.
"""

import argparse
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.compare_peers import peers
from eal import compare
from eal.arrays import Array
from eal.threads import one_blas_thread

SWING_HZ, CENTRE_DEG, REACH_DEG, NOISE_DEG = 5.0, 90.0, 40.0, 1.0
SD_DEG = 4.0


@dataclass(frozen=True, kw_only=True)
class Group:
    """How one side is recorded.

    Attributes:
        animals: Number of animals, or of trials where each has one.
        trials: Of each animal.
        duration_s: Of a trial.
        fps: Frames a second.
        posture: SD between trials of an animal, in degrees.
        animal: SD between animals of the posture.
        range: SD between trials of the reach to either side.
        reach: Mean of that.
        hidden: Share of the frames above 115 degrees that nobody saw.
        hz: Swings a second.
        wave: ``sine``, ``dwelling`` (longer at one end), or ``wandering`` (no cycle at all).
    """

    animals: int = 8
    trials: int = 1
    duration_s: float = 0.6
    fps: float = 250.0
    posture: float = SD_DEG
    animal: float = 0.0
    range: float = 0.0
    reach: float = REACH_DEG
    hidden: float = 0.0
    hz: float = SWING_HZ
    wave: str = "sine"

    def draw(self, rng: np.random.Generator, name: str) -> tuple[list[Array], list[str]]:
        """Trials, each (N, 1) degrees with NaN where hidden, and whose each is."""
        trials, owners = [], []
        for animal in range(self.animals):
            own = CENTRE_DEG + self.animal * rng.standard_normal()
            for _ in range(self.trials):
                middle = own + self.posture * rng.standard_normal()
                angle = middle + (self.reach + self.range * rng.standard_normal()) * self._wave(rng)
                seen = angle + NOISE_DEG * rng.standard_normal(len(angle))
                if self.hidden:
                    seen[(angle > 115.0) & (rng.random(len(angle)) < self.hidden)] = np.nan
                trials.append(seen[:, None])
                owners.append(f"{name}{animal}")
        return trials, owners

    def _wave(self, rng: np.random.Generator) -> Array:
        n = max(round(self.duration_s * self.fps), 4)
        start, hz = rng.uniform(0.0, 2.0 * np.pi), self.hz * np.exp(0.1 * rng.standard_normal())
        phase = start + 2.0 * np.pi * hz * np.arange(n) / self.fps
        if self.wave == "sine":
            return np.sin(phase)
        if self.wave == "dwelling":
            return (np.exp(1.5 * np.sin(phase)) - 1.6467) / 1.15  # mean of exp(1.5 sin) is I_0(1.5)
        keep = np.exp(-2.0 * np.pi * self.hz / self.fps)
        steps, out = rng.standard_normal(n), np.empty(n)
        out[0] = steps[0]
        for i in range(1, n):
            out[i] = keep * out[i - 1] + np.sqrt(1.0 - keep**2) * steps[i]
        return out / np.sqrt(2.0)


@dataclass(frozen=True, kw_only=True)
class Row:
    """Two groups, and whether animals are named."""

    a: Group = field(default_factory=Group)
    b: Group = field(default_factory=Group)
    named: bool = False
    kind: str = "null"


def _row(a: Mapping[str, object], b: Mapping[str, object], *, named: bool = False, kind: str = "null") -> Row:
    return Row(a=Group(**a), b=Group(**b), named=named, kind=kind)  # type: ignore[arg-type]


ROWS = {
    "8 v 8": _row({}, {}),
    "8 v 8, 0.15 and 2 s": _row({"duration_s": 0.15}, {"duration_s": 2.0}),
    "8 v 8, 60 and 1000 frames/s": _row({"fps": 60.0}, {"fps": 1000.0}),
    "4 v 12, 0.12 and 1.5 s": _row({"animals": 4, "duration_s": 0.12}, {"animals": 12, "duration_s": 1.5}),
    "12 v 4, 0.12 and 1.5 s": _row({"animals": 12, "duration_s": 0.12}, {"animals": 4, "duration_s": 1.5}),
    "4 v 12, SD 8 and 4": _row({"animals": 4, "posture": 8.0}, {"animals": 12}),
    "4 v 12 animals, 1 and 6 trials": _row(
        {"animals": 4, "animal": 2.0}, {"animals": 12, "trials": 6, "animal": 2.0}, named=True
    ),
    "5 v 8 animals, 1 and 3 trials": _row({"animals": 5, "animal": 2.0}, {"trials": 3, "animal": 2.0}, named=True),
    "6 v 10 animals, 1 and 4 trials": _row(
        {"animals": 6, "animal": 2.0}, {"animals": 10, "trials": 4, "animal": 2.0}, named=True
    ),
    "8 v 8, 70 % above 115 degrees hidden in b": _row({}, {"hidden": 0.7}),
    "8 v 8, dwelling, 0.15 and 2 s": _row(
        {"wave": "dwelling", "duration_s": 0.15}, {"wave": "dwelling", "duration_s": 2.0}
    ),
    "6 v 10, wandering, 0.3 and 1 s": _row(
        {"animals": 6, "wave": "wandering", "duration_s": 0.3}, {"animals": 10, "wave": "wandering", "duration_s": 1.0}
    ),
    "5 v 11, range SD 8 and 4": _row(
        {"animals": 5, "posture": 0.5, "range": 8.0}, {"animals": 11, "posture": 0.5, "range": 4.0}
    ),
    "power: 8 v 8, posture varies": _row({}, {"reach": REACH_DEG + SD_DEG}, kind="power"),
    "power: 8 v 8, range varies": _row(
        {"posture": 0.0, "range": SD_DEG}, {"posture": 0.0, "range": SD_DEG, "reach": REACH_DEG + SD_DEG}, kind="power"
    ),
    "power: 6 v 10, posture varies": _row({"animals": 6}, {"animals": 10, "reach": REACH_DEG + SD_DEG}, kind="power"),
}


def drawn(name: str, row: Row, number: int) -> tuple[list[Array], list[Array], tuple[list[str], list[str]] | None]:
    """Trials of a and of b of one draw, the same whoever asks, and whose each is where the row names animals."""
    rng = np.random.default_rng([zlib.crc32(name.encode()), number])
    (a, of_a), (b, of_b) = row.a.draw(rng, "a"), row.b.draw(rng, "b")
    return a, b, (of_a, of_b) if row.named else None


def judged(name: str, row: Row, number: int) -> dict[str, object]:
    """What ``eal.compare`` says of one draw."""
    a, b, animals = drawn(name, row, number)
    one = compare(a, b, animals=animals)
    low, high = np.log(one.variance_ratio_interval[0])
    within = one.variance_of == "within trials"
    made = np.log(_variance(row.b, within=within) / _variance(row.a, within=within))
    return {
        "row": name,
        "draw": number,
        "p": one.p_value,
        "band": int(one.differs.any()),
        "shift": int(one.shift_interval[0, 0] <= 0.0 <= one.shift_interval[0, 1]),
        "ratio": int(low <= made <= high),
        "variance_p": one.variance_p[0],
    }


def judged_by_peers(name: str, row: Row, number: int) -> dict[str, object]:
    """What the methods of the field say of one draw."""
    a, b, animals = drawn(name, row, number)
    return {"row": name, "draw": number, **peers((a, b), (row.a.fps, row.b.fps), animals, number)}


def shares_of_peers(draws: pd.DataFrame) -> pd.DataFrame:
    """A row for each kind of draws: per cent of those in which a method says something, and that is how often."""
    found = []
    for name, row in ROWS.items():
        mine = draws[draws["row"] == name].drop(columns=["row", "draw"])
        if len(mine):
            table = {str(key): mine[key].to_numpy(dtype=np.float64) for key in mine}
            says = {k.replace("_p05", "_says"): np.isfinite(x) for k, x in table.items() if k.endswith("_p05")}
            said = {k: x[np.isfinite(x)] for k, x in table.items()}
            values = {k: 100.0 * float(np.mean(x)) if len(x) else np.nan for k, x in {**said, **says}.items()}
            found.append({"row": name, "kind": row.kind, "draws": len(mine), **values})
    return pd.DataFrame(found)


def shares(draws: pd.DataFrame) -> pd.DataFrame:
    """A row for each kind of draws, in per cent of them."""
    found = []
    for name, row in ROWS.items():
        mine = draws[draws["row"] == name]
        if len(mine):
            yes = {
                "p05": mine["p"] <= 0.05,
                "p01": mine["p"] <= 0.01,
                "band": mine["band"],
                "shift": mine["shift"],
                "ratio": mine["ratio"],
                "variance_p05": mine["variance_p"] <= 0.05,
            }
            percent = {key: 100.0 * float(np.mean(value)) for key, value in yes.items()}
            found.append({"row": name, "kind": row.kind, "draws": len(mine), **percent})
    return pd.DataFrame(found)


def _variance(group: Group, *, within: bool) -> float:
    """Of the angle over the time of a trial, or of all of them."""
    wave = {"sine": 0.5, "dwelling": 0.7895, "wandering": 0.5}[group.wave]  # (I_0(3) - I_0(1.5)^2) / 1.15^2
    own = wave * (group.reach**2 + group.range**2) + NOISE_DEG**2
    return own if within else own + group.posture**2 + group.animal**2


def main() -> None:
    """Measure, print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--draws", type=int, default=None)
    parser.add_argument("--peers", action="store_true", help="what the field uses, on the same draws")
    parser.add_argument("--rows", default="", help="only rows whose name has this in it")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    wanted = options.draws or (10 if options.quick else 400)
    options.out.mkdir(parents=True, exist_ok=True)
    one, table, name = (judged_by_peers, shares_of_peers, "peers") if options.peers else (judged, shares, "")
    path = options.out / f"{name}_draws.csv".lstrip("_")
    with one_blas_thread():
        for row in ROWS:
            if options.rows in row:
                _measure(row, wanted, path, one)
                found = table(pd.read_csv(path))
                mine = found[found["row"] == row]
                print(mine.to_string(index=False, header=False, float_format="%.1f"), flush=True)
                found.to_csv(options.out / f"{name or 'table'}.csv", index=False, float_format="%.4g")


def _measure(row: str, wanted: int, path: Path, one: Callable[[str, Row, int], dict[str, object]]) -> None:
    """Add the draws of a row that the file does not have."""
    there = pd.read_csv(path) if path.is_file() else pd.DataFrame({"row": [], "draw": []})
    done = set(there.loc[there["row"] == row, "draw"])
    for number in range(wanted):
        if number not in done:
            found = pd.DataFrame([one(row, ROWS[row], number)])
            found.to_csv(path, mode="a", header=not path.is_file(), index=False, float_format="%.6g")


if __name__ == "__main__":
    main()
