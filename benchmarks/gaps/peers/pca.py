"""Reconstruction from principal components.

Gloersen & Federolf 2016 (PLoS ONE 11, e0152616), after Federolf 2013 (PLoS ONE 8, e78689). Poses are standardised,
weighted, and projected on principal components twice: with the missing markers (basis P), and with these set to zero
(basis Z). A pose whose missing entries are zero is read in Z and rebuilt in P,

    y = z Z Z^T P P^T  (undone of weights and standardisation).

Federolf 2013 has no weights. Gloersen & Federolf weigh markers by exp(-d^2 / (2 sigma^2)) of their mean distance d from
the missing one, and missing ones by 0.02, which makes their entries nearly free. Strategy R1 rebuilds all missing
markers together, by the nearest; R2, the better one, each on its own. R1 answers ``edges`` first, R2 then. Components
are kept up to a share of the sum of singular values (0.99 in the paper). Their program multiplies by the transpose of
Z^T P, which is the same where the bases differ by signs only; here one basis is mapped to the other. They take the
recording's own complete frames, here those of the training trials count as well, and the residual at the edges is
carried into the gap, which theirs leaves as a step.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from mocap.filters.conditional import patterns
from numpy.typing import NDArray

from benchmarks.gaps.method import Estimate, Filler, Method, Trial
from benchmarks.gaps.peers.coordinates import Body, completed, learn_body
from benchmarks.gaps.peers.edges import Blend, Predict, fill_blended, shown
from benchmarks.gaps.peers.gaussian import Moments, moments
from benchmarks.gaps.peers.intervals import tune_blended
from eal.arrays import Array

MISSING_WEIGHT = 0.02


def components(scatter: Array, share: float) -> tuple[Array, int]:
    """Principal directions of a covariance (D, D), and how many hold a share of the sum of its singular values."""
    values, vectors = np.linalg.eigh(scatter)
    singular = np.sqrt(np.maximum(values[::-1], 0.0))
    count = int(np.searchsorted(np.cumsum(singular), share * singular.sum() * (1 - 1e-12))) + 1
    return vectors[:, ::-1], min(count, len(values))


def rebuild(z: Array, scatter: Array, missing: NDArray[np.bool_], share: float) -> Array:
    """Poses y = z Z Z^T P P^T.

    Args:
        z: (N, D) standardised, weighted poses, zero where missing.
        scatter: (D, D) covariance of complete standardised, weighted poses.
        missing: (D,) entries that are missing.
        share: Of the singular values that is kept.
    """
    incomplete = np.where(missing[:, None] | missing[None, :], 0.0, scatter)
    (with_gaps, few), (whole, many) = components(incomplete, share), components(scatter, share)
    with_gaps, whole = with_gaps[:, : max(few, many)], whole[:, : max(few, many)]
    return z @ with_gaps @ (with_gaps.T @ whole) @ whole.T


def marker_distances(mean_square: Array, inner: Array) -> Array:
    """(M, M) root mean square distances from mean squares (M,) and mean inner products (M, M) of markers."""
    return np.sqrt(np.maximum(mean_square[:, None] + mean_square - 2 * inner, 0.0))


@dataclass(frozen=True, eq=False)
class PcaFiller:
    """Moments of complete training poses, and what is chosen.

    Attributes:
        coordinates: Of the body.
        learned: Moments of the training poses.
        share: Of the singular values that is kept.
        reach: sigma of the weights over the mean distance of all markers; None: no weights (Federolf 2013).
        blend: At the edges.
    """

    coordinates: Body
    learned: Moments
    share: float
    reach: float | None
    blend: Blend

    def __call__(self, trial: Trial) -> Estimate:
        """Rebuild every frame that misses a marker."""
        placed = self.coordinates.place(trial)
        own = placed.poses[np.isfinite(placed.poses).all(axis=1)]
        total = self.learned + moments(own, 1.0) if len(own) else self.learned
        mean = total.first / total.count
        second = total.second / total.count
        cov = second - np.outer(mean, mean)
        sd = np.sqrt(np.maximum(np.diag(cov), 0.0))
        sd = np.where(sd > 1e-9 * sd.max(), sd, 1.0)
        inner = second.reshape(len(mean) // 3, 3, -1, 3).trace(axis1=1, axis2=3)
        distance = marker_distances(np.diag(inner), inner)

        def rebuilt(rows: Array, masks: NDArray[np.bool_], *, together: bool) -> Array:
            standard = (rows - mean) / sd
            out = standard.copy()
            for seen, at in patterns(masks):
                missing = np.flatnonzero(~seen)
                z = np.nan_to_num(standard[at])
                for group in [missing] if together else missing[:, None]:
                    weight = np.repeat(self.weights(distance, group, missing), 3)
                    scatter = cov / np.outer(sd, sd) * np.outer(weight, weight)
                    columns = (3 * group[:, None] + np.arange(3)).ravel()
                    found = rebuild(z * weight, scatter, np.repeat(~seen, 3), self.share) / weight
                    out[np.ix_(at, columns)] = found[:, columns]
            return (out * sd + mean).reshape(len(rows), -1, 3)

        def strategy(together: bool) -> Predict:
            def predict(values: Array, frames: NDArray[np.int64], masks: NDArray[np.bool_]) -> tuple[Array, None]:
                return rebuilt(shown(values, frames, masks), masks, together=together), None

            return predict

        y, _ = fill_blended(placed, strategy(True), self.blend, then=None if self.reach is None else strategy(False))
        return placed.leave(y)

    def weights(self, distance: Array, group: NDArray[np.int64], missing: NDArray[np.int64]) -> Array:
        """(M,) weights of markers where a group of markers is rebuilt."""
        if self.reach is None:
            return np.ones(len(distance))
        sigma = self.reach * distance.mean()
        weight = np.exp(-0.5 * (distance[group].min(axis=0) / sigma) ** 2)
        weight = np.maximum(weight, 1e-6)
        weight[missing] = MISSING_WEIGHT
        return weight


@dataclass(frozen=True)
class PcaReconstruction:
    """One of the two papers; ``reaches`` to choose from."""

    name: str
    reaches: tuple[float | None, ...]

    def learn(self, training: Sequence[Trial]) -> Filler:
        """Choose weights, components and blend."""

        @cache
        def learned(trials: tuple[Trial, ...]) -> tuple[Body, Moments]:
            body = learn_body(trials)
            return body, moments(np.concatenate(completed([body.place(trial) for trial in trials])), 1.0)

        def fit(candidate: tuple[float, float | None], blend: Blend, trials: Sequence[Trial]) -> Filler:
            return PcaFiller(*learned(tuple(trials)), *candidate, blend)

        candidates = [(share, reach) for share in (0.99, 0.95) for reach in self.reaches]
        return tune_blended(candidates, training, fit)


def peers() -> list[Method]:
    """Both papers."""
    return [PcaReconstruction("pca_gloersen_federolf", (0.5, 1.5)), PcaReconstruction("pca_federolf", (None,))]
