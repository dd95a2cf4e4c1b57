"""The linear subspace of poses: probabilistic principal components with gaps, their number chosen on hidden samples."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mocap.arrays import Array, frozen


@dataclass(frozen=True, eq=False, kw_only=True)
class PoseSubspace:
    """Poses y = mean + basis z + residual.

    Attributes:
        mean: (D,) mean pose; D = 3M.
        basis: (D, r) orthonormal principal directions, largest variance first.
        residual_sd: (D,) standard deviation of what the subspace leaves of a marker that it has not seen.
    """

    mean: Array
    basis: Array
    residual_sd: Array

    def __post_init__(self) -> None:
        """Copy and freeze."""
        object.__setattr__(self, "mean", frozen("mean", self.mean, (None,)))
        d = len(self.mean)
        object.__setattr__(self, "basis", frozen("basis", self.basis, (d, None)))
        object.__setattr__(self, "residual_sd", frozen("residual_sd", self.residual_sd, (d,)))


@dataclass(frozen=True, eq=False)
class Components:
    """Principal components of poses with gaps.

    Attributes:
        mean: (D,) offsets.
        loading: (D, r) loadings of unit scores.
        scores: (T, r) scores.
        score_cov: (T, r, r) their covariance given what the frame shows.
        noise: Variance of an entry about the model.
    """

    mean: Array
    loading: Array
    scores: Array
    score_cov: Array
    noise: float

    @property
    def poses(self) -> Array:
        """(T, D) poses of the model."""
        return self.mean + self.scores @ self.loading.T

    @property
    def known(self) -> Array:
        """(T,) 1 less the mean share of the scores' variance that is left when a frame is seen."""
        return 1 - np.trace(self.score_cov, axis1=1, axis2=2) / self.loading.shape[1]


def bridge(y: Array) -> Array:
    """Fill NaN linearly between neighbours and constantly beyond the ends; columns without a value get 0."""
    out = y.copy()
    index = np.arange(len(y))
    for column in out.T:
        known = np.isfinite(column)
        column[~known] = np.interp(index[~known], index[known], column[known]) if known.any() else 0.0
    return out


def principal_components(y: Array, rank: int, *, iterations: int = 30) -> Components:
    """Probabilistic principal components by expectation maximisation over the entries that are seen.

    Tipping & Bishop 1999; with missing entries Ilin & Raiko 2010. Each dimension has its own offset, all have one noise
    variance; a weak prior keeps loadings small that little supports.

    Args:
        y: (T, D) poses; NaN where not seen.
        rank: Number of components.
        iterations: Rounds.
    """
    seen = np.isfinite(y)
    filled = bridge(y)
    mean = filled.mean(axis=0)
    _, s, vt = np.linalg.svd(filled - mean, full_matrices=False)
    loading = vt[:rank].T * (s[:rank] / np.sqrt(len(y)))
    noise = max(float(np.mean((filled - mean - (filled - mean) @ vt[:rank].T @ vt[:rank]) ** 2)), 1e-14)
    weight, data = seen.astype(float), np.where(seen, y, 0.0)
    z, cov = np.zeros((len(y), rank)), np.zeros((len(y), rank, rank))
    diagonal = np.arange(rank)
    for _ in range(iterations):
        centred = np.where(seen, data - mean, 0.0)
        outer = (loading[:, :, None] * loading[:, None, :]).reshape(len(mean), -1)
        cov = np.linalg.inv((weight @ outer).reshape(-1, rank, rank) / noise + np.eye(rank))
        z = np.einsum("tij,tj->ti", cov, centred @ loading) / noise
        extended = np.column_stack([z, np.ones(len(y))])
        second = extended[:, :, None] * extended[:, None, :]
        second[:, :rank, :rank] += cov
        moment = (weight.T @ second.reshape(len(y), -1)).reshape(-1, rank + 1, rank + 1)
        moment[:, diagonal, diagonal] += noise / np.maximum(np.mean(loading**2, axis=0), 1e-14)
        moment[:, rank, rank] += 1e-9
        solution = np.linalg.solve(moment, (data.T @ extended)[..., None])[..., 0]
        loading, mean = solution[:, :rank], np.where(weight.any(axis=0), solution[:, rank], mean)
        misfit = np.where(seen, data - mean - z @ loading.T, 0.0)
        spread = ((loading[:, :, None] * loading[:, None, :]).reshape(len(mean), -1) @ cov.reshape(len(y), -1).T).T
        noise = max(float((misfit**2 + weight * spread).sum() / weight.sum()), 1e-14)
    return Components(mean, loading, z, cov, noise)


def hide_blocks(seen: NDArray[np.bool_], rng: np.random.Generator, *, share: float, length: int) -> NDArray[np.bool_]:
    """(T, M) mask that hides about a ``share`` of the seen samples, ``length`` frames of a marker on end at a time."""
    hidden = np.zeros_like(seen)
    blocks = int(np.ceil(share * len(seen) / length))
    for marker in range(seen.shape[1]):
        for start in rng.integers(-length // 2, max(len(seen) - length // 2, 1), blocks):
            hidden[max(start, 0) : start + length, marker] = True
    return hidden & seen


def fit_subspace(
    y: Array, *, ranks: Sequence[int], block: int, rng: np.random.Generator
) -> tuple[PoseSubspace, Array, Array]:
    """The subspace of a recording, of the smallest rank that predicts hidden samples within 5 % of the best.

    Args:
        y: (T, D) poses; NaN where not seen; three columns a marker.
        ranks: Ranks to choose from, increasing.
        block: Frames that a marker is hidden for.
        rng: Where to hide.

    Returns:
        The subspace, the shapes z (T, r), and (T,) how well each is known (``Components.known``).
    """
    markers = y.reshape(len(y), -1, 3)
    seen = np.isfinite(markers[..., 0])
    hidden = hide_blocks(seen, rng, share=0.1, length=block)
    trial = np.where(hidden[..., None], np.nan, markers).reshape(y.shape)
    errors, misfit = [], []
    limit = max(1, min(len(y) // 8, y.shape[1]))
    candidates = [r for r in ranks if r <= limit] or [limit]
    for rank in candidates:
        poses = principal_components(trial, rank, iterations=12).poses.reshape(markers.shape)
        errors.append(np.where(hidden[..., None], markers - poses, np.nan))
        misfit.append(float(np.sqrt(np.nansum(errors[-1] ** 2))))
        if len(misfit) > 2 and min(misfit[-2:]) > min(misfit):
            break
    best = next(i for i, value in enumerate(misfit) if value <= 1.05 * min(misfit))
    found = principal_components(y, candidates[best])
    basis, _, _ = np.linalg.svd(found.loading @ _root(found.scores), full_matrices=False)
    subspace = PoseSubspace(mean=found.mean, basis=basis, residual_sd=np.repeat(_marker_sd(errors[best]), 3))
    return subspace, (found.poses - found.mean) @ basis, found.known


def _root(scores: Array) -> Array:
    """(r, r) symmetric root of the second moment of the scores."""
    values, vectors = np.linalg.eigh(scores.T @ scores / len(scores))
    return vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T


def _marker_sd(error: Array, *, prior: float = 20.0) -> Array:
    """(M,) deviation of a coordinate of each marker, from (T, M, 3) errors; drawn towards that of all."""
    squares = np.nansum(error**2, axis=(0, 2)) / 3
    count = np.isfinite(error[..., 0]).sum(axis=0)
    overall = squares.sum() / max(count.sum(), 1)
    return np.sqrt(np.maximum((squares + prior * overall) / (count + prior), 1e-14))
