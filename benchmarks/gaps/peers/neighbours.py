"""Nearest training poses: a missing marker is where it was when the others stood alike.

Kernel regression over the k nearest poses by the distance of the markers that are seen (the lazy neighbourhoods of Chai
& Hodgins 2005; Liu & McMillan 2006 for missing markers), the trial's own complete frames among them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from benchmarks.gaps.method import Estimate, Filler, Method, Trial
from benchmarks.gaps.peers.coordinates import Body, completed, learn_body
from benchmarks.gaps.peers.edges import Blend, fill_blended, shown
from benchmarks.gaps.peers.intervals import tune_blended
from eal.arrays import Array

POOL = 6000
"""Most training poses that are searched."""


def nearest_mean(poses: Array, pool: Array, k: int) -> Array:
    """Complete (N, D) poses with NaN by a weighted mean of the ``k`` nearest of (P, D) complete poses.

    Weights are exp(-d^2 / (2 h^2)) with h the root mean square distance of the k, so that equally near poses count
    alike.
    """
    seen = np.isfinite(poses)
    values = np.where(seen, poses, 0.0)
    squares = (seen @ (pool**2).T) - 2 * values @ pool.T + (values**2).sum(axis=1, keepdims=True)
    k = min(k, len(pool))
    chosen = np.argpartition(squares, k - 1, axis=1)[:, :k]
    distance = np.maximum(np.take_along_axis(squares, chosen, axis=1), 0.0)
    weight = np.exp(-0.5 * distance / np.maximum(distance.mean(axis=1, keepdims=True), 1e-300))
    weight /= weight.sum(axis=1, keepdims=True)
    return np.where(seen, poses, np.einsum("nk,nkd->nd", weight, pool[chosen]))


@dataclass(frozen=True, eq=False)
class NeighbourFiller:
    """A pool of poses, how many of them count, and how their answer is blended in."""

    coordinates: Body
    pool: Array
    k: int
    blend: Blend

    def __call__(self, trial: Trial) -> Estimate:
        """Look up every frame."""
        placed = self.coordinates.place(trial)
        whole = np.isfinite(placed.poses).all(axis=1)
        pool = np.concatenate([self.pool, placed.poses[whole]])

        def predict(values: Array, frames: NDArray[np.int64], masks: NDArray[np.bool_]) -> tuple[Array, None]:
            return nearest_mean(shown(values, frames, masks), pool, self.k).reshape(len(frames), -1, 3), None

        y, _ = fill_blended(placed, predict, self.blend)
        return placed.leave(y)


@dataclass(frozen=True)
class NearestNeighbours:
    """kNN over the markers that are seen."""

    name: str = "knn"

    def learn(self, training: Sequence[Trial]) -> Filler:
        """Choose k and the blend."""

        @cache
        def learned(trials: tuple[Trial, ...]) -> tuple[Body, Array]:
            body = learn_body(trials)
            pool = np.concatenate(completed([body.place(trial) for trial in trials]))
            return body, pool[np.linspace(0, len(pool) - 1, min(POOL, len(pool))).astype(int)]

        def fit(k: int, blend: Blend, trials: Sequence[Trial]) -> Filler:
            return NeighbourFiller(*learned(tuple(trials)), k, blend)

        return tune_blended((3, 10, 30, 100), training, fit)


def peers() -> list[Method]:
    """One method."""
    return [NearestNeighbours()]
