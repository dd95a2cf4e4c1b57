"""The released tools as methods of the benchmark."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from benchmarks.gaps.method import Estimate, Filler, Method, Trial
from benchmarks.gaps.peers.coordinates import Body, World, learn_body
from benchmarks.gaps.peers.interpolation import CURVES, through
from benchmarks.gaps.peers.intervals import tune
from benchmarks.gaps.peers.poses import completed
from benchmarks.gaps.peers.released.process import run
from eal.arrays import Array

LEARNING_FRAMES = 200
"""Frames of a trial that EM and EKS's optimiser are shown."""


@dataclass(frozen=True, eq=False)
class ToolFiller:
    """A tool with its options, in some coordinates; measured samples are kept."""

    tool: str
    coordinates: Body | World
    options: dict[str, Any]
    guess: bool = False

    def __call__(self, trial: Trial) -> Estimate:
        """Run the tool."""
        placed = self.coordinates.place(trial)
        more = {}
        if self.guess:
            curve, least = CURVES["cubic"]
            more["guess"] = 1e3 * through(placed.y, trial.t_s, curve, least=least)
        options = {**self.options, "fps": round(1 / float(np.mean(np.diff(trial.t_s))))}
        found, cov = run(self.tool, 1e3 * placed.y, 1e3 * trial.sd_m, options, **more)
        y = np.where(np.isfinite(placed.y), placed.y, 1e-3 * found)
        return placed.leave(y, None if cov is None else 1e-6 * cov)


@dataclass(frozen=True)
class Pose2Sim:
    """pose2sim's interpolation and one of its filters."""

    name: str
    filter: str
    values: tuple[float, ...]

    def learn(self, training: Sequence[Trial]) -> Filler:
        """Choose the interpolation and the filter's parameter; a cutoff is a share of the Nyquist frequency."""
        nyquist = 0.5 / float(np.mean(np.diff(training[0].t_s)))

        def fit(candidate: tuple[str, float], _trials: Sequence[Trial]) -> Filler:
            kind, value = candidate
            options = {
                "filter": self.filter,
                "kind": kind,
                "trust_ratio": value,
                "cutoff_hz": max(1, int(value * nyquist)),
            }
            return ToolFiller("pose2sim", World(), options)

        return tune([(kind, value) for kind in ("cubic", "linear") for value in self.values], training, fit)


@dataclass(frozen=True)
class PyKalman:
    """pykalman's EM on a stretch of a training trial, and its smoother."""

    name: str = "pykalman"

    def learn(self, training: Sequence[Trial]) -> Filler:
        """Choose coordinates and a factor on the transition covariance that EM finds."""

        @cache
        def learned(body: bool, trials: tuple[Trial, ...]) -> tuple[Body | World, Array]:
            coordinates = learn_body(trials) if body else World()
            y = best_stretch([coordinates.place(trial).y for trial in trials])
            found, _ = run("pykalman", 1e3 * y, 1e3 * trials[0].sd_m, {"em": 4, "density": 0.1})
            return coordinates, found

        def fit(candidate: tuple[bool, float], trials: Sequence[Trial]) -> Filler:
            coordinates, found = learned(candidate[0], tuple(trials))
            return ToolFiller("pykalman", coordinates, {"density": 0.1, "transition": (candidate[1] * found).tolist()})

        return tune([(True, 1.0), (True, 0.1), (False, 1.0)], training, fit)


