"""One true thing more makes no gap worse: ``python -m benchmarks.gaps.one_more [--quick] [--sets ...] --out DIR``.

In a trial that was left out the same gaps are filled twice by what users run, without and with one more

- ``ray``: a camera that sees what is hidden, in sets with pixels;
- ``camera``: of those that see the rest of the animal, in sets that have three or more;
- ``trial``: that the model is learned from, in sets that have three or more.

``DIR/draws.csv`` has a row for each draw of gaps and cell, as it comes (those that are there are not drawn again),
``DIR/table.csv`` a row for each set, thing and length of gap: by how much the error changes (mean of logarithms over
draws, per cent), its standard error, z with the thing, and whether it breaks the rule: worse by more than its standard
error, or z outside 0.7 to 1.4 where it was inside. Where nothing changes one cell in six is worse by chance.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from benchmarks.deviations import RIGHT
from benchmarks.gaps.cells import QUICK, QUICK_PLAN, Extent, fold_trials
from benchmarks.gaps.hide import cells
from benchmarks.gaps.method import Filler, Trial
from benchmarks.gaps.ours import ours
from benchmarks.gaps.protocol import Outcome, evaluate, plan, shown_trials
from benchmarks.gaps.rays import Shown
from benchmarks.gaps.sets import SETS, size
from mocap.errors import MocapError

THINGS = ("ray", "camera", "trial")
ROWS = ("set", "trial", "seed", "more", "scenario", "gap", "less_mm", "more_mm", "less_z", "more_z")
PLACE = ("set", "trial", "seed")


def main() -> int:
    """Draw, and print the table; exit 0, or 1 where no set can be loaded."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.gaps.one_more",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--quick", action="store_true", help="one fold of short trials, gaps of a limb")
    parser.add_argument("--sets", nargs="+", choices=SETS, default=SETS, help="default: all")
    parser.add_argument("--seeds", type=int, default=10, help="number of draws of gaps (10)")
    parser.add_argument("--out", type=Path, required=True, help="folder for both tables")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    path, extent = args.out / "draws.csv", QUICK if args.quick else Extent()
    rows = pd.read_csv(path).to_dict("records") if path.exists() else []
    for name in args.sets:
        try:
            folds = range(min(size(name), extent.folds))
        except (MocapError, OSError, ValueError) as error:
            print(f"{name}: left out: {error}", file=sys.stderr)
            continue
        for k in folds:
            for new in of_fold(name, k, replace(extent, seeds=tuple(range(args.seeds))), rows):
                rows += new
                pd.DataFrame(rows, columns=ROWS).to_csv(path, index=False, float_format="%.6g")
                print(f"{new[0]['set']} {new[0]['trial']} {new[0]['seed']}", file=sys.stderr, flush=True)
    if not rows:
        print("no set could be loaded: set MOCAP_REAL_DATA to the folder of the recordings", file=sys.stderr)
        return 1
    found = table(pd.DataFrame(rows, columns=ROWS))
    found.to_csv(args.out / "table.csv", index=False, float_format="%.4g")
    print(found.round(2).to_string(index=False))
    return 0


def of_fold(name: str, left_out: int, extent: Extent, known: Sequence[dict]) -> Iterator[list[dict]]:
    """Rows of each draw of a fold that is not known yet."""
    trials = fold_trials(name, left_out, extent)
    *training, truth = trials
    there = {(row["set"], row["trial"], row["seed"]) for row in known}
    seeds = [seed for seed in extent.seeds if (name, truth.name, seed) not in there]
    if not seeds:
        return
    token = plan.set(QUICK_PLAN) if extent.short else None
    wanted = cells(scenarios=extent.scenarios, lengths=extent.lengths)
    try:
        with threadpool_limits(1):
            method = ours()[0]
            every = method.learn(training)
            fewer = method.learn(training[:-1]) if len(training) > 1 else None
            for seed in seeds:
                shown = shown_trials(truth, seed, wanted, frames=extent.frames, rays=(0, 1), once=extent.once)
                yield [
                    dict(zip(PLACE, (name, truth.name, seed), strict=True)) | row
                    for row in of_draw(every, fewer, shown, np.random.default_rng(seed))
                ]
    finally:
        if token is not None:
            plan.reset(token)


def of_draw(every: Filler, fewer: Filler | None, shown: Sequence[Shown], rng: np.random.Generator) -> Iterator[dict]:
    """Cells of one draw, with and without each thing.

    Args:
        every: What all trials taught.
        fewer: What all but one did; None: there is one.
        shown: The gaps, with no ray left, and with one where the trial has a film.
        rng: Which camera is taken away.
    """
    dark = [copy for copy in shown if copy.rays == 0]
    rays = [copy for copy in shown if copy.rays == 1]
    own = evaluate(every, dark)
    if rays:
        yield from cells_of("ray", own, evaluate(every, rays))
    taken = [replace(copy, trial=without_camera(copy.trial, rng)) for copy in dark if cameras(copy.trial) > 2]
    if taken:
        yield from cells_of("camera", evaluate(every, taken), own)
    if fewer is not None:
        yield from cells_of("trial", evaluate(fewer, dark), own)


def cameras(trial: Trial) -> int:
    """Number of cameras that filmed it."""
    return 0 if trial.film is None else len(trial.film.cameras)


def without_camera(trial: Trial, rng: np.random.Generator) -> Trial:
    """A trial of which one camera knows nothing; positions to compare with stay those of all."""
    film = trial.film
    assert film is not None
    left = np.delete(np.arange(len(film.cameras)), rng.integers(len(film.cameras)))
    uv_px, names = film.pixels.uv_px[left], tuple(film.pixels.cameras[c] for c in left)
    pixels = replace(film.pixels, uv_px=uv_px, cameras=names)
    return replace(trial, film=replace(film, pixels=pixels, cameras=tuple(film.cameras[c] for c in left)))


def cells_of(thing: str, less: Outcome, more: Outcome) -> Iterator[dict]:
    """Rows of the kinds of gaps that both have."""
    with_it = {(score.scenario, score.gap): score for score in more.scores}
    for score in less.scores:
        other = with_it.get((score.scenario, score.gap))
        if other is not None:
            of = {"less_mm": score.rmse_mm, "more_mm": other.rmse_mm, "less_z": score.z, "more_z": other.z}
            yield {"more": thing, "scenario": score.scenario, "gap": score.gap} | of


def table(draws: pd.DataFrame) -> pd.DataFrame:
    """A row for each set, thing and length of gap (see above); draws of a trial with a seed are one."""
    rows = []
    for (name, thing, gap), part in draws.groupby(["set", "more", "gap"], sort=False):
        part = part.assign(change=np.log(part["more_mm"] / part["less_mm"]))
        change = part.groupby(["trial", "seed"])["change"].mean()
        error = float(change.std(ddof=1) / np.sqrt(len(change))) if len(change) > 1 else np.nan
        z = {which: float(np.sqrt(np.mean(part[which] ** 2))) for which in ("less_z", "more_z")}
        inside = {which: RIGHT[0] <= value <= RIGHT[1] for which, value in z.items()}
        mean = float(change.mean())
        rows.append(
            {"set": name, "more": thing, "gap": gap, "draws": len(change)}
            | {"change_%": 100 * (np.exp(mean) - 1), "error_%": 100 * error}
            | z
            | {"breaks": bool(mean > error) or (inside["less_z"] and not inside["more_z"])}
        )
    return pd.DataFrame(rows)


if __name__ == "__main__":
    sys.exit(main())
