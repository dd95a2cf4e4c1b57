"""The protocol: leave a trial out, learn from the others, hide what was measured, compare.

Truth are the measured samples of the trial that was left out; intervals are judged as intervals of measurements. All
methods meet the same gaps (seeded by trial and seed). ``tune`` gives all peers the same validation: gaps in training
trials only. Ours is what users run (``benchmarks.gaps.ours``): its search hides no more gaps there to choose by, as
many again to learn weights and widths of a mixture, and some in what the trial that is filled shows.
"""

import time
import zlib
from collections.abc import Callable, Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeVar

import numpy as np
from mocap.filters import score as one_score

from benchmarks.gaps.hide import GAPS, SCENARIOS, Cell, Gap, cells, excerpt, hide
from benchmarks.gaps.method import Estimate, Filler, Method, Oracle, Trial, reads_rays
from benchmarks.gaps.prepared import recording
from benchmarks.gaps.rays import RAYS, Shown, with_rays
from eal.arrays import Array

TEST_FRAMES = 500
"""Longer trials are tested on an excerpt, another one for each seed."""

Candidate = TypeVar("Candidate")


@dataclass(frozen=True, kw_only=True)
class Plan:
    """How much ``validation`` does.

    Attributes:
        trials: Training trials that are folds of it, at most.
        frames: Of such a trial, at most.
        lengths: Of gaps; one may be named several times. They go round with the four scenarios: in one trial a length
            comes with one of these, over four trials with all.
    """

    trials: int = 4
    frames: int = 500
    lengths: tuple[int, ...] = GAPS * 4


FULL = Plan()
plan: ContextVar[Plan] = ContextVar("plan", default=FULL)
"""The plan that ``validation`` follows: the same for all peers of a run, so that all are tuned alike."""


@dataclass(frozen=True, kw_only=True)
class Score(one_score.Score):
    """How one method did in the gaps of one kind in one trial.

    Attributes:
        scenario: Of the gaps.
        gap: Their length in frames.
        rays: Cameras that are left in them.
    """

    scenario: str
    gap: int
    rays: int


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """One method on one trial with one seed.

    Attributes:
        scores: One for each kind of gap.
        seconds: Processor time of filling, all threads together.
        frames: That were filled in that time.
    """

    scores: tuple[Score, ...]
    seconds: float
    frames: int


def shown_trials(
    trial: Trial,
    seed: int,
    wanted: Sequence[Cell],
    *,
    frames: int = TEST_FRAMES,
    rays: Sequence[int] = (0,),
    once: bool = False,
) -> list[Shown]:
    """The gaps that every method meets in a trial with a seed: the same with each number of rays that is left.

    Args:
        trial: As measured.
        seed: Where and which.
        wanted: Kinds of gaps.
        frames: Longer trials are cut.
        rays: Cameras that are left; more than 0 only where the trial has a film.
        once: Whether only those copies of the trial are taken that hold a kind of gap which those before lack.
    """
    return list(_shown(trial, seed, tuple(wanted), frames, tuple(rays), once))


@lru_cache(maxsize=8)
def _shown(
    trial: Trial, seed: int, wanted: tuple[Cell, ...], frames: int, rays: tuple[int, ...], once: bool
) -> tuple[Shown, ...]:
    """``shown_trials``, once for all methods of a fold."""
    rng = np.random.default_rng([seed, zlib.crc32(trial.name.encode())])
    hidden, held, out = [], set[Cell](), []
    for copy in hide(excerpt(trial, frames, rng), wanted, rng):
        new = {(gap.kind, gap.length) for gap in copy.gaps} - held
        if new or not once:
            hidden.append(copy)
        held |= new
    for left in rays if trial.film is not None else (0,):
        which = np.random.default_rng([seed, zlib.crc32(trial.name.encode()), 2])
        out += [with_rays(copy, left, which) for copy in hidden]
    return tuple(out)


def evaluate(filler: Filler, shown: Sequence[Shown], *, by_rays: bool = True) -> Outcome:
    """Fill and compare.

    Args:
        filler: A method that has learned from other trials.
        shown: Copies of a trial with gaps.
        by_rays: False: the method sees no rays, and fills copies that differ in these alone once.

    Raises:
        ValueError: the method leaves a hidden sample without a value, or gives other shapes.
    """
    found: dict[tuple[str, int, int], list[tuple[Array, Array | None]]] = {}
    known: dict[tuple[Gap, ...], Estimate] = {}
    seconds, frames = 0.0, 0
    for copy in shown:
        filled = None if by_rays else known.get(copy.gaps)
        if filled is None:
            if by_rays and copy.trial.film is not None:
                recording(copy.shown)  # triangulated and cleaned once for all methods, which is not timed
            begin = time.process_time()
            filled = known[copy.gaps] = filler(copy.shown)
            seconds += time.process_time() - begin
            frames += len(copy.trial.t_s)
        for gap in copy.gaps:
            found.setdefault((gap.kind, gap.length, copy.rays), []).append(errors(filled, copy.trial, gap))
    scores = []
    for (scenario, length, rays), parts in sorted(found.items(), key=lambda item: item[0]):
        covs = [cov for _, cov in parts if cov is not None]
        value = one_score.score(np.concatenate([error for error, _ in parts]), np.concatenate(covs) if covs else None)
        scores.append(Score(scenario=scenario, gap=length, rays=rays, **vars(value)))
    return Outcome(scores=tuple(scores), seconds=seconds, frames=frames)


