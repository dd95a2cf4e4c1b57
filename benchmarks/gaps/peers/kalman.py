"""Kalman smoothers of single markers: constant velocity and constant acceleration.

What motion-analysis programs offer under "Kalman": each marker's coordinate is an integrated Wiener process, filtered
forwards and smoothed backwards (Rauch, Tung & Striebel 1965). The process noise of each marker is the one of largest
marginal likelihood in the training trials, times a factor for all markers that fills hidden gaps best.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from math import factorial

import numpy as np

from benchmarks.gaps.method import Estimate, Filler, Method, Trial
from benchmarks.gaps.peers.coordinates import Body, World, learn_body
from benchmarks.gaps.peers.intervals import tune
from eal.arrays import Array

DENSITIES = 10.0 ** np.arange(-13.0, 0.1)
"""Grid of process noise, in m^2 per frame^(2 order - 1); a parabola finds the best between its points."""


def transition(order: int) -> tuple[Array, Array]:
    """One frame of an ``order`` times integrated Wiener process of unit density, the time in frames.

    F_ij = 1 / (j - i)!, Q_ij = 1 / ((a + b + 1) a! b!) with a = order - 1 - i, b = order - 1 - j: Q is exact for white
    noise in continuous time (Bar-Shalom et al. 2001, equations 6.2.2-4 and 6.2.3-4).
    """
    step = np.array([[1 / factorial(j - i) if j >= i else 0.0 for j in range(order)] for i in range(order)])
    left = [order - 1 - i for i in range(order)]
    noise = np.array([[1 / ((a + b + 1) * factorial(a) * factorial(b)) for b in left] for a in left])
    return step, noise


@dataclass(frozen=True, eq=False)
class Pass:
    """What the filter keeps; a batch of B series with k coordinates each, states of size n.

    Attributes:
        mean: (T, B, n, k) filtered.
        cov: (T, B, n, n) filtered.
        ahead_mean: (T, B, n, k) predicted.
        ahead_cov: (T, B, n, n) predicted.
        log_likelihood: (B,) of all coordinates.
    """

    mean: Array
    cov: Array
    ahead_mean: Array
    ahead_cov: Array
    log_likelihood: Array


def filter_series(y: Array, variance: Array, step: Array, noise: Array, *, mean: Array, cov: Array) -> Pass:
    """Kalman filter of many series at once; the first component of a state is observed.

    Args:
        y: (T, B, k) series; NaN where not seen.
        variance: (B,) variance of an observation.
        step: (n, n) transition.
        noise: (B, n, n) process noise.
        mean: (B, n, k) before the first frame's observation.
        cov: (B, n, n) of each coordinate, before the first frame's observation.
    """
    seen = np.isfinite(y[..., 0])
    values = np.where(seen[..., None], y, 0.0)
    n_frames, n_series, width = y.shape
    size = len(step)
    out = Pass(
        np.empty((n_frames, n_series, size, width)),
        np.empty((n_frames, n_series, size, size)),
        np.empty((n_frames, n_series, size, width)),
        np.empty((n_frames, n_series, size, size)),
        np.zeros(n_series),
    )
    for t in range(n_frames):
        if t:
            mean, cov = step @ mean, step @ cov @ step.T + noise
        out.ahead_mean[t], out.ahead_cov[t] = mean, cov
        total = cov[:, 0, 0] + variance
        innovation = values[t] - mean[:, 0]
        gain = cov[:, :, 0] * (seen[t] / total)[:, None]
        mean = mean + gain[:, :, None] * innovation[:, None, :]
        cov = cov - gain[:, :, None] * cov[:, None, 0, :]
        out.mean[t], out.cov[t] = mean, cov
        density = width * np.log(2 * np.pi * total) + (innovation**2).sum(axis=-1) / total
        out.log_likelihood[:] -= 0.5 * seen[t] * density
    return out


def smooth_series(run: Pass, step: Array) -> tuple[Array, Array]:
    """Rauch-Tung-Striebel smoother: means (T, B, n, k) and covariances (T, B, n, n)."""
    gain = np.linalg.solve(run.ahead_cov[1:], step @ run.cov[:-1]).swapaxes(-1, -2)
    mean, cov = run.mean.copy(), run.cov.copy()
    for t in range(len(mean) - 2, -1, -1):
        mean[t] += gain[t] @ (mean[t + 1] - run.ahead_mean[t + 1])
        cov[t] += gain[t] @ (cov[t + 1] - run.ahead_cov[t + 1]) @ gain[t].swapaxes(-1, -2)
    return mean, cov


def wide_prior(y: Array, order: int) -> tuple[Array, Array]:
    """A first state (B, order, k) at the first sighting, and a wide covariance (B, order, order) for it.

    Args:
        y: (T, B, k) series; NaN where not seen.
        order: Size of the state.
    """
    seen = np.isfinite(y[..., 0])
    first = np.argmax(seen, axis=0)
    start = np.nan_to_num(y[first, np.arange(y.shape[1])])
    mean = np.zeros((y.shape[1], order, y.shape[2]))
    mean[:, 0] = start
    spread = np.array(
        [
            np.ptp(s[np.isfinite(s[:, 0])], axis=0).max() if ok.any() else 1.0
            for s, ok in zip(y.swapaxes(0, 1), seen.T, strict=True)
        ]
    )
    unit = np.maximum(spread, 1e-3)[:, None] * np.array([1.0, 0.3, 0.1])[:order]
    return mean, unit[:, :, None] ** 2 * np.eye(order)


def likeliest_density(series: Sequence[Array], sd_m: Array, order: int) -> Array:
    """(M,) process noise of largest marginal likelihood over (T, M, 3) series of several trials."""
    step, unit = transition(order)
    n_markers, n_grid = len(sd_m), len(DENSITIES)
    total = np.zeros((n_markers, n_grid))
    noise = np.tile(DENSITIES[:, None, None] * unit, (n_markers, 1, 1))
    for y in series:
        wide = np.repeat(y, n_grid, axis=1)
        mean, cov = wide_prior(wide, order)
        run = filter_series(wide, np.repeat(sd_m**2, n_grid), step, noise, mean=mean, cov=cov)
        total += run.log_likelihood.reshape(n_markers, n_grid)
    return np.array([10.0 ** _peak(np.log10(DENSITIES), curve) for curve in total])


def _peak(x: Array, y: Array) -> float:
    """Where the parabola through the largest value and its neighbours is largest; x evenly spaced."""
    i = int(np.argmax(y))
    if i in (0, len(x) - 1):
        return float(x[i])
    bend = y[i - 1] - 2 * y[i] + y[i + 1]
    return float(x[i] + (x[1] - x[0]) * 0.5 * (y[i - 1] - y[i + 1]) / bend) if bend < 0 else float(x[i])


@dataclass(frozen=True, eq=False)
class KalmanFiller:
    """A smoother whose noise is known.

    Attributes:
        coordinates: Where it runs.
        order: Size of the state.
        density: (M,) process noise.
    """

    coordinates: Body | World
    order: int
    density: Array

    def __call__(self, trial: Trial) -> Estimate:
        """Smooth every marker on its own."""
        placed = self.coordinates.place(trial)
        step, unit = transition(self.order)
        mean, cov = wide_prior(placed.y, self.order)
        noise = self.density[:, None, None] * unit
        run = filter_series(placed.y, trial.sd_m**2, step, noise, mean=mean, cov=cov)
        smoothed, spread = smooth_series(run, step)
        variance = np.maximum(spread[:, :, 0, 0], 0.0) + trial.sd_m**2
        return placed.leave(smoothed[:, :, 0], variance[..., None, None] * np.eye(3))


@dataclass(frozen=True)
class KalmanSmoother:
    """Constant velocity (order 2) or constant acceleration (order 3) of single markers."""

    name: str
    order: int

    def learn(self, training: Sequence[Trial]) -> Filler:
        """Noise by likelihood, its factor and the coordinates by hidden gaps."""

        @cache
        def likeliest(body: bool, trials: tuple[Trial, ...]) -> tuple[Body | World, Array]:
            coordinates = learn_body(trials) if body else World()
            series = [coordinates.place(trial).y for trial in trials]
            return coordinates, likeliest_density(series, trials[0].sd_m, self.order)

        def fit(candidate: tuple[bool, float], trials: Sequence[Trial]) -> Filler:
            coordinates, density = likeliest(candidate[0], tuple(trials))
            return KalmanFiller(coordinates, self.order, candidate[1] * density)

        candidates = [(body, factor) for body in (True, False) for factor in (1.0, 10.0, 0.03, 1e-3)]
        return tune(candidates, training, fit)


def peers() -> list[Method]:
    """Both smoothers."""
    return [KalmanSmoother("constant_velocity", 2), KalmanSmoother("constant_acceleration", 3)]
