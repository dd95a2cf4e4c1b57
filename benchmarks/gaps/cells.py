"""One method on one fold, here or in another process."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby
from multiprocessing import get_context

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.gaps.hide import GAPS, SCENARIOS, cells, excerpt
from benchmarks.gaps.method import Trial
from benchmarks.gaps.protocol import FULL, TEST_FRAMES, Plan, plan, run_fold, shown_trials
from benchmarks.gaps.rays import RAYS
from benchmarks.gaps.registry import methods
from benchmarks.gaps.sets import load, teachers


@dataclass(frozen=True, kw_only=True)
class Extent:
    """How much of the protocol is run.

    Attributes:
        seeds: Seeds of the gaps.
        scenarios: Of gaps.
        lengths: Of gaps.
        rays: Cameras that are left in gaps, of sets with pixels.
        folds: Trials that are left out, at most.
        training: Trials to learn from, at most.
        frames: Of a trial, at most, in tests and (``--quick``) in training.
        once: Whether only as many copies of a trial are filled as hold each kind of gap once.
    """

    seeds: tuple[int, ...] = tuple(range(10))
    scenarios: tuple[str, ...] = SCENARIOS
    lengths: tuple[int, ...] = GAPS
    rays: tuple[int, ...] = RAYS
    folds: int = 100
    training: int = 100
    frames: int = TEST_FRAMES
    once: bool = False

    @property
    def short(self) -> bool:
        """Whether training trials are cut as well."""
        return self.training < 100


QUICK = Extent(seeds=(0, 1, 2), scenarios=("limb",), lengths=(10, 50), folds=1, training=2, frames=160, once=True)
QUICK_PLAN = Plan(trials=1, frames=160, lengths=(10, 50, 10, 50))
QUICK_SETS = ("twin_speeds", "bat", "bat_flights", "bat_other", "snake_other", "mouse")
"""Two of each: several gaits, other animals, one animal in one gait; the first can be made without recordings."""


@dataclass(frozen=True, kw_only=True)
class Task:
    """One method on one fold of a set."""

    name: str
    trial: int
    method: str
    extent: Extent


@lru_cache(maxsize=4)
def fold_trials(name: str, left_out: int, extent: Extent) -> list[Trial]:
    """The trials of a fold, as many and as long as wanted; the last is left out. Methods that follow get the same."""
    trials = load(name, extent.folds + extent.training if extent.short else None)
    others = [trials[i] for i in teachers(name, trials, left_out)][: extent.training]
    if extent.short:
        rng = np.random.default_rng(0)
        others = [excerpt(trial, extent.frames, rng) for trial in others]
    return [*others, trials[left_out]]


def trained_on(trials: Sequence[Trial]) -> str:
    """What a method learns from, beside the last trial: ``same``, ``other animal``, or ``several gaits``."""
    *others, left_out = trials
    if left_out.animal not in {trial.animal for trial in others}:
        return "other animal"
    return "several gaits" if len({trial.gait for trial in trials}) > 1 else "same"


def run(task: Task) -> tuple[list[dict], str | None]:
    """Rows of ``folds.csv``, and what went wrong if it did (the numbers are NaN then)."""
    trials = fold_trials(task.name, task.trial, task.extent)
    wanted = cells(scenarios=task.extent.scenarios, lengths=task.extent.lengths)
    method = next(method for method in methods() if method.name == task.method)
    token = plan.set(QUICK_PLAN if task.extent.short else FULL)
    try:
        with threadpool_limits(1):
            outcomes = run_fold(
                method,
                trials,
                len(trials) - 1,
                seeds=task.extent.seeds,
                wanted=wanted,
                frames=task.extent.frames,
                rays=task.extent.rays,
                once=task.extent.once,
            )
    except Exception as error:  # a method may fail in any way; the others go on
        return empty_rows(task), f"{type(error).__name__}: {error}"
    finally:
        plan.reset(token)
    return [
        row(task, seed, trials, vars(score) | {"seconds": outcome.seconds, "frames": outcome.frames})
        for seed, outcome in zip(task.extent.seeds, outcomes, strict=True)
        for score in outcome.scores
    ], None


def row(task: Task, seed: int, trials: Sequence[Trial], values: dict) -> dict:
    """A row of ``folds.csv``."""
    place = {"set": task.name, "method": task.method, "seed": seed, "trial": trials[-1].name}
    return place | {"trained_on": trained_on(trials)} | values


def empty_rows(task: Task) -> list[dict]:
    """Rows without numbers, for the kinds of gaps that the trial holds."""
    trials = fold_trials(task.name, task.trial, task.extent)
    wanted = cells(scenarios=task.extent.scenarios, lengths=task.extent.lengths)
    nothing = dict.fromkeys(("rmse_mm", "coverage95", "nll", "seconds", "frames"), np.nan)
    out = []
    for seed in task.extent.seeds:
        extent = task.extent
        shown = shown_trials(trials[-1], seed, wanted, frames=extent.frames, rays=extent.rays, once=extent.once)
        held: dict[tuple[str, int, int], int] = {}
        for copy in shown:
            for gap in copy.gaps:
                cell = (gap.kind, gap.length, copy.rays)
                held[cell] = held.get(cell, 0) + int(gap.scored.sum()) * gap.length
        for (scenario, length, rays), samples in sorted(held.items()):
            values = {"scenario": scenario, "gap": length, "rays": rays, "samples": samples} | nothing
            out.append(row(task, seed, trials, values))
    return out


def run_together(tasks: Sequence[Task]) -> list[tuple[list[dict], str | None]]:
    """``run`` of several tasks in one process: methods that share what they learn of a fold learn it once."""
    return [run(task) for task in tasks]


def results(tasks: Sequence[Task], jobs: int) -> Iterator[tuple[Task, list[dict], str | None]]:
    """Run tasks in order; folds by processes, if several are wanted."""
    if jobs == 1:
        yield from ((task, *run(task)) for task in tasks)
        return
    folds = [list(group) for _, group in groupby(tasks, key=lambda task: (task.name, task.trial))]
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        for group, found in zip(folds, pool.map(run_together, folds), strict=True):
            yield from ((task, rows, trouble) for task, (rows, trouble) in zip(group, found, strict=True))
