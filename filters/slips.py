"""How far a marker is from where the rest of its rigid body has it, over time: skin slides, shoes bend."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

from eal.arrays import Array, true_runs

LASTS = 3.0 * 2.0 ** np.arange(7)
"""Lengths of time, in frames, of which the likeliest is taken: from the noise's to that of the longest gaps."""
SIZES = 2.0 ** np.arange(-1, 4)
"""Variances to look at, in that of what was seen: a stretch that is short beside what lasts shows too little of it."""
HIDDEN = 6
"""Gaps hidden in a series, at most."""
MOST = 50
"""Frames of a series that are looked at: what lasts is the same in each second of them."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Slip:
    """What a marker's distance from its place in a body is like: a Gaussian process about an offset of each trial.

    Attributes:
        offset_m: (3,) mean offset of other trials; 0 without any.
        between_m2: (3, 3) covariance of a trial's offset about that; None: no other trial tells it.
        within_m2: (3, 3) covariance of what changes in a trial.
        lasts: Length of its Matern-5/2 kernel in frames.
        white_m2: Variance of a coordinate of what does not last.
        widen: Factor on deviations by which errors in gaps that are hidden in the series are what is stated.
        dof: Of the estimate of its square: three a gap.
        usual_m2: (3, 3) covariance that the body's shape has for it.
    """

    offset_m: Array
    between_m2: Array | None
    within_m2: Array
    lasts: float
    white_m2: float
    widen: float = 1.0
    dof: float = 3.0
    usual_m2: Array | None = None

    def of(self, series: Sequence[Array], usual_m2: Array) -> "Slip":
        """The same marker while others of its body are seen: by as much more or less as the body's shape has it."""
        if self.usual_m2 is None or np.array_equal(usual_m2, self.usual_m2):
            return self
        ratio = float(np.trace(usual_m2) / np.trace(self.usual_m2))
        means = [one[np.isfinite(one[:, 0])].mean(axis=0) for one in series[:-1] if np.isfinite(one[:, 0]).any()]
        between = None if self.between_m2 is None or not means else ratio * self.between_m2
        offset = np.mean(means, axis=0) if means else np.zeros(3)
        white = _white(series)
        return replace(self, offset_m=offset, between_m2=between, within_m2=ratio * self.within_m2, white_m2=white)


def kernel(lag: NDArray[np.int64], lasts: float) -> Array:
    """Matern-5/2 correlation of frames that are so far apart."""
    apart = np.sqrt(5) * np.abs(lag) / lasts
    return (1 + apart + apart**2 / 3) * np.exp(-apart)


