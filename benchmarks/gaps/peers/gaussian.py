"""The conditional mean of a Gaussian over poses, and over poses with their neighbours in time.

The standard imputation of missing markers by the covariance of all markers (for motion capture: Liu & McMillan 2006 and
Tits, Tilmanne & Dutoit 2018, who find regression of this kind the strongest single method). The Gaussian is fitted by
expectation maximisation over samples with missing entries (Little & Rubin 2002, section 11.2), with a ridge; the trial
itself counts with a weight. ``conditional_gaussian_delay`` does the same for a pose stacked with delayed and advanced
copies of itself (as in singular spectrum analysis), which lets it use the motion and not only the pose.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from mocap.filters.conditional import expected, patterns, regression
from mocap.filters.gaussian import diagonal_blocks
from numpy.typing import NDArray

from benchmarks.gaps.method import Estimate, Filler, Method, Trial
from benchmarks.gaps.peers.coordinates import Body, Placed, completed, learn_body, usable
from benchmarks.gaps.peers.edges import Blend, Predict, fill_blended, refill
from benchmarks.gaps.peers.intervals import tune_blended
from eal.arrays import Array


def delayed(y: Array, lags: Sequence[int]) -> Array:
    """Rows [y(t + lag) for every lag] of (T, D) poses; NaN beyond the ends."""
    out = np.full((len(y), len(lags), y.shape[1]), np.nan)
    for k, lag in enumerate(lags):
        low, high = max(0, -lag), min(len(y), len(y) - lag)
        if high > low:
            out[low:high, k] = y[low + lag : high + lag]
    return out.reshape(len(y), -1)


@dataclass(frozen=True, eq=False)
class Moments:
    """Weighted sums over poses.

    Attributes:
        count: Total weight.
        first: (D,) sum.
        second: (D, D) sum of outer products.
    """

    count: float
    first: Array
    second: Array

    def __add__(self, other: "Moments") -> "Moments":
        """Moments of both sets."""
        return Moments(self.count + other.count, self.first + other.first, self.second + other.second)

    def part(self, columns: NDArray[np.int64]) -> "Moments":
        """Of some columns alone."""
        return Moments(self.count, self.first[columns], self.second[np.ix_(columns, columns)])

    def normal(self, ridge: Array) -> "Normal":
        """The Gaussian of these moments; (D,) ``ridge`` is added to the variances."""
        mean = self.first / self.count
        cov = self.second / self.count - np.outer(mean, mean)
        return Normal(mean, 0.5 * (cov + cov.T) + np.diag(ridge))


@dataclass(frozen=True, eq=False)
class Normal:
    """A Gaussian over poses: mean (D,), covariance (D, D)."""

    mean: Array
    cov: Array

    def part(self, columns: NDArray[np.int64]) -> "Normal":
        """Of some columns alone."""
        return Normal(self.mean[columns], self.cov[np.ix_(columns, columns)])

    def condition(self, poses: Array, columns: NDArray[np.int64]) -> tuple[Array, Array]:
        """Some columns of (N, D) poses completed, and the covariance of what was missing of each of their markers.

        Args:
            poses: (N, D) poses; NaN where not seen.
            columns: (3 M,) columns that are asked for, three a marker.

        Returns:
            (N, M, 3) positions and (N, M, 3, 3) covariances, zero where seen.
        """
        seen = np.isfinite(poses)
        out = np.where(seen, poses, self.mean)[:, columns].reshape(len(poses), -1, 3)
        spread = np.zeros((*out.shape, 3))
        for pattern, rows in patterns(seen):
            wanted = columns[~pattern[columns]]
            marker = np.flatnonzero(~pattern[columns[::3]])
            cross = self.cov[np.ix_(pattern, wanted)]
            weights = regression(self.cov, pattern, cross)
            left = self.cov[np.ix_(wanted, wanted)] - cross.T @ weights
            values = poses[np.ix_(rows, np.flatnonzero(pattern))] - self.mean[pattern]
            out[np.ix_(rows, marker)] = (self.mean[wanted] + values @ weights).reshape(len(rows), -1, 3)
            spread[np.ix_(rows, marker)] = diagonal_blocks(0.5 * (left + left.T))
        return out, spread


def moments(poses: Array, weight: float, normal: Normal | None = None) -> Moments:
    """Expected moments of (N, D) poses under a Gaussian where they have NaN (the E step)."""
    extra = np.zeros((poses.shape[1],) * 2)
    if normal is not None:
        poses, extra = expected(poses, normal.mean, normal.cov)
    return Moments(weight * len(poses), weight * poses.sum(axis=0), weight * (poses.T @ poses + extra))


@dataclass(frozen=True, eq=False)
class GaussianFiller:
    """A Gaussian of the training poses, to which the trial at hand is added.

    Attributes:
        coordinates: Of the body.
        learned: Moments of the training poses.
        normal: Their Gaussian.
        ridge: (D,) added to variances.
        own: Weight of the trial's own poses.
        lags: Frames stacked; (0,): the pose alone.
        blend: At the edges.
    """

    coordinates: Body
    learned: Moments
    normal: Normal
    ridge: Array
    own: float
    lags: tuple[int, ...]
    blend: Blend

    def __call__(self, trial: Trial) -> Estimate:
        """Condition every frame on what it shows; with lags, once more on that frame and its completed neighbours."""
        placed = self.coordinates.place(trial)
        width, centre = placed.poses.shape[1], self.lags.index(0)
        columns = np.arange(centre * width, (centre + 1) * width)
        noise = np.repeat((trial.sd_m**2)[:, None], 3, axis=1)

        def asked(normal: Normal, lags: Sequence[int], columns: NDArray[np.int64]) -> Predict:
            def predict(values: Array, frames: NDArray[np.int64], masks: NDArray[np.bool_]) -> tuple[Array, Array]:
                allowed = np.tile(np.repeat(masks, 3, axis=1), (1, len(lags)))
                rows = delayed(values.reshape(len(values), -1), lags)[frames]
                mean, cov = normal.condition(np.where(allowed, rows, np.nan), columns)
                diagonal = np.diagonal(cov, axis1=-2, axis2=-1)
                return mean, cov - np.minimum(noise, 0.99 * diagonal)[..., None] * np.eye(3)

            return predict

        learned, normal, ridge = self.learned.part(columns), self.normal.part(columns), self.ridge[columns]
        if self.own > 0:
            normal = (learned + moments(usable(placed.poses), self.own, normal)).normal(ridge)
        y, spread = fill_blended(placed, asked(normal, (0,), np.arange(width)), self.blend)
        if len(self.lags) > 1:
            normal = self.normal
            if self.own > 0:
                own = delayed(y.reshape(len(y), -1), self.lags)[np.isfinite(placed.poses).mean(axis=1) > 0.3]
                own = own[np.isfinite(own).all(axis=1)]
                normal = (self.learned + moments(own, self.own)).normal(self.ridge)
            y, spread = refill(placed, y, asked(normal, self.lags, columns), self.blend)
        return placed.leave(y, spread)


def thinned(lags: Sequence[int]) -> int:
    """Every how many frames a row of delayed poses is taken for the moments: neighbours say nearly the same."""
    return 1 if len(lags) == 1 else 3


@dataclass(frozen=True, kw_only=True)
class Choice:
    """Hyper-parameters; ``ridge`` is a share of the mean variance."""

    ridge: float
    own: float
    lags: tuple[int, ...] = (0,)


@dataclass(frozen=True)
class ConditionalGaussian:
    """A Gaussian over poses or delayed poses, the best of several choices."""

    name: str
    choices: tuple[Choice, ...]

    def learn(self, training: Sequence[Trial]) -> Filler:
        """Choose on hidden gaps."""

        @cache
        def prepared(trials: tuple[Trial, ...]) -> tuple[Body, list[Placed], list[Array]]:
            body = learn_body(trials)
            placed = [body.place(trial) for trial in trials]
            return body, placed, completed(placed)

        @cache
        def learned(trials: tuple[Trial, ...], lags: tuple[int, ...]) -> tuple[Body, Moments, Array, bool]:
            body, placed, whole = prepared(trials)
            stacked = np.concatenate([usable(delayed(p.poses, lags)[:: thinned(lags)]) for p in placed])
            guess = moments(np.concatenate([_bridged(delayed(poses, lags)) for poses in whole]), 1.0)
            return body, guess, stacked, bool(np.isfinite(stacked).all())

        @cache
        def fitted(choice: Choice, trials: tuple[Trial, ...]) -> tuple[Body, Moments, Normal, Array]:
            body, total, stacked, whole = learned(trials, choice.lags)
            scale = np.trace(total.second / total.count - np.outer(total.first, total.first) / total.count**2)
            ridge = np.full(len(total.first), choice.ridge * scale / len(total.first) + 1e-14)
            normal = total.normal(ridge)
            for _ in range(0 if whole else 3):
                total = moments(stacked, float(thinned(choice.lags)), normal)
                normal = total.normal(ridge)
            return body, total, normal, ridge

        def fit(choice: Choice, blend: Blend, trials: Sequence[Trial]) -> Filler:
            return GaussianFiller(*fitted(choice, tuple(trials)), choice.own, choice.lags, blend)

        return tune_blended(self.choices, training, fit)


def _bridged(stacked: Array) -> Array:
    """Rows that are complete; delays reach beyond the ends of a trial."""
    keep = np.isfinite(stacked).all(axis=1)
    return stacked[keep] if keep.any() else np.nan_to_num(stacked)


def peers() -> list[Method]:
    """The pose alone, and with its neighbours in time."""
    plain = tuple(Choice(ridge=ridge, own=own) for ridge in (1e-4, 1e-2) for own in (0.3, 3.0))
    near, far = (-8, -4, 0, 4, 8), (-24, -8, 0, 8, 24)
    delay = (
        Choice(ridge=1e-4, own=1.0, lags=near),
        Choice(ridge=1e-4, own=1.0, lags=far),
        Choice(ridge=1e-2, own=1.0, lags=far),
        Choice(ridge=1e-2, own=1.0, lags=near),
    )
    return [
        ConditionalGaussian("conditional_gaussian", plain),
        ConditionalGaussian("conditional_gaussian_delay", delay),
    ]