@dataclass(frozen=True)
class Eks:
    """EKS of single markers (``sizes`` empty), or of principal components of all."""

    name: str
    sizes: tuple[int, ...] = field(default=())

    def learn(self, training: Sequence[Trial]) -> Filler:
        """Run EKS's own optimiser of s; choose the components."""

        @cache
        def learned(size: int, trials: tuple[Trial, ...]) -> tuple[Body, dict[str, Any], Array]:
            body = learn_body(trials)
            placed = [body.place(trial) for trial in trials]
            poses = [1e3 * p for p in completed(placed)]
            stacked, steps = np.concatenate(poses), np.concatenate([np.diff(p, axis=0) for p in poses])
            options: dict[str, Any]
            if size:
                mean = stacked.mean(axis=0)
                values, vectors = np.linalg.eigh(np.cov(stacked.T))
                loading = vectors[:, ::-1][:, :size]
                step_cov = np.cov((steps @ loading).T).reshape(size, size)
                options = {"form": "pca", "mean": mean.tolist(), "loading": loading.tolist()}
                options |= {"start_var": values[::-1][:size].tolist(), "step_cov": normed(step_cov).tolist()}
            else:
                blocks = steps.reshape(len(steps), -1, 3)
                cov = [normed(np.cov(blocks[:, m].T)).tolist() for m in range(blocks.shape[1])]
                options = {"form": "marker", "step_cov": cov}
            y = best_stretch([p.y for p in placed])
            s, _ = run("eks", 1e3 * y, 1e3 * trials[0].sd_m, options)
            return body, options, s

        def fit(size: int, trials: Sequence[Trial]) -> Filler:
            body, options, s = learned(size, tuple(trials))
            return ToolFiller("eks", body, {**options, "s": s.tolist()})

        return tune(self.sizes or (0,), training, fit)


def normed(cov: Array) -> Array:
    """A covariance over its largest entry, as EKS takes it."""
    return cov / max(float(np.abs(cov).max()), 1e-12)


def best_stretch(series: Sequence[Array]) -> Array:
    """The best seen ``LEARNING_FRAMES`` of several (T, M, 3) series."""
    best, most = series[0][:LEARNING_FRAMES], -1.0
    for y in series:
        total = np.concatenate([[0.0], np.cumsum(np.isfinite(y[..., 0]).sum(axis=1))])
        length = min(LEARNING_FRAMES, len(y))
        sums = total[length:] - total[: len(total) - length]
        if sums.max() > most:
            start, most = int(np.argmax(sums)), float(sums.max())
            best = y[start : start + length]
    return best


@dataclass(frozen=True)
class Anipose:
    """aniposelib's ``optim_points``."""

    name: str = "anipose"

    def learn(self, training: Sequence[Trial]) -> Filler:
        """Choose the smoothness; bones are pairs of markers whose distance changes least in training."""

        def fit(candidate: tuple[float, int], trials: Sequence[Trial]) -> Filler:
            smooth, order = candidate
            options = {"scale_smooth": smooth, "n_deriv_smooth": order, "scale_length": 2.0, "window": 150}
            return ToolFiller("anipose", World(), {**options, "bones": bones(trials)}, guess=True)

        return tune([(4.0, 2), (2.0, 3)], training, fit)


def bones(trials: Sequence[Trial], *, spread: float = 0.05) -> list[list[int]]:
    """Pairs of markers whose distance varies by less than a share, the stiffest first, one tree a set of markers."""
    xyz = np.concatenate([trial.xyz_m for trial in trials])
    pairs = []
    for a in range(xyz.shape[1]):
        for b in range(a):
            length = np.linalg.norm(xyz[:, a] - xyz[:, b], axis=-1)
            length = length[np.isfinite(length)]
            if len(length) > 20:
                pairs.append((float(length.std() / length.mean()), b, a))
    group = list(range(xyz.shape[1]))
    chosen = []
    for share, b, a in sorted(pairs):
        if share < spread and group[a] != group[b]:
            chosen.append([b, a])
            group = [group[b] if g == group[a] else g for g in group]
    return chosen


def tools() -> tuple[Method, ...]:
    """All of them."""
    return (
        Pose2Sim("pose2sim_kalman", "kalman", (100, 1000, 10000)),
        Pose2Sim("pose2sim_butterworth", "butterworth", (0.05, 0.1, 0.3)),
        PyKalman(),
        Eks("eks"),
        Eks("eks_pca", (3, 8)),
        Anipose(),
    )