def learn_slip(series: Sequence[Array], length: int, usual_m2: Array) -> Slip:
    """Learn it from trials, of which the last is the one to fill.

    Length and size are those of the largest likelihood of all series, each about an offset of its own of which nothing
    is known.

    Args:
        series: (T, 3) distances of each trial; NaN where the marker or the rest of its body is not seen.
        length: Frames of the gap that is to be filled.
        usual_m2: (3, 3) covariance where no series shows it.
    """
    parts, means, counts, white_m2 = [], [], [], _white(series)
    for one in series:
        frames = np.flatnonzero(np.isfinite(one[:, 0]))
        if len(frames) < 3:
            continue
        some = frames[:: max(1, -(-len(frames) // MOST))]
        parts.append((some, one[some] - one[frames].mean(axis=0)))
        means.append(one[frames].mean(axis=0))
        counts.append(len(frames))
    if not parts:
        lasts, none = float(LASTS[-1]), np.zeros((3, 3))
        return Slip(
            offset_m=np.zeros(3), between_m2=none, within_m2=usual_m2, lasts=lasts, white_m2=white_m2, usual_m2=usual_m2
        )
    about = np.concatenate([part for _, part in parts])
    within = about.T @ about / max(len(about) - len(parts), 1)
    variance = max(float(np.trace(within)) / 3 - white_m2, 1e-3 * float(np.trace(within)) / 3, 1e-18)
    logs = np.array([_log_likelihoods(parts, variance, lasts, white_m2) for lasts in LASTS])
    which, how = np.unravel_index(logs.argmax(), logs.shape)
    lasts, size = LASTS[which], SIZES[how]
    shown = 1 + np.array(counts) / (2 * lasts)  # independent samples
    between = None
    if len(parts) > 1:
        away = np.array(means) - np.mean(means, axis=0)
        sampled = np.mean(variance * size / shown + white_m2 / np.minimum(counts, MOST))
        between = away.T @ away / (len(parts) - 1)
        between = _positive(between - sampled * np.eye(3)) * (1 + 1 / len(parts)) + 1e-6 * within
    own = np.isfinite(series[-1][:, 0]).sum() >= 3
    others = means[:-1] if own else means
    slip = Slip(
        offset_m=np.mean(others, axis=0) if others else np.zeros(3),
        between_m2=between,
        within_m2=within * (variance * size / (np.trace(within) / 3)),
        lasts=float(lasts),
        white_m2=white_m2,
        usual_m2=usual_m2,
    )
    squared = np.concatenate([_in_hidden_gaps(slip, one, length) for one in series])
    fitted, dof = 1.5 * float(shown.sum()), 1.5 * float(shown.sum()) + 3 * len(squared)
    return replace(slip, widen=float(np.sqrt((fitted + 3 * squared.sum()) / dof)), dof=dof)


def _white(series: Sequence[Array]) -> float:
    """Variance of a coordinate's noise: by third differences, of variance 20 of it, which slow changes have not."""
    change = np.concatenate([np.abs(np.diff(one, n=3, axis=0)).ravel() for one in series])
    change = change[np.isfinite(change)]
    return float(np.median(change) / ndtri(0.75)) ** 2 / 20 if len(change) else 0.0


def longest_run(frames: NDArray[np.int64]) -> int:
    """Length of the longest run of consecutive ones of increasing frames."""
    return max(len(run) for run in np.split(frames, np.flatnonzero(np.diff(frames) > 1) + 1))


def _in_hidden_gaps(slip: Slip, seen_m: Array, length: int) -> Array:
    """(g,) mean squares of errors over deviations in gaps that are hidden one at a time in a series (T, 3).

    They are as long as the one to fill, or half of the longest stretch that is seen, if that is less: then they count
    for more by the root of the ratio of lengths: no gap shows whether the variance grows with time as the kernel says.
    """
    seen = np.isfinite(seen_m[:, 0])
    runs = [(start, stop) for start, stop in true_runs(seen) if stop - start >= 6]
    if not runs:
        return np.zeros(0)
    wanted, length = length, min(length, max(stop - start for start, stop in runs) // 2)
    starts = [a for start, stop in runs for a in range(start + 2, stop - length - 1, max(1, length // 2))]
    out = []
    for start in starts[:: max(1, -(-len(starts) // HIDDEN))]:
        frames = np.arange(start, start + length)[:: max(1, length // 8)]
        shown = seen_m.copy()
        shown[start : start + length] = np.nan
        mean, cov = bridged(replace(slip, dof=np.inf), shown, frames)
        variance = np.trace(cov, axis1=1, axis2=2) / 3 + slip.white_m2
        out.append(np.sqrt(wanted / length) * float(np.mean((seen_m[frames] - mean) ** 2 / variance[:, None])))
    return np.array(out)


def _log_likelihoods(
    parts: Sequence[tuple[NDArray[np.int64], Array]], variance: float, lasts: float, white_m2: float
) -> Array:
    """Log likelihoods of series about an offset of which nothing is known, for each of ``SIZES``."""
    total = np.zeros(len(SIZES))
    for frames, away in parts:
        values, vectors = np.linalg.eigh(kernel(frames[:, None] - frames, lasts) + 100.0)
        cov = variance * SIZES[:, None] * (np.maximum(values, 0.0) + 1e-6) + white_m2
        squared = np.sum((vectors.T @ away) ** 2, axis=1)
        total -= 0.5 * np.sum(squared / cov + 3 * np.log(cov), axis=1)
    return total


def bridged(slip: Slip, seen_m: Array, frames: NDArray[np.int64]) -> tuple[Array, Array]:
    """(n, 3) distances in frames in which they are not seen, and (n, 3, 3) their covariances.

    Kriging (Matheron 1969) from the frames in which they are: near these the marker is where it was seen, and the
    covariance grows with the time since. Its size is an estimate, so that intervals are those of Student's t.

    Args:
        slip: What is known of it.
        seen_m: (T, 3) of the trial; NaN where not seen.
        frames: (n,) which.
    """
    known = np.flatnonzero(np.isfinite(seen_m[:, 0]))
    apart = np.abs(known[:, None] - frames).min(axis=1, initial=len(seen_m))
    every = max(1, -(-len(known) // MOST))
    known = known[(np.arange(len(known)) % every == 0) | (apart <= 6)]
    variance = float(np.trace(slip.within_m2)) / 3
    offset = 100.0 * slip.within_m2 if slip.between_m2 is None else slip.between_m2
    ratio = float(np.trace(offset)) / 3 / variance
    own = kernel(known[:, None] - known, slip.lasts) + ratio
    own += (slip.white_m2 / variance + 1e-6) * np.eye(len(known))
    cross = kernel(frames[:, None] - known, slip.lasts) + ratio
    by = np.linalg.solve(own, cross.T).T
    mean = slip.offset_m + by @ (seen_m[known] - slip.offset_m)
    left = np.maximum(1 + ratio - np.einsum("nk,nk->n", by, cross), 1e-6)
    shape = (slip.within_m2 + offset) / (1 + ratio)
    wide = slip.widen**2 if np.isinf(slip.dof) else (slip.widen * stdtrit(slip.dof, 0.975) / ndtri(0.975)) ** 2
    return mean, wide * left[:, None, None] * shape


def _positive(matrix: Array) -> Array:
    values, vectors = np.linalg.eigh(matrix)
    return (vectors * np.maximum(values, 0.0)) @ vectors.T
