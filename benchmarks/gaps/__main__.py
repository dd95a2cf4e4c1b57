"""Methods of filling gaps side by side: ``python -m benchmarks.gaps [--quick] --out DIR``.

One table on stdout (see ``benchmarks.gaps.table``), progress and failures on stderr. Into the folder: ``folds.csv``
(each method, trial, seed and kind of gap, as it comes), ``table.csv`` (trials pooled), ``ratios.csv`` (each method
against the best of each cell, with standard errors), ``summary.csv``, ``error.png``, ``coverage.png``.
"""

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from benchmarks.gaps import plots
from benchmarks.gaps.hide import GAPS, SCENARIOS, cells, excerpt
from benchmarks.gaps.method import Trial
from benchmarks.gaps.protocol import FULL, TEST_FRAMES, Plan, plan, run_fold, shown_trials
from benchmarks.gaps.registry import methods
from benchmarks.gaps.sets import SETS, load
from benchmarks.gaps.table import FOLDS, as_text, pooled, ratios, summary
from mocap.errors import MocapError

QUICK_SECONDS = 165
"""``--quick`` starts no method later than that."""


@dataclass(frozen=True, kw_only=True)
class Extent:
    """How much of the protocol is run.

    Attributes:
        seeds: Seeds of the gaps.
        scenarios: Of gaps.
        lengths: Of gaps.
        folds: Trials that are left out, at most.
        training: Trials to learn from, at most.
        frames: Of a trial, at most, in tests and (``--quick``) in training.
    """

    seeds: tuple[int, ...] = (0, 1, 2)
    scenarios: tuple[str, ...] = SCENARIOS
    lengths: tuple[int, ...] = GAPS
    folds: int = 100
    training: int = 100
    frames: int = TEST_FRAMES

    @property
    def short(self) -> bool:
        """Whether training trials are cut as well."""
        return self.training < 100


QUICK = Extent(seeds=(0,), scenarios=("single", "limb"), lengths=(10, 50), folds=1, training=2, frames=160)
QUICK_PLAN = Plan(trials=1, frames=160, lengths=(10, 50, 10, 50))
QUICK_SETS = ("bat", "mouse", "snake_glide", "twin_lizard")


@dataclass(frozen=True, kw_only=True)
class Task:
    """One method on one fold of a set."""

    name: str
    trial: int
    method: str
    extent: Extent


def fold_trials(name: str, left_out: int, extent: Extent) -> tuple[list[Trial], int]:
    """The trials of a fold, as many and as long as wanted, and the place of the one that is left out."""
    trials = load(name)
    if not extent.short:
        return trials, left_out
    others = [trial for i, trial in enumerate(trials) if i != left_out][: extent.training]
    rng = np.random.default_rng(0)
    return [excerpt(trial, extent.frames, rng) for trial in others] + [trials[left_out]], len(others)


def run(task: Task) -> tuple[list[dict], str | None]:
    """Rows of ``folds.csv``, and what went wrong if it did (the numbers are NaN then)."""
    trials, left_out = fold_trials(task.name, task.trial, task.extent)
    wanted = cells(scenarios=task.extent.scenarios, lengths=task.extent.lengths)
    method = next(method for method in methods() if method.name == task.method)
    token = plan.set(QUICK_PLAN if task.extent.short else FULL)
    try:
        with threadpool_limits(1):
            outcomes = run_fold(
                method, trials, left_out, seeds=task.extent.seeds, wanted=wanted, frames=task.extent.frames
            )
    except Exception as error:  # a method may fail in any way; the others go on
        return empty_rows(task), f"{type(error).__name__}: {error}"
    finally:
        plan.reset(token)
    return [
        row(task, seed, trials[left_out].name, score.__dict__ | {"seconds": outcome.seconds, "frames": outcome.frames})
        for seed, outcome in zip(task.extent.seeds, outcomes, strict=True)
        for score in outcome.scores
    ], None


def row(task: Task, seed: int, trial: str, values: dict) -> dict:
    """A row of ``folds.csv``."""
    return {"set": task.name, "method": task.method, "seed": seed, "trial": trial} | values


def empty_rows(task: Task) -> list[dict]:
    """Rows without numbers, for the kinds of gaps that the trial holds."""
    trials, left_out = fold_trials(task.name, task.trial, task.extent)
    wanted = cells(scenarios=task.extent.scenarios, lengths=task.extent.lengths)
    nothing = dict.fromkeys(("rmse_mm", "coverage95", "nll", "seconds", "frames"), np.nan)
    out = []
    for seed in task.extent.seeds:
        shown = shown_trials(trials[left_out], seed, wanted, frames=task.extent.frames)
        held: dict[tuple[str, int], int] = {}
        for gap in (gap for copy in shown for gap in copy.gaps):
            held[gap.scenario, gap.length] = (
                held.get((gap.scenario, gap.length), 0) + int(gap.scored.sum()) * gap.length
            )
        for (scenario, length), samples in sorted(held.items()):
            values = {"scenario": scenario, "gap": length, "samples": samples} | nothing
            out.append(row(task, seed, trials[left_out].name, values))
    return out


