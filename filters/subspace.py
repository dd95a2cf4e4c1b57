"""The linear subspace of poses: probabilistic principal components with gaps, their number chosen on hidden samples."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array, frozen


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
        certainty: (N,) 1 less the mean share of the scores' variance that is left when a frame is seen.
        noise: Variance of an entry about the model.
        trial: (N,) trial of each pose.
    """

    mean: Array
    trial_offset: Array
    trial_sd: Array
    loading: Array
    scores: Array
    certainty: Array
    noise: float
    trial: NDArray[np.int64]

    @property
    def poses(self) -> Array:
        """(N, D) poses of the model."""
        return self.mean + self.trial_offset[self.trial] + self.scores @ self.loading.T


DRAWS = 3
"""So often samples are hidden where a rank is chosen: the ranks that one draw finds best lie up to a factor of two
apart."""
FAR_WORSE = 1.5
"""Two ranks on end that miss hidden samples by so much more than the best end the search. In simulated bats and lizards
two can miss by 1.03 to 1.3 of what a smaller one does, and a larger one by half of it."""
AT_ONCE = 4000
"""Poses that are looked at at once: what is learned of them are sums, and memory beside the poses does not grow."""


def bridge(y: Array) -> Array:
    """Fill NaN linearly between neighbours and constantly beyond the ends; columns without a value get 0."""
    out = y.copy()
    index = np.arange(len(y))
    for column in out.T:
        finite = np.isfinite(column)
        column[~finite] = np.interp(index[~finite], index[finite], column[finite]) if finite.any() else 0.0
    return out


def principal_components(
    y: Array, rank: int, *, trial: NDArray[np.int64] | None = None, iterations: int = 30, independent: float = 0.1
) -> Components:
    """Probabilistic principal components by expectation maximisation over the entries that are seen.

    Tipping & Bishop 1999; with missing entries Ilin & Raiko 2010. Each dimension has its own offset, all have one noise
    variance; a weak prior keeps loadings small that little supports. Trials differ by an offset in each dimension
    (animal, marker placement), a random effect whose variance is estimated with the rest.

    Frames that show the same entries share the covariance of their scores, and dimensions that are seen in the same
    frames, as the three of a marker, its sums.

    Args:
        y: (N, D) poses; NaN where not seen.
        rank: Number of components.
        trial: (N,) trial of each pose, 0 to G - 1; None: all are of one.
        iterations: Most rounds; it ends when the noise changes by less than 1e-4 of it.
        independent: Neighbouring frames err alike: each counts as so many independent ones for a trial's offset.
    """
    trial = np.zeros(len(y), dtype=np.int64) if trial is None else trial
    n_trials, d = int(trial.max()) + 1, y.shape[1]
    parts = [slice(k, k + AT_ONCE) for k in range(0, len(y), AT_ONCE)]
    count = sum(
        (_by_trial(np.isfinite(y[p]).astype(float), trial[p], n_trials) for p in parts), np.zeros((n_trials, d))
    )
    ever, entries = count.any(axis=0), float(count.sum())
    mean, loading, noise = _first_components(y, rank, trial, count)
    z, left = np.zeros((len(y), rank)), np.zeros(len(y))
    offset, offset_var = np.zeros(count.shape), np.full(d, 10 * noise)
    diagonal = np.arange(rank)
    columns, group = _alike(np.isfinite(y), axis=1)
    grouped = (group == np.arange(columns.shape[1])[:, None]).astype(float)  # (C, D)
    alike = [_alike(columns[p], axis=0) for p in parts]
    for _ in range(iterations):
        outer = grouped @ (loading[:, :, None] * loading[:, None, :]).reshape(d, -1)
        moment, pull, spread = np.zeros((len(outer), (rank + 1) ** 2)), np.zeros((d, rank + 1)), np.zeros(outer.shape)
        for p, (patterns, pattern) in zip(parts, alike, strict=True):
            weight, data = _entries(y[p], offset[trial[p]])
            cov = np.linalg.inv((patterns @ outer).reshape(-1, rank, rank) / noise + np.eye(rank))
            z[p] = np.einsum("tij,tj->ti", cov[pattern], (data - weight * mean) @ loading) / noise
            left[p] = np.trace(cov, axis1=1, axis2=2)[pattern]
            extended = np.column_stack([z[p], np.ones(len(data))])
            moment += columns[p].T @ (extended[:, :, None] * extended[:, None, :]).reshape(len(data), -1)
            pull += data.T @ extended
            spread += (patterns.T * np.bincount(pattern)) @ cov.reshape(len(cov), -1)
        moment = moment.reshape(-1, rank + 1, rank + 1)
        moment[:, :rank, :rank] += spread.reshape(-1, rank, rank)
        moment[:, diagonal, diagonal] += noise / np.maximum(np.mean(loading**2, axis=0), 1e-14)
        moment[:, rank, rank] += 1e-9
        solution = np.linalg.solve(moment[group], pull[..., None])[..., 0]
        loading, mean = solution[:, :rank], np.where(ever, solution[:, rank], mean)
        if n_trials > 1:
            missed = np.zeros(count.shape)
            for p in parts:
                weight, data = _entries(y[p])
                missed += _by_trial(data - weight * (mean + z[p] @ loading.T), trial[p], n_trials)
            ridge = noise / (independent * offset_var)
            offset = missed / (count + ridge)
            unsure = noise / (independent * (count + ridge))
            offset_var = np.mean(offset**2 + unsure, axis=0).clip(1e-12)
        squared = float(np.vdot(grouped @ (loading[:, :, None] * loading[:, None, :]).reshape(d, -1), spread))
        for p in parts:
            weight, data = _entries(y[p], offset[trial[p]])
            squared += float(np.sum((data - weight * (mean + z[p] @ loading.T)) ** 2))
        before, noise = noise, max(squared / entries, 1e-14)
        if abs(noise - before) < 1e-4 * noise:
            break
    trial_sd = np.sqrt(offset_var) if n_trials > 1 else np.zeros(d)
    return Components(mean, offset, trial_sd, loading, z, 1 - left / rank, noise, trial)