def errors(filled: Estimate, truth: Trial, gap: Gap) -> tuple[Array, Array | None]:
    """Of the K scored samples of a gap: errors (K, 3) in metres, covariances (K, 3, 3) that were stated for them.

    Raises:
        ValueError: a sample has no value, shapes differ, or a covariance is none.
    """
    if filled.xyz_m.shape != truth.xyz_m.shape:
        raise ValueError(f"filled positions have shape {filled.xyz_m.shape}, the trial {truth.xyz_m.shape}")
    error = (filled.xyz_m - truth.xyz_m)[gap.frames][:, gap.scored].reshape(-1, 3)
    if not np.isfinite(error).all():
        lost = int((~np.isfinite(error).all(axis=1)).sum())
        raise ValueError(f"{lost} of {len(error)} samples of a gap ({gap.kind}, {gap.length}) have no value")
    if filled.cov_m2 is None:
        return error, None
    cov = filled.cov_m2[gap.frames][:, gap.scored].reshape(-1, 3, 3)
    if len(error) and np.isnan(one_score.score(error, cov).nll):
        raise ValueError(f"a covariance of a gap ({gap.kind}, {gap.length}) is not positive definite")
    return error, cov


def run_fold(
    method: Method,
    trials: Sequence[Trial],
    left_out: int,
    *,
    seeds: Sequence[int],
    wanted: Sequence[Cell],
    frames: int = TEST_FRAMES,
    rays: Sequence[int] = (0,),
    once: bool = False,
) -> list[Outcome]:
    """Learn from all trials but one, and fill that one: an outcome a seed."""
    training = [trial for i, trial in enumerate(trials) if i != left_out]
    truth = trials[left_out]
    filler = method.learn_with_truth(training, truth) if isinstance(method, Oracle) else method.learn(training)
    shown = [shown_trials(truth, seed, wanted, frames=frames, rays=rays, once=once) for seed in seeds]
    return [evaluate(filler, part, by_rays=reads_rays(method)) for part in shown]


@dataclass(frozen=True, eq=False, kw_only=True)
class Validation:
    """One fold of the validation inside the training trials.

    Attributes:
        rest: Trials to learn from.
        shown: Copies of another training trial, with gaps.
    """

    rest: tuple[Trial, ...]
    shown: tuple[Shown, ...]


def validation(training: Sequence[Trial]) -> list[Validation]:
    """Folds over the first training trials (see ``Plan``): gaps of every length, with the scenarios in turn.

    With one training trial its own gaps are filled by what was learned from the rest of it.
    """
    out = []
    now = plan.get()
    for k, trial in enumerate(training[: now.trials]):
        rng = np.random.default_rng([k, zlib.crc32(trial.name.encode()), 1])
        # other trials begin with another scenario
        wanted = [(SCENARIOS[(i + k) % len(SCENARIOS)], length) for i, length in enumerate(now.lengths)]
        copies = hide(excerpt(trial, now.frames, rng), wanted, rng)
        left = RAYS if trial.film is not None else (0,)  # what may be left of a film goes round, too
        shown = [with_rays(copy, left[i % len(left)], rng) for i, copy in enumerate(copies)]
        rest = [other for i, other in enumerate(training) if i != k]
        if not rest:
            out += [Validation(rest=(copy.shown,), shown=(copy,)) for copy in shown]
        elif shown:
            out.append(Validation(rest=tuple(rest), shown=tuple(shown)))
    return out


def validation_score(filler_of: Callable[[Sequence[Trial]], Filler], folds: Sequence[Validation]) -> float:
    """Mean over gap lengths of ln RMSE (mm), pooled over folds and scenarios; inf where a fill fails."""
    squares: dict[int, list[Array]] = {}
    try:
        for fold in folds:
            filler = filler_of(fold.rest)
            for copy in fold.shown:
                filled = filler(copy.shown)
                for gap in copy.gaps:
                    error, _ = errors(filled, copy.trial, gap)
                    squares.setdefault(gap.length, []).append(np.sum(error**2, axis=1))
    except (ValueError, ArithmeticError, np.linalg.LinAlgError):
        return float("inf")
    return float(np.mean([0.5 * np.log(1e6 * np.concatenate(parts).mean()) for parts in squares.values()]))


def tune(
    candidates: Sequence[Candidate],
    training: Sequence[Trial],
    learn: Callable[[Candidate, Sequence[Trial]], Filler],
) -> Filler:
    """Learn from all training trials with the candidate that fills the gaps of the validation best.

    Args:
        candidates: Hyper-parameters to try, in order of preference.
        training: Trials; nothing else is looked at.
        learn: Learns from trials with given hyper-parameters.
    """
    best = choose(candidates, training, learn) if len(candidates) > 1 else candidates[0]
    return learn(best, training)


def choose(
    candidates: Sequence[Candidate],
    training: Sequence[Trial],
    learn: Callable[[Candidate, Sequence[Trial]], Filler],
) -> Candidate:
    """The candidate of ``tune``; the first where no gap can be hidden or nothing works."""
    folds = validation(training)
    if not folds:
        return candidates[0]

    def score(candidate: Candidate) -> float:
        return validation_score(lambda rest: learn(candidate, rest), folds)

    return min(candidates, key=score)


__all__ = [
    "FULL",
    "Outcome",
    "Plan",
    "Score",
    "Validation",
    "cells",
    "choose",
    "evaluate",
    "plan",
    "run_fold",
    "shown_trials",
    "tune",
    "validation",
    "validation_score",
]