def results(tasks: Sequence[Task], jobs: int, deadline: float) -> Iterator[tuple[Task, list[dict], str | None]]:
    """Run tasks in order, or by processes; after the deadline rows are empty."""
    if jobs > 1:
        with get_context("spawn").Pool(jobs) as pool:
            for task, (rows, trouble) in zip(tasks, pool.imap(run, tasks), strict=True):
                yield task, rows, trouble
        return
    for task in tasks:
        late = time.perf_counter() > deadline
        rows, trouble = (empty_rows(task), "out of time") if late else run(task)
        yield task, rows, trouble


def main() -> int:
    """Run the benchmark; exit 0, or 1 where no set can be loaded."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gaps", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="a part of it, in less than three minutes")
    parser.add_argument("--sets", nargs="+", choices=SETS, help="default: all; with --quick " + ", ".join(QUICK_SETS))
    parser.add_argument("--methods", nargs="+", help="names; default: all")
    parser.add_argument("--seeds", type=int, help="number of seeds (3)")
    parser.add_argument("--folds", type=int, help="trials of each set that are left out, at most (all)")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--resume", action="store_true", help="keep what folds.csv in the folder has")
    parser.add_argument("--out", type=Path, required=True, help="folder for tables and pictures")
    args = parser.parse_args()
    begin = time.perf_counter()
    known = [method.name for method in methods()]
    unknown = sorted(set(args.methods or []) - set(known))
    if unknown:
        parser.error(f"no method {', '.join(unknown)}; there are {', '.join(known)}")
    chosen = [name for name in known if not args.methods or name in args.methods]
    extent = QUICK if args.quick else Extent()
    if args.seeds:
        extent = replace(extent, seeds=tuple(range(args.seeds)))
    if args.folds:
        extent = replace(extent, folds=args.folds)
    tasks = []
    for name in args.sets or (QUICK_SETS if args.quick else tuple(SETS)):
        try:
            trials = load(name)
        except (MocapError, OSError, ValueError) as error:
            print(f"{name}: left out: {error}", file=sys.stderr)
            continue
        folds = range(min(len(trials), extent.folds))
        tasks += [Task(name=name, trial=k, method=method, extent=extent) for k in folds for method in chosen]
    if not tasks:
        print("no set could be loaded: set MOCAP_REAL_DATA to the folder of the recordings", file=sys.stderr)
        return 1
    args.out.mkdir(parents=True, exist_ok=True)
    rows = _collect(tasks, args, begin + (QUICK_SECONDS if args.quick else np.inf))
    folds = pd.DataFrame(rows, columns=FOLDS)
    _write(folds, args.out, final=True)
    print(as_text(summary(folds)))
    print(f"{time.perf_counter() - begin:.0f} s; {args.out}", file=sys.stderr)
    return 0


def _collect(tasks: Sequence[Task], args: argparse.Namespace, deadline: float) -> list[dict]:
    """Rows of all tasks; ``folds.csv`` grows by each, the other tables are written every half minute."""
    path = args.out / "folds.csv"
    rows: list[dict] = []
    if args.resume and path.exists():
        rows = pd.read_csv(path).to_dict("records")
        done = {(r["set"], r["trial"], r["method"]) for r in rows if np.isfinite(r["rmse_mm"])}
        rows = [r for r in rows if (r["set"], r["trial"], r["method"]) in done]
        tasks = [t for t in tasks if (t.name, load(t.name)[t.trial].name, t.method) not in done]
    pd.DataFrame(rows, columns=FOLDS).to_csv(path, index=False)
    written = before = time.perf_counter()
    for count, (task, new, trouble) in enumerate(results(tasks, args.jobs, deadline), start=1):
        rows += new
        pd.DataFrame(new, columns=FOLDS).to_csv(path, mode="a", header=False, index=False)
        mean = np.exp(np.mean([np.log(r["rmse_mm"]) for r in new])) if new else np.nan
        trial = new[0]["trial"] if new else task.trial
        line = f"{count}/{len(tasks)} {task.name} {trial} {task.method}: "
        now = time.perf_counter()
        print(
            line + (f"FAILED: {trouble}" if trouble else f"{mean:.2f} mm, {now - before:.1f} s"),
            file=sys.stderr,
            flush=True,
        )
        before = now
        if now - written > 30:
            _write(pd.DataFrame(rows, columns=FOLDS), args.out, final=False)
            written = now
    return rows


def _write(folds: pd.DataFrame, out: Path, *, final: bool) -> None:
    table = pooled(folds)
    table.to_csv(out / "table.csv", index=False, float_format="%.6g")
    summary(folds).to_csv(out / "summary.csv", index_label="method", float_format="%.6g")
    ratios(folds).to_csv(out / "ratios.csv", index=False, float_format="%.4g")
    if final:
        plots.draw(folds, table, out)


if __name__ == "__main__":
    sys.exit(main())