def _entries(y: Array, offset: Array | float = 0.0) -> tuple[Array, Array]:
    """(n, D) 1 where an entry is seen, else 0; and what is seen, less an offset, else 0."""
    seen = np.isfinite(y)
    return seen.astype(float), np.where(seen, y - offset, 0.0)


def _alike(seen: Array, *, axis: int) -> tuple[Array, NDArray[np.int64]]:
    """Different rows (axis 0) or columns (axis 1) of a matrix of 0 and 1, and which of them each is."""
    different, which = np.unique(seen, axis=axis, return_inverse=True)
    return different.astype(float), which.reshape(-1)  # NumPy 2.0 alone gave it further axes


def _by_trial(values: Array, trial: NDArray[np.int64], n_trials: int) -> Array:
    """(G, D) sums of (n, D) values over the rows of each trial, which follow each other."""
    out = np.zeros((n_trials, values.shape[1]))
    starts = np.concatenate([[0], np.flatnonzero(np.diff(trial)) + 1])
    np.add.at(out, trial[starts], np.add.reduceat(values, starts, axis=0))
    return out


def _first_components(y: Array, rank: int, trial: NDArray[np.int64], count: Array) -> tuple[Array, Array, float]:
    """Mean, loadings and noise of poses whose gaps are bridged: where the search begins."""
    filled = np.concatenate([bridge(part) for part in np.split(y, np.flatnonzero(np.diff(trial)) + 1)])
    seen = np.isfinite(y)
    first = _first_mean(np.where(seen, y, 0.0), seen, filled)
    filled = np.where(seen | (count > 0)[trial], filled, first)
    mean = filled.mean(axis=0)
    filled -= mean
    _, s, vt = np.linalg.svd(filled, full_matrices=False)
    loading = vt[:rank].T * (s[:rank] / np.sqrt(len(y)))
    noise = max(float(np.mean((filled - filled @ vt[:rank].T @ vt[:rank]) ** 2)), 1e-14)
    return mean, loading, noise


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
    y: Array,
    *,
    ranks: Sequence[int],
    block: int,
    rng: np.random.Generator,
    trial: NDArray[np.int64] | None = None,
    sd: Array | None = None,
) -> tuple[PoseSubspace, Components, Array, tuple[int, ...]]:
    """The subspace of poses, of the smallest rank that predicts hidden samples within 5 % of the best.

    Args:
        y: (N, D) poses; NaN where not seen; three columns a marker.
        ranks: Ranks to choose from, increasing.
        block: Frames that a marker is hidden for.
        rng: Where to hide.
        trial: (N,) trial of each pose; None: all are of one.
        sd: (N, M) standard deviation of a measured coordinate, whose share is taken out of ``residual_sd``; None: 0.

    Returns:
        The subspace, the components that it rests on, the shapes z (N, r), and all ranks that predict as well.
    """
    markers = y.reshape(len(y), -1, 3)
    seen = np.isfinite(markers[..., 0])
    limit = max(1, min(len(y) // 8, y.shape[1]))
    candidates = [r for r in ranks if r <= limit] or [limit]
    masks = [hide_blocks(seen, rng, share=0.1, length=block) for _ in range(DRAWS if len(candidates) > 1 else 1)]

    def missed_by(rank: int, hidden: NDArray[np.bool_]) -> Array:
        shown = np.where(hidden[..., None], np.nan, markers).reshape(y.shape)
        poses = principal_components(shown, rank, trial=trial, iterations=12).poses.reshape(markers.shape)
        return np.where(hidden[..., None], markers - poses, np.nan)

    errors, misfit = [], []
    for rank in candidates:
        errors.append([missed_by(rank, hidden) for hidden in masks])
        misfit.append(float(np.sqrt(sum(np.nansum(one**2) for one in errors[-1]))))
        if len(misfit) > 2 and min(misfit[-2:]) > FAR_WORSE * min(misfit):
            break
    good = [i for i, value in enumerate(misfit) if value <= 1.05 * min(misfit)]
    best, hidden = good[0], masks[0]
    found = principal_components(y, candidates[best], trial=trial)
    basis, _, _ = np.linalg.svd(found.loading @ _root(found.scores), full_matrices=False)
    missed, noise = errors[best][0], np.zeros(1) if sd is None else np.where(hidden, sd, np.nan)
    lasting = np.sqrt(1 - noise_share(missed.reshape(y.shape), noise, trial))
    subspace = PoseSubspace(mean=found.mean, basis=basis, residual_sd=lasting * np.repeat(_marker_sd(missed), 3))
    return subspace, found, found.scores @ found.loading.T @ basis, tuple(candidates[i] for i in good)


def structure(series: Array, lag: int, trial: NDArray[np.int64] | None = None) -> float:
    """Mean square of the change of series (N, D) over some frames of one trial; NaN where none is known.

    Of an error e with white measurement noise of variance s^2 it is 2 s^2 + E (e(t + lag) - e(t))^2.
    """
    change = series[lag:] - series[:-lag]
    if trial is not None:
        change = change[trial[lag:] == trial[:-lag]]
    finite = change[np.isfinite(change)]
    return float(np.mean(finite**2)) if len(finite) else np.nan


def white_variance(series: Array, trial: NDArray[np.int64] | None = None) -> float:
    """Variance of white noise in series (N, D), by two lags of a structure function that begins as a parabola.

    The nugget of geostatistics (Cressie 1993); 0 where no two lags are known.
    """
    return max(float(np.nan_to_num((4 * structure(series, 1, trial) - structure(series, 2, trial)) / 6)), 0.0)


def noise_share(missed: Array, sd: Array, trial: NDArray[np.int64] | None = None) -> float:
    """Share of measurement noise in the mean square of what hidden samples were missed by; at most 0.95.

    What changes at random from frame to frame, but no more than what the measurements' deviations account for: in
    videos of few frames a second an animal moves as much as noise does.

    Args:
        missed: (N, D) errors; NaN where nothing was hidden.
        sd: (...) standard deviations of the coordinates that were hidden; NaN elsewhere.
        trial: (N,) trial of each pose; None: all are of one.
    """
    if not np.isfinite(missed).any() or not np.isfinite(sd).any():
        return 0.0
    white = min(white_variance(missed, trial), float(np.nanmean(sd**2)))
    return min(white / max(float(np.nanmean(missed**2)), 1e-30), 0.95)


def _root(scores: Array) -> Array:
    """(r, r) symmetric root of the second moment of the scores."""
    values, vectors = np.linalg.eigh(scores.T @ scores / len(scores))
    return vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T


def _marker_sd(error: Array) -> Array:
    """(M,) deviation of a coordinate of each marker, from (T, M, 3) errors; drawn towards that of all as 20 of it."""
    squares = np.nansum(error**2, axis=(0, 2)) / 3
    count = np.isfinite(error[..., 0]).sum(axis=0)
    overall = squares.sum() / max(count.sum(), 1)
    return np.sqrt(np.maximum((squares + 20.0 * overall) / (count + 20.0), 1e-14))
