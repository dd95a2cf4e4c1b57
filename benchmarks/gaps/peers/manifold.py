"""Isomap and locally linear embedding as latent spaces of an unscented Kalman smoother.

Isomap (Tenenbaum, de Silva & Langford 2000) or LLE (Roweis & Saul 2000), both scikit-learn's, embed the training poses;
a Gaussian process maps back to poses; the latent point moves by constant velocity or learned linear dynamics and is
filtered and smoothed on the markers that are seen (tracking on embedded poses: Elgammal & Lee 2004; Rahimi, Recht &
Darrell 2007). The residual at the edges is carried into the gap.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from mocap.filters.whittaker import smooth_series
from numpy.typing import NDArray
from sklearn.manifold import Isomap, LocallyLinearEmbedding

from benchmarks.gaps.method import Estimate, Filler, Method, Trial
from benchmarks.gaps.peers.coordinates import Body, learn_body
from benchmarks.gaps.peers.edges import Blend, fill_blended
from benchmarks.gaps.peers.intervals import tune_blended
from benchmarks.gaps.peers.latent import LatentModel, Regression, follow, linear_dynamics, regress
from benchmarks.gaps.peers.poses import completed
from eal.arrays import Array

POSES = 300
"""Training poses that are embedded."""

FRAMES = 600
"""Frames of a trial from which the motion is learned."""


@dataclass(frozen=True, eq=False)
class LatentFiller:
    """A latent model in body coordinates, and how what it says is blended in."""

    coordinates: Body
    model: LatentModel
    blend: Blend

    def __call__(self, trial: Trial) -> Estimate:
        """Follow the latent point and blend what it says into the gaps; the map's error is carried from the edges."""
        placed = self.coordinates.place(trial)
        poses, latent = follow(self.model, placed.poses)
        model = poses.reshape(placed.y.shape)
        error = (self.model.decode.noise_sd.reshape(-1, 3) ** 2)[..., None] * np.eye(3)

        def predict(_values: Array, frames: NDArray[np.int64], _masks: NDArray[np.bool_]) -> tuple[Array, Array]:
            return model[frames], np.repeat(error[None], len(frames), axis=0)

        y, spread = fill_blended(placed, predict, self.blend)
        return placed.leave(y, spread + latent)


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
    """One of the two embeddings."""

    name: str
    isomap: bool

    def learn(self, training: Sequence[Trial]) -> Filler:
        """Choose the dimension, the dynamics and the factor on the deviation of an observation, then the blend."""

        @cache
        def learned(trials: tuple[Trial, ...]) -> tuple[Body, list[Array]]:
            body = learn_body(trials)
            return body, completed([body.place(trial) for trial in trials])

        @cache
        def embedded(
            size: int, neighbours: int, trials: tuple[Trial, ...]
        ) -> tuple[Body, Regression, list[Array], Array]:
            body, poses = learned(trials)
            stacked = np.concatenate(poses)
            chosen = spread_out(stacked, POSES)
            neighbours = min(neighbours, len(chosen) - 1)
            size = min(size, chosen.shape[1], neighbours - 1)
            make = (
                Isomap(n_neighbors=neighbours, n_components=size)
                if self.isomap
                else LocallyLinearEmbedding(n_neighbors=neighbours, n_components=size, random_state=0)
            )
            with warnings.catch_warnings():  # far poses leave the graph in parts, which scikit-learn joins
                warnings.filterwarnings("ignore", message="The number of connected components")
                warnings.filterwarnings("ignore", message="Changing the sparsity structure")
                points = make.fit_transform(chosen)
            scale = points.std(axis=0) + 1e-12
            z = [slow(make.transform(p[:FRAMES]) / scale) for p in poses]
            decode = regress(points / scale, chosen)
            sd = np.hypot(decode.noise_sd, np.repeat(trials[0].sd_m, 3))
            return body, decode, z, sd

        def fit(candidate: tuple[int, float | None, float], blend: Blend, trials: Sequence[Trial]) -> Filler:
            size, ridge, trust = candidate
            body, decode, z, sd = embedded(size, 12 if self.isomap else 30, tuple(trials))
            return LatentFiller(body, linear_dynamics(decode, z, trust * sd, ridge=ridge), blend)

        candidates = [(3, 1e-2, 3.0), (6, 1e-2, 3.0), (6, 1e-2, 10.0), (6, None, 3.0), (10, 1e-2, 3.0)]
        return tune_blended(candidates, training, fit)


def peers() -> list[Method]:
    """Both."""
    return [Embedding("isomap_ukf", isomap=True), Embedding("lle_ukf", isomap=False)]
