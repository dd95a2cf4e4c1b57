"""Kalman smoothers of principal components under a random walk.

``low_rank_kalman`` is Burke & Lasenby 2016 (J. Biomech. 49, 1854-1858): markers are a linear map of a few components
from the singular value decomposition of complete poses, the components take a random walk whose covariance is that of
their differences, and a Kalman filter and smoother read the markers that are seen; what the components leave of a
marker is observation noise. What they leave of a marker at the edges of a gap is carried into it, which the paper does
not do.

``eks_like`` is the ensemble Kalman smoother (Biderman et al. 2024, Nature Methods 21, 1316-1328, its multi-view form):
principal components of the observations, a random walk with covariance s times that of their differences, s of largest
likelihood, and the variance of an observation as observation noise. There it comes from an ensemble of networks; here
it is that of the measurement. Seen samples are smoothed too; only missing ones are looked at.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from mocap.filters.conditional import patterns
from numpy.typing import NDArray

from benchmarks.gaps.method import Estimate, Filler, Method, Trial
from benchmarks.gaps.peers.coordinates import Body, completed, learn_body
from benchmarks.gaps.peers.edges import Blend, fill_blended
from benchmarks.gaps.peers.intervals import tune_blended
from eal.arrays import Array


@dataclass(frozen=True, eq=False)
class RandomWalk:
    """y = mean + loading z + noise, z a random walk.

    Attributes:
        mean: (D,) mean pose.
        loading: (D, r) directions.
        noise: (D,) variance of an observation.
        step_cov: (r, r) covariance of a step.
        start_cov: (r, r) covariance of z.
    """

    mean: Array
    loading: Array
    noise: Array
    step_cov: Array
    start_cov: Array

    def smooth(self, y: Array) -> tuple[Array, Array, float]:
        """Rauch-Tung-Striebel smoother in information form.

        Args:
            y: (T, D) observations; NaN where not seen.

        Returns:
            (T, r) means and (T, r, r) covariances of z, and the log-likelihood.
        """
        n_frames, r = len(y), self.loading.shape[1]
        seen = np.isfinite(y)
        centred = np.where(seen, y - self.mean, 0.0)
        scaled = self.loading / self.noise[:, None]
        information, log_noise = np.zeros((n_frames, r, r)), np.zeros(n_frames)
        for pattern, rows in patterns(seen):
            information[rows] = scaled[pattern].T @ self.loading[pattern]
            log_noise[rows] = np.log(2 * np.pi * self.noise[pattern]).sum()
        weighted, squares = centred @ scaled, (centred**2 / self.noise).sum(axis=1)
        mean, cov = np.zeros((n_frames, r)), np.zeros((n_frames, r, r))
        ahead, inverse = np.zeros((n_frames, r, r)), np.zeros((n_frames, r, r))
        m, p, total = np.zeros(r), self.start_cov, 0.0
        eye = np.eye(r)
        for t in range(n_frames):
            predicted = p + self.step_cov if t else p
            ahead[t], inverse[t] = predicted, np.linalg.inv(predicted)
            if seen[t].any():
                shift = weighted[t] - information[t] @ m
                p = np.linalg.inv(inverse[t] + information[t])
                p = 0.5 * (p + p.T)
                gap = squares[t] - 2 * m @ weighted[t] + m @ information[t] @ m
                log_det = np.linalg.slogdet(eye + predicted @ information[t])[1]
                total -= 0.5 * (log_noise[t] + log_det + gap - shift @ p @ shift)
                m = m + p @ shift
            else:
                p = predicted
            mean[t], cov[t] = m, p
        gain = cov[:-1] @ inverse[1:]
        for t in range(n_frames - 2, -1, -1):
            mean[t] += gain[t] @ (mean[t + 1] - mean[t])
            cov[t] += gain[t] @ (cov[t + 1] - ahead[t + 1]) @ gain[t].T
        return mean, cov, float(total)


@dataclass(frozen=True, eq=False)
class WalkFiller:
    """A random walk in body coordinates.

    Attributes:
        coordinates: Of the body.
        walk: The model.
        left: (D,) variance that the components leave.
        blend: Of what they leave at the edges.
    """

    coordinates: Body
    walk: RandomWalk
    left: Array
    blend: Blend

    def __call__(self, trial: Trial) -> Estimate:
        """Smooth the components and map them back."""
        placed = self.coordinates.place(trial)
        z, cov, _ = self.walk.smooth(placed.poses)
        n_frames, n_markers = placed.y.shape[:2]
        model = (self.walk.mean + z @ self.walk.loading.T).reshape(n_frames, n_markers, 3)
        left = self.left.reshape(n_markers, 3)[:, :, None] * np.eye(3)

        def predict(_values: Array, frames: NDArray[np.int64], _masks: NDArray[np.bool_]) -> tuple[Array, Array]:
            return model[frames], np.repeat(left[None], len(frames), axis=0)

        y, spread = fill_blended(placed, predict, self.blend)
        loading = self.walk.loading.reshape(n_markers, 3, -1)
        return placed.leave(y, spread + loading @ cov[:, None] @ loading.swapaxes(-1, -2))


@dataclass(frozen=True)
class LowRank:
    """One of the two; ``residual_noise`` counts what the components leave as observation noise (Burke & Lasenby)."""

    name: str
    ranks: tuple[int, ...]
    factors: tuple[float, ...]
    residual_noise: bool

    def learn(self, training: Sequence[Trial]) -> Filler:
        """Choose the rank, and the factor on the random walk (by likelihood where the noise is the measurement's)."""

        @cache
        def learned(trials: tuple[Trial, ...]) -> tuple[Body, list[Array], Array, Array, Array]:
            body = learn_body(trials)
            poses = completed([body.place(trial) for trial in trials])
            stacked = np.concatenate(poses)
            mean = stacked.mean(axis=0)
            values, vectors = np.linalg.eigh(np.cov(stacked.T))
            return body, poses, mean, vectors[:, ::-1], values[::-1]

        def fit(candidate: tuple[int, float], blend: Blend, trials: Sequence[Trial]) -> Filler:
            body, poses, mean, vectors, values = learned(tuple(trials))
            rank = min(candidate[0], len(mean))
            loading = vectors[:, :rank]
            steps = np.concatenate([np.diff(p, axis=0) for p in poses]) @ loading
            left = np.maximum((vectors[:, rank:] ** 2) @ np.maximum(values[rank:], 0.0), 0.0)
            sd2 = np.repeat(trials[0].sd_m ** 2, 3)
            noise = np.maximum(left, sd2) if self.residual_noise else sd2
            tiny = 1e-12 * values[0] * np.eye(rank)
            step_cov = steps.T @ steps / len(steps) + tiny
            start = np.diag(values[:rank]) + tiny
            walk = RandomWalk(mean, loading, noise, candidate[1] * step_cov, 4 * start)
            return WalkFiller(body, walk, left, blend)

        candidates = [(rank, factor) for rank in self.ranks for factor in self.factors]
        return tune_blended(candidates, training, fit)


def peers() -> list[Method]:
    """Both."""
    return [
        LowRank("low_rank_kalman", (8, 16, 30), (0.3, 3.0), residual_noise=True),
        LowRank("eks_like", (3, 6, 12), (0.1, 1.0), residual_noise=False),
    ]
