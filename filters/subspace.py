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
    """Principal components of poses with gaps, from one or several trials.

    Attributes:
        mean: (D,) offsets.
        trial_offset: (G, D) what is added to the mean in each trial; zeros with one trial.
        trial_sd: (D,) standard deviation of that over trials.
        loading: (D, r) loadings of unit scores.
        scores: (N, r) scores.
        score_cov: (N, r, r) their covariance given what the frame shows.
        noise: Variance of an entry about the model.
        trial: (N,) trial of each pose.
    """

    mean: Array
    trial_offset: Array
    trial_sd: Array
    loading: Array
    scores: Array
    score_cov: Array
    noise: float
    trial: NDArray[np.int64]

    @property
    def poses(self) -> Array:
        """(N, D) poses of the model."""
        return self.mean + self.trial_offset[self.trial] + self.scores @ self.loading.T

    @property
    def known(self) -> Array:
        """(N,) 1 less the mean share of the scores' variance that is left when a frame is seen."""
        return 1 - np.trace(self.score_cov, axis1=1, axis2=2) / self.loading.shape[1]


def bridge(y: Array) -> Array:
    """Fill NaN linearly between neighbours and constantly beyond the ends; columns without a value get 0."""
    out = y.copy()
    index = np.arange(len(y))
    for column in out.T:
        known = np.isfinite(column)
        column[~known] = np.interp(index[~known], index[known], column[known]) if known.any() else 0.0
    return out


def principal_components(
    y: Array, rank: int, *, trial: NDArray[np.int64] | None = None, iterations: int = 30, independent: float = 0.1
) -> Components:
    """Probabilistic principal components by expectation maximisation over the entries that are seen.

    Tipping & Bishop 1999; with missing entries Ilin & Raiko 2010. Each dimension has its own offset, all have one noise
    variance; a weak prior keeps loadings small that little supports. Trials differ by an offset in each dimension
    (animal, marker placement), a random effect whose variance is estimated with the rest.

    Args:
        y: (N, D) poses; NaN where not seen.
        rank: Number of components.
        trial: (N,) trial of each pose, 0 to G - 1; None: all are of one.
        iterations: Most rounds; it ends when the noise changes by less than 1e-4 of it.
        independent: Neighbouring frames err alike: each counts as so many independent ones for a trial's offset.
    """
    trial = np.zeros(len(y), dtype=np.int64) if trial is None else trial
    member = (trial[:, None] == np.arange(trial.max() + 1)).astype(float)  # (N, G)
    seen = np.isfinite(y)
    filled = np.concatenate([bridge(part) for part in np.split(y, np.flatnonzero(np.diff(trial)) + 1)])
    weight, data = seen.astype(float), np.where(seen, y, 0.0)
    count = member.T @ weight  # (G, D)
    first = _first_mean(data, weight, filled)
    filled = np.where(seen | (count > 0)[trial], filled, first)
    mean = filled.mean(axis=0)
    _, s, vt = np.linalg.svd(filled - mean, full_matrices=False)
    loading = vt[:rank].T * (s[:rank] / np.sqrt(len(y)))
    noise = max(float(np.mean((filled - mean - (filled - mean) @ vt[:rank].T @ vt[:rank]) ** 2)), 1e-14)
    z, cov = np.zeros((len(y), rank)), np.zeros((len(y), rank, rank))
    offset, offset_var = np.zeros(count.shape), np.full(y.shape[1], 10 * noise)
    diagonal = np.arange(rank)
    for _ in range(iterations):
        centred = np.where(seen, data - mean - offset[trial], 0.0)
        outer = (loading[:, :, None] * loading[:, None, :]).reshape(len(mean), -1)
        cov = np.linalg.inv((weight @ outer).reshape(-1, rank, rank) / noise + np.eye(rank))
        z = np.einsum("tij,tj->ti", cov, centred @ loading) / noise
        extended = np.column_stack([z, np.ones(len(y))])
        second = extended[:, :, None] * extended[:, None, :]
        second[:, :rank, :rank] += cov
        moment = (weight.T @ second.reshape(len(y), -1)).reshape(-1, rank + 1, rank + 1)
        moment[:, diagonal, diagonal] += noise / np.maximum(np.mean(loading**2, axis=0), 1e-14)
        moment[:, rank, rank] += 1e-9
        shifted = np.where(seen, data - offset[trial], 0.0)
        solution = np.linalg.solve(moment, (shifted.T @ extended)[..., None])[..., 0]
        loading, mean = solution[:, :rank], np.where(weight.any(axis=0), solution[:, rank], mean)
        misfit = np.where(seen, data - mean - z @ loading.T, 0.0)
        if member.shape[1] > 1:
            ridge = noise / (independent * offset_var)
            offset = (member.T @ misfit) / (count + ridge)
            left = noise / (independent * (count + ridge))
            offset_var = np.mean(offset**2 + left, axis=0).clip(1e-12)
            misfit = np.where(seen, misfit - offset[trial], 0.0)
        spread = ((loading[:, :, None] * loading[:, None, :]).reshape(len(mean), -1) @ cov.reshape(len(y), -1).T).T
        before, noise = noise, max(float((misfit**2 + weight * spread).sum() / weight.sum()), 1e-14)
        if abs(noise - before) < 1e-4 * noise:
            break
    trial_sd = np.sqrt(offset_var) if member.shape[1] > 1 else np.zeros(y.shape[1])
    return Components(mean, offset, trial_sd, loading, z, cov, noise, trial)


