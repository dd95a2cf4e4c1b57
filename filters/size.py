"""Animals of other sizes: trials are brought to the size of the one that is to be tracked."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from mocap.filters.poses import INDEPENDENT, MarkerTrial
from numpy.typing import NDArray

from eal.arrays import Array

LEAST = 0.02
"""Sizes that differ by less, or by less than twice what their estimate errs by, count as equal. Chosen,
not measured."""


def relative_size(trial: MarkerTrial, other: MarkerTrial) -> tuple[float, float]:
    """How much larger one animal is than another, as a logarithm, with its standard error.

    The weighted mean over pairs of markers of log (mean distance in one / mean distance in the other). A pair's error
    is what its distance varies by, over the number of independent frames; pairs that keep their distance count most.
    The standard error of the mean follows from how the pairs differ: proportions, and where markers were placed.

    Args:
        trial: The one.
        other: The other, of the same markers.
    """
    pairs = np.array(np.triu_indices(trial.xyz_m.shape[1], 1))
    (one, one_error), (two, two_error) = (log_distances(t.xyz_m, pairs) for t in (trial, other))
    error = np.hypot(one_error, two_error)
    ok = np.isfinite(error)
    if ok.sum() < 3:
        return 0.0, np.inf
    ratio, weight = (one - two)[ok], 1 / (error[ok] ** 2 + LEAST**2)
    mean = float(np.average(ratio, weights=weight))
    markers = trial.xyz_m.shape[1]  # pairs share markers: no more of them are independent
    spread = float(np.average((ratio - mean) ** 2, weights=weight))
    return mean, float(np.sqrt(spread / min(markers, ok.sum()) + 1 / weight.sum()))


def log_distances(xyz_m: Array, pairs: NDArray[np.intp]) -> tuple[Array, Array]:
    """Log of the mean distance of each pair, and the standard error of that; NaN for pairs that are hardly seen."""
    apart = np.linalg.norm(xyz_m[:, pairs[0]] - xyz_m[:, pairs[1]], axis=-1)
    seen = np.isfinite(apart)
    count = seen.sum(axis=0)
    mean = np.where(seen, apart, 0.0).sum(axis=0) / np.maximum(count, 1)
    spread = np.where(seen, (apart - mean) ** 2, 0.0).sum(axis=0) / np.maximum(count, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.sqrt(spread / np.maximum(INDEPENDENT * count, 1)) / mean
        enough = (count >= 10) & (mean > 0)
        return np.where(enough, np.log(np.maximum(mean, 1e-300)), np.nan), np.where(enough, error, np.nan)


def size_factor(trial: MarkerTrial, target: MarkerTrial) -> float:
    """By how much an animal is to be enlarged to be as large as another one; 1 where no difference is certain."""
    log_ratio, error = relative_size(target, trial)
    return float(np.exp(log_ratio)) if abs(log_ratio) > max(LEAST, 2 * error) else 1.0


def sized_like(trials: Sequence[MarkerTrial], target: MarkerTrial) -> list[MarkerTrial]:
    """Trials scaled to the size of the animal in another one; those of the same size are returned as they are.

    An animal that is larger by a factor moves in the same angles, with all lengths and speeds that much larger.
    """
    factors = [size_factor(trial, target) for trial in trials]
    return [
        trial if factor == 1 else replace(trial, xyz_m=factor * trial.xyz_m, sd_m=factor * trial.sd_m)
        for trial, factor in zip(trials, factors, strict=True)
    ]
