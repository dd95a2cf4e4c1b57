"""Locally linear embedding as the latent space of an unscented Kalman smoother.

scikit-learn's LLE (Roweis & Saul 2000) embeds the training poses; a Gaussian process maps back to poses; the latent
point moves by constant velocity or learned linear dynamics and is filtered and smoothed on the markers that are seen
(tracking on embedded poses: Elgammal & Lee 2004; Rahimi, Recht & Darrell 2007). The residual at the edges is carried
into the gap. Isomap in its place was the best peer of no cell (``gap_benchmark.md``).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from mocap.filters.whittaker import smooth_series
from sklearn.manifold import LocallyLinearEmbedding

from benchmarks.gaps.method import Filler, Method, Trial
from benchmarks.gaps.peers.coordinates import Body, completed, learn_body
from benchmarks.gaps.peers.edges import Blend
from benchmarks.gaps.peers.intervals import tune_blended
from benchmarks.gaps.peers.latent import LatentFiller, Regression, linear_dynamics, regress
from eal.arrays import Array

POSES = 300
"""Training poses that are embedded."""

FRAMES = 600
"""Frames of a trial from which the motion is learned."""


def spread_out(poses: Array, count: int) -> Array:
    """Up to ``count`` of (N, D) poses, each the farthest from those before: repeated ones would be their neighbours."""
    chosen, distance = [0], np.full(len(poses), np.inf)
    for _ in range(min(count, len(poses)) - 1):
        distance = np.minimum(distance, ((poses - poses[chosen[-1]]) ** 2).sum(axis=1))
        if distance.max() <= 0:
            break
        chosen.append(int(np.argmax(distance)))
    return poses[np.sort(chosen)]


def slow(z: Array) -> Array:
    """Latent points (T, q) without what is faster than a cycle in 20 frames: embedded noise is no motion."""
    return smooth_series(z, np.ones(len(z)), dt_s=1.0, cutoff_hz=0.05)


@dataclass(frozen=True)
class Embedding:
    """The embedding."""

    name: str = "lle_ukf"

    def learn(self, training: Sequence[Trial]) -> Filler:
        """Choose the dimension, the dynamics and the factor on the deviation of an observation, then the blend."""

        @cache
        def learned(trials: tuple[Trial, ...]) -> tuple[Body, list[Array]]:
            body = learn_body(trials)
            return body, completed([body.place(trial) for trial in trials])

        @cache
        def embedded(size: int, trials: tuple[Trial, ...]) -> tuple[Body, Regression, list[Array], Array]:
            body, poses = learned(trials)
            stacked = np.concatenate(poses)
            chosen = spread_out(stacked, POSES)
            neighbours = min(30, len(chosen) - 1)
            size = min(size, chosen.shape[1], neighbours - 1)
            make = LocallyLinearEmbedding(n_neighbors=neighbours, n_components=size, random_state=0)
            points = make.fit_transform(chosen)
            scale = points.std(axis=0) + 1e-12
            z = [slow(make.transform(p[:FRAMES]) / scale) for p in poses]
            decode = regress(points / scale, chosen)
            sd = np.hypot(decode.noise_sd, np.repeat(trials[0].sd_m, 3))
            return body, decode, z, sd

        def fit(candidate: tuple[int, float | None, float], blend: Blend, trials: Sequence[Trial]) -> Filler:
            size, ridge, trust = candidate
            body, decode, z, sd = embedded(size, tuple(trials))
            return LatentFiller(body, linear_dynamics(decode, z, trust * sd, ridge=ridge), blend)

        candidates = [(3, 1e-2, 3.0), (6, 1e-2, 3.0), (6, 1e-2, 10.0), (6, None, 3.0), (10, 1e-2, 3.0)]
        return tune_blended(candidates, training, fit)


def peers() -> list[Method]:
    """LLE."""
    return [Embedding()]