def _first_mean(data: Array, weight: Array, filled: Array) -> Array:
    """(D,) mean of what is seen; of what is filled where nothing is."""
    count = weight.sum(axis=0)
    return np.where(count > 0, data.sum(axis=0) / np.maximum(count, 1), filled.mean(axis=0))


def hide_blocks(seen: NDArray[np.bool_], rng: np.random.Generator, *, share: float, length: int) -> NDArray[np.bool_]:
    """(T, M) mask that hides about a ``share`` of the seen samples, ``length`` frames of a marker on end at a time."""
    hidden = np.zeros_like(seen)
    blocks = int(np.ceil(share * len(seen) / length))
    for marker in range(seen.shape[1]):
        for start in rng.integers(-length // 2, max(len(seen) - length // 2, 1), blocks):
            hidden[max(start, 0) : start + length, marker] = True
    return hidden & seen


def fit_subspace(
    y: Array, *, ranks: Sequence[int], block: int, rng: np.random.Generator, trial: NDArray[np.int64] | None = None
) -> tuple[PoseSubspace, Components, Array]:
    """The subspace of poses, of the smallest rank that predicts hidden samples within 5 % of the best.

    Args:
        y: (N, D) poses; NaN where not seen; three columns a marker.
        ranks: Ranks to choose from, increasing.
        block: Frames that a marker is hidden for.
        rng: Where to hide.
        trial: (N,) trial of each pose; None: all are of one.

    Returns:
        The subspace, the components that it rests on, and the shapes z (N, r).
    """
    markers = y.reshape(len(y), -1, 3)
    seen = np.isfinite(markers[..., 0])
    hidden = hide_blocks(seen, rng, share=0.1, length=block)
    shown = np.where(hidden[..., None], np.nan, markers).reshape(y.shape)
    errors, misfit = [], []
    limit = max(1, min(len(y) // 8, y.shape[1]))
    candidates = [r for r in ranks if r <= limit] or [limit]
    for rank in candidates:
        poses = principal_components(shown, rank, trial=trial, iterations=12).poses.reshape(markers.shape)
        errors.append(np.where(hidden[..., None], markers - poses, np.nan))
        misfit.append(float(np.sqrt(np.nansum(errors[-1] ** 2))))
        if len(misfit) > 2 and min(misfit[-2:]) > min(misfit):
            break
    best = next(i for i, value in enumerate(misfit) if value <= 1.05 * min(misfit))
    found = principal_components(y, candidates[best], trial=trial)
    basis, _, _ = np.linalg.svd(found.loading @ _root(found.scores), full_matrices=False)
    subspace = PoseSubspace(mean=found.mean, basis=basis, residual_sd=np.repeat(_marker_sd(errors[best]), 3))
    return subspace, found, found.scores @ found.loading.T @ basis


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
