"""Frames that were not measured, as what those around them say of them; left out where one side saw nothing.

Frames that are hidden at one end of a movement (a wing behind the body) make the rest look like another movement. A
trial is therefore all of its frames, those that were not seen as Gaussians.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import hilbert

from eal.arrays import Array

PHASES = 12
"""Of a cycle: half an hour of a clock face. Chosen."""
LEAST_SHARE = 0.05
"""A side saw a phase if it measured so much of its frames there. Chosen."""
NEAR = 150
"""Frames on either side of a gap that say what is in it: more cost more and say no more. Chosen."""
LENGTHS = np.geomspace(1.5, 100.0, 9)
NOISES = np.geomspace(1e-4, 1.0, 9)


@dataclass(frozen=True, eq=False, kw_only=True)
class Trial:
    """A trial, frame after frame.

    Attributes:
        mean: (N, d) where it is.
        cov: (N, d, d) how well that is known; 0: measured, and taken as it is.
        measured: (N,) whether it was measured.
        kept: (N,) frames that count.
    """

    mean: Array
    cov: Array
    measured: NDArray[np.bool_]
    kept: NDArray[np.bool_]

    def weighted(self) -> tuple[Array, Array]:
        """(n, d) samples and (n,) their shares: a frame with a covariance is the 2 d points of its cubature.

        Three for one coordinate (Gauss-Hermite), 2 d at sqrt(d) standard deviations for more.
        """
        d = self.mean.shape[1]
        if not self.cov.any():
            return self.mean[self.kept], np.full(self.kept.sum(), 1.0 / self.kept.sum())
        rows = np.flatnonzero(self.kept)
        certain = rows[np.trace(self.cov[rows], axis1=1, axis2=2) == 0.0]
        vague = np.setdiff1d(rows, certain)
        samples, shares = [self.mean[certain]], [np.ones(len(certain))]
        if len(vague):
            values, axes = np.linalg.eigh(self.cov[vague])
            steps = np.sqrt(np.maximum(values, 0.0))[:, None, :] * axes  # columns are axes
            if d == 1:
                offsets, weights = np.sqrt(3.0) * np.array([-1.0, 0.0, 1.0]), np.array([1.0, 4.0, 1.0]) / 6.0
                moved = self.mean[vague][None] + offsets[:, None, None] * steps[None, :, :, 0]
            else:
                weights = np.full(2 * d, 0.5 / d)
                each = np.sqrt(d) * np.moveaxis(steps, 2, 0)
                moved = self.mean[vague][None] + np.concatenate([each, -each])
            samples.append(moved.reshape(-1, d))
            shares.append(np.repeat(weights, len(vague)))
        share = np.concatenate(shares)
        frame = np.concatenate([certain, np.tile(vague, len(share[len(certain) :]) // max(len(vague), 1))])
        order = np.argsort(frame, kind="stable")
        return np.concatenate(samples)[order], share[order] / share.sum()


def trial_of(samples: ArrayLike, *, covariances: ArrayLike | None, measured: ArrayLike | None, where: str) -> Trial:
    """A trial from (N, d) samples, in which NaN is what was not seen.

    Raises:
        ValueError: not (N, d), nothing measured, infinite, or covariances or ``measured`` of another number of frames.
    """
    z = np.asarray(samples, dtype=np.float64)
    z = z[:, None] if z.ndim == 1 else z
    if z.ndim != 2 or not z.size or np.isinf(z).any():
        raise ValueError(f"{where}: samples must be (N, d), finite or NaN where not seen, but have shape {z.shape}")
    n, d = z.shape
    seen = np.array(np.isfinite(z).all(axis=1), dtype=bool)
    if not seen.any():
        raise ValueError(f"{where}: none of its {n} frames was seen: leave the trial out")
    cov = np.zeros((n, d, d)) if covariances is None else np.array(covariances, dtype=np.float64)
    known = seen if measured is None else np.array(np.asarray(measured, dtype=bool) & seen)
    if cov.shape != (n, d, d) or known.shape != (n,):
        raise ValueError(
            f"{where}: of {n} frames covariances must be {(n, d, d)} and measured {(n,)}, but are {cov.shape} and "
            f"{known.shape}"
        )
    cov = np.where(np.isfinite(cov), cov, 0.0)
    if not seen.all():
        z = z.copy()
        for j in range(d):
            z[:, j], variance = estimated(z[:, j], seen)
            cov[~seen, j, j] = variance[~seen]
    return Trial(mean=z, cov=cov, measured=known, kept=np.ones(n, dtype=bool))


def estimated(values: Array, seen: NDArray[np.bool_]) -> tuple[Array, Array]:
    """(N,) values with those not seen estimated by a Gaussian process, and (N,) variances, 0 where seen.

    Matern 5/2 over frames, its length and noise those under which what was seen is likeliest (Rasmussen & Williams
    2006, equation 5.8), from ``NEAR`` frames on either side of each run of gaps.
    """
    found, variance = values.copy(), np.zeros(len(values))
    missing = np.flatnonzero(~seen)
    starts = np.flatnonzero(np.diff(missing, prepend=-2 * NEAR - 2) > NEAR)
    for start, stop in zip(starts, [*starts[1:], len(missing)], strict=True):
        inside = missing[start:stop]
        low, high = inside[0] - NEAR, inside[-1] + NEAR + 1
        rows = np.arange(max(low, 0), min(high, len(values)))
        known = rows[seen[rows]]
        if len(known) < 3:
            known = np.flatnonzero(seen)
        if len(known) > 4 * NEAR:
            known = known[np.linspace(0, len(known) - 1, 4 * NEAR).astype(int)]
        found[inside], variance[inside] = _conditional(known, values[known], inside)
    return found, variance


def _conditional(known: NDArray[np.intp], values: Array, at: NDArray[np.intp]) -> tuple[Array, Array]:
    middle, scale = values.mean(), values.std()
    if scale == 0.0 or len(known) < 3:
        return np.full(len(at), middle), np.full(len(at), max(scale, 0.0) ** 2)
    y = (values - middle) / scale
    best, n = None, len(y)
    between = np.abs(known[:, None] - known[None, :]).astype(np.float64)
    for length in LENGTHS:
        sigma, axes = np.linalg.eigh(_matern(between / length))
        projected2 = (axes.T @ y) ** 2
        for noise in NOISES:
            values2 = np.maximum(sigma, 0.0) + noise
            size = float(np.mean(projected2 / values2))
            score = n * np.log(size) + np.log(values2).sum()
            if best is None or score < best[0]:
                best = (score, length, noise, size, axes, values2)
    assert best is not None
    _, length, noise, size, axes, values2 = best
    cross = _matern(np.abs(at[:, None] - known[None, :]) / length)
    weights = cross @ axes / values2
    mean = weights @ (axes.T @ y)
    variance = size * np.maximum(1.0 + noise - np.einsum("ij,ij->i", weights, cross @ axes), 0.0)
    return middle + scale * mean, scale**2 * variance


def _matern(distance: Array) -> Array:
    s = np.sqrt(5.0) * distance
    return (1.0 + s + s * s / 3.0) * np.exp(-s)


def known_phases(a: Sequence[Trial], b: Sequence[Trial]) -> tuple[list[Trial], tuple[float, float]]:
    """All trials without the frames in phases of the cycle that one side never saw, and what share of a and b that is.

    The phase is that of the analytic signal of the first principal component, whose rising zero is at 0; where all
    was seen nothing is left out, and no phase is made.
    """
    trials = [*a, *b]
    if all(one.measured.all() for one in trials):
        return trials, (0.0, 0.0)
    whole = np.concatenate([one.mean for one in trials])
    middle = whole.mean(axis=0)
    axis = np.linalg.svd(np.cov((whole - middle).T).reshape(whole.shape[1], -1))[0][:, 0]
    members = []
    for one in trials:
        wave = (one.mean - middle) @ axis
        phase = np.angle(np.asarray(hilbert(wave - wave.mean()))) if len(wave) > 2 else np.zeros(len(wave))
        members.append(np.clip(((phase + np.pi) / (2.0 * np.pi) * PHASES).astype(int), 0, PHASES - 1))
    good = np.ones(PHASES, dtype=bool)
    for part in (range(len(a)), range(len(a), len(trials))):
        there = np.concatenate([members[i] for i in part])
        seen = np.concatenate([trials[i].measured for i in part])
        for phase in range(PHASES):
            at = there == phase
            good[phase] &= not at.any() or seen[at].mean() >= LEAST_SHARE
    kept = [replace(one, kept=good[where]) for one, where in zip(trials, members, strict=True)]
    kept = [one if one.kept.any() else replace(one, kept=np.ones(len(one.mean), dtype=bool)) for one in kept]
    left = [
        float(1.0 - np.mean(np.concatenate([one.kept for one in part]))) for part in (kept[: len(a)], kept[len(a) :])
    ]
    return kept, (left[0], left[1])
