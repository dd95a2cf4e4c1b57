"""Methods of filling gaps side by side: ``python -m benchmarks.gaps [--quick] --out DIR``.

Two tables on stdout (``benchmarks.gaps.table``, ``benchmarks.gaps.comparison``), progress and failures on stderr.
Into the folder: ``folds.csv`` (each method, trial, seed and kind of gap, as it comes), ``table.csv`` (trials pooled),
``ratios.csv`` (each method against the best of each cell, with standard errors), ``summary.csv`` (a row a method),
``draws.csv`` (each set and method: its spread over draws of gaps, and processor time a draw),
``comparison.csv`` (EAL beside the best peer, its controls and the oracle), ``error.png``, ``coverage.png``.
"""

import argparse
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.gaps import plots
from benchmarks.gaps.cells import QUICK, QUICK_SETS, Extent, Task, fold_trials, results
from benchmarks.gaps.comparison import as_lines, comparison, overall
from benchmarks.gaps.method import needs_film
from benchmarks.gaps.oracle import EalOracle
from benchmarks.gaps.ours import alone, ours
from benchmarks.gaps.registry import methods
from benchmarks.gaps.sets import FILMED, SETS, size
from benchmarks.gaps.table import FOLDS, against_best, as_sentence, as_text, draws, pooled, ratios, summary
from mocap.errors import MocapError


def main() -> int:
    """Run the benchmark; exit 0, or 1 where no set can be loaded."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gaps", description=(__doc__ or "").split("\n")[0])
    parser.add_argument(
        "--quick", action="store_true", help="a part of it, some minutes; the same cells on every machine"
    )
    parser.add_argument("--sets", nargs="+", choices=SETS, help="default: all; with --quick " + ", ".join(QUICK_SETS))
    parser.add_argument(
        "--methods",
        nargs="+",
        help="names; default: all; with --quick without parts of EAL alone",
    )
    parser.add_argument("--seeds", type=int, help="number of draws of gaps (10; with --quick 3)")
    parser.add_argument("--folds", type=int, help="trials of each set that are left out, at most (all)")
    parser.add_argument("--jobs", type=int, default=min(2, os.cpu_count() or 1), help="processes (2)")
    parser.add_argument(
        "--resume", action="store_true", help="keep what folds.csv in the folder has, and draw what lacks"
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for tables and pictures")
    args = parser.parse_args()
    begin = time.perf_counter()
    known = [method.name for method in methods()]
    unknown = sorted(set(args.methods or []) - set(known))
    if unknown:
        parser.error(f"no method {', '.join(unknown)}; there are {', '.join(known)}")
    slow = {method.name for method in alone()} if args.quick else set()
    chosen = [name for name in known if (name in args.methods if args.methods else name not in slow)]
    extent = QUICK if args.quick else Extent()
    if args.seeds:
        extent = replace(extent, seeds=tuple(range(args.seeds)))
    if args.folds:
        extent = replace(extent, folds=args.folds)
    filmed = {method.name for method in methods() if needs_film(method)}
    tasks = []
    for name in args.sets or (QUICK_SETS if args.quick else tuple(SETS)):
        try:
            count = size(name)
        except (MocapError, OSError, ValueError) as error:
            print(f"{name}: left out: {error}", file=sys.stderr)
            continue
        folds = range(min(count, extent.folds))
        tasks += [
            Task(name=name, trial=k, method=method, extent=extent)
            for k in folds
            for method in chosen
            if method not in filmed or name in FILMED
        ]
    if not tasks:
        print("no set could be loaded: set MOCAP_REAL_DATA to the folder of the recordings", file=sys.stderr)
        return 1
    args.out.mkdir(parents=True, exist_ok=True)
    folds = pd.DataFrame(_collect(tasks, args), columns=FOLDS)
    print(as_text(summary(folds)), flush=True)
    own, names = [method.name for method in [*ours(), EalOracle(), *alone()]], set(folds["method"].astype(str))
    peers = sorted(names.difference(own))
    compared = comparison(folds, peers)
    if len(compared):
        compared = pd.concat([compared, overall(compared)])
        compared.to_csv(args.out / "comparison.csv", index=False, float_format="%.4g")
        print(f"\n{as_lines(compared)}\n", flush=True)
    if own[0] in names and peers and len(set(folds["seed"])) > 1:
        by = "trial" if folds.groupby("set")["trial"].nunique().min() > 2 else "seed"
        print(as_sentence(against_best(folds, own[0], peers, by=by), own[0]), flush=True)
    _write(folds, args.out, final=True)
    print(f"{time.perf_counter() - begin:.0f} s; {args.out}", file=sys.stderr)
    return 0


def _collect(tasks: Sequence[Task], args: argparse.Namespace) -> list[dict]:
    """Rows of all tasks.

    ``folds.csv`` grows by each task; the other tables are written every half minute.
    """
    path = args.out / "folds.csv"
    rows: list[dict] = []
    if args.resume and path.exists():
        rows, tasks = resumed(pd.read_csv(path).to_dict("records"), tasks)
    pd.DataFrame(rows, columns=FOLDS).to_csv(path, index=False)
    written = before = time.perf_counter()
    for count, (task, new, trouble) in enumerate(results(tasks, args.jobs), start=1):
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


def resumed(rows: list[dict], tasks: Sequence[Task]) -> tuple[list[dict], list[Task]]:
    """What an earlier run has of some tasks, and what these lack of it: draws that are whole are not made again."""
    tried = {(r["set"], r["trial"], r["method"], r["seed"]) for r in rows}
    lost = {(r["set"], r["trial"], r["method"], r["seed"]) for r in rows if not np.isfinite(r["rmse_mm"])}
    lost |= {(r["set"], r["trial"], r["method"], r["seed"]) for r in rows[-1:]}  # it may be cut off in the middle
    whole, left = tried - lost, []
    for task in tasks:
        trial = fold_trials(task.name, task.trial, task.extent)[-1].name
        seeds = tuple(s for s in task.extent.seeds if (task.name, trial, task.method, s) not in whole)
        if seeds:
            left.append(replace(task, extent=replace(task.extent, seeds=seeds)))
    return [r for r in rows if (r["set"], r["trial"], r["method"], r["seed"]) in whole], left


def _write(folds: pd.DataFrame, out: Path, *, final: bool) -> None:
    table = pooled(folds)
    table.to_csv(out / "table.csv", index=False, float_format="%.6g")
    summary(folds).to_csv(out / "summary.csv", index_label="method", float_format="%.6g")
    draws(folds).to_csv(out / "draws.csv", index=False, float_format="%.4g")
    ratios(folds).to_csv(out / "ratios.csv", index=False, float_format="%.4g")
    if final:
        plots.draw(folds, table, out)


if __name__ == "__main__":
    sys.exit(main())
