"""Distances of markers: which are kept and what they are, and how large one animal is against another."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from mocap.filters.independent import INDEPENDENT
from mocap.filters.motion.potential import Bones
from mocap.filters.poses import MarkerTrial
from numpy.typing import NDArray

from eal.arrays import Array

RIGID = 0.05
"""A rigid bone varies by no larger share of its length. Chosen, not measured."""
LEAST_SIZE = 0.02
"""Sizes that differ by less, or by less than twice what their estimate errs by, count as equal. Chosen,
not measured."""


def learn_bones(trials: Sequence[MarkerTrial], ends: NDArray[np.int64]) -> Bones:
    """Lengths in the last of some trials, and how far they are kept.

    A distance varies within a trial with the variance w (less that of the measurements), and its mean over trials
    (animal, placement of markers) with b. The last trial's length L is the mean of its own and of that of all trials,
    by their precisions, and s^2 = w + what is uncertain of L.

    Args:
        trials: Trials of the same markers.
        ends: (P, 2) markers; pairs that are seen together too little to tell are left out.
    """
    sums = [_distances(trial, ends) for trial in trials]
    count, mean, noise, spread = (np.array(parts) for parts in zip(*sums, strict=True))  # (G, P) each
    seen = count > 0
    freedom = count.sum(axis=0) - seen.sum(axis=0) / INDEPENDENT
    ok = freedom > 0
    ends, count, mean, seen, freedom = ends[ok], count[:, ok], mean[:, ok], seen[:, ok], freedom[ok]
    length = (count * mean).sum(axis=0) / count.sum(axis=0)
    floor = (0.005 * length) ** 2  # no distance is known better than to half a percent
    within = np.maximum((spread.sum(axis=0) - noise.sum(axis=0))[ok] / freedom, floor)
    trials_known = seen.sum(axis=0)
    differ = np.where(seen, (mean - length) ** 2, 0.0).sum(axis=0) / np.maximum(trials_known - 1, 1)
    between = np.where(trials_known > 1, np.maximum(differ, floor), (0.1 * length) ** 2)
    own, common = INDEPENDENT * count[-1] / within, 1 / between
    return Bones(
        ends=ends,
        length_m=(own * mean[-1] + common * length) / (own + common),
        sd_m=np.sqrt(within + 1 / (own + common)),
    )


def _distances(trial: MarkerTrial, ends: NDArray[np.int64]) -> tuple[Array, Array, Array, Array]:
    """(P,) frames in which both ends are seen, mean distance, and sums of its noise's variance and squared deviation.

    Some pairs at a time: memory beside the trial does not grow with its frames times pairs.
    """
    out = [np.zeros(len(ends)) for _ in range(4)]
    width = max(1, 2**20 // max(len(trial.xyz_m), 1))  # 8 MiB of distances
    for start in range(0, len(ends), width):
        some = slice(start, start + width)
        a, b = ends[some].T
        apart = np.linalg.norm(trial.xyz_m[:, a] - trial.xyz_m[:, b], axis=-1)
        seen = np.isfinite(apart)
        count = seen.sum(axis=0)
        mean = np.where(seen, apart, 0.0).sum(axis=0) / np.maximum(count, 1)
        noise = np.where(seen, trial.sd_m[:, a] ** 2 + trial.sd_m[:, b] ** 2, 0.0).sum(axis=0)
        spread = np.where(seen, (apart - mean) ** 2, 0.0).sum(axis=0)
        for whole, part in zip(out, (count, mean, noise, spread), strict=True):
            whole[some] = part
    return out[0], out[1], out[2], out[3]


def rigid_bones(trials: Sequence[MarkerTrial], named: Sequence[tuple[int, int]] = ()) -> Bones:
    """The bones of the last of some trials: those that are named, and pairs that keep their distance as if they were.

    Pairs are taken in the order of how well they keep it, s / L, of ``RIGID`` at most, until each marker has two bones.

    Args:
        trials: Trials of the same markers.
        named: Ends of the skeleton's rigid bones.
    """
    pairs = learn_bones(trials, np.array(np.triu_indices(trials[0].xyz_m.shape[1], 1)).T)
    share = pairs.sd_m / pairs.length_m
    wanted = {(min(ends), max(ends)) for ends in named}
    chosen = [i for i, ends in enumerate(pairs.ends.tolist()) if tuple(ends) in wanted]
    links = np.bincount(pairs.ends[chosen].ravel(), minlength=trials[0].xyz_m.shape[1])
    for i in np.argsort(share, kind="stable"):
        if share[i] <= RIGID and i not in chosen and links[pairs.ends[i]].min() < 2:
            chosen.append(int(i))
            links[pairs.ends[i]] += 1
    return Bones(ends=pairs.ends[chosen], length_m=pairs.length_m[chosen], sd_m=pairs.sd_m[chosen])


def relative_size(trial: MarkerTrial, other: MarkerTrial) -> tuple[float, float]:
    """How much larger one animal is than another, as a logarithm, with its standard error.

    The weighted mean over pairs of markers of log (mean distance in one / mean distance in the other). A pair's error
    is what its distance varies by, over the number of independent frames; pairs that keep their distance count most.
    The standard error of the mean follows from how the pairs differ: proportions, and where markers were placed.

    Args:
        trial: The one.
        other: The other, of the same markers.
    """
    pairs = np.array(np.triu_indices(trial.xyz_m.shape[1], 1)).T
    (one, one_error), (two, two_error) = (log_distances(t, pairs) for t in (trial, other))
    error = np.hypot(one_error, two_error)
    ok = np.isfinite(error)
    if ok.sum() < 3:
        return 0.0, np.inf
    ratio, weight = (one - two)[ok], 1 / (error[ok] ** 2 + LEAST_SIZE**2)
    mean = float(np.average(ratio, weights=weight))
    markers = trial.xyz_m.shape[1]  # pairs share markers: no more of them are independent
    spread = float(np.average((ratio - mean) ** 2, weights=weight))
    return mean, float(np.sqrt(spread / min(markers, ok.sum()) + 1 / weight.sum()))


def log_distances(trial: MarkerTrial, ends: NDArray[np.int64]) -> tuple[Array, Array]:
    """Log of the mean distance of each of (P, 2) pairs, and the standard error of that; NaN where hardly seen."""
    count, mean, _, squares = _distances(trial, ends)
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.sqrt(squares / np.maximum(count, 1) / np.maximum(INDEPENDENT * count, 1)) / mean
        enough = (count >= 10) & (mean > 0)
        return np.where(enough, np.log(np.maximum(mean, 1e-300)), np.nan), np.where(enough, error, np.nan)


def size_factor(trial: MarkerTrial, target: MarkerTrial) -> float:
    """By how much an animal is to be enlarged to be as large as another one; 1 where no difference is certain."""
    log_ratio, error = relative_size(target, trial)
    return float(np.exp(log_ratio)) if abs(log_ratio) > max(LEAST_SIZE, 2 * error) else 1.0


def sized_like(trials: Sequence[MarkerTrial], target: MarkerTrial) -> list[MarkerTrial]:
    """Trials scaled to the size of the animal in another one; those of the same size are returned as they are.

    An animal that is larger by a factor moves in the same angles, with all lengths and speeds that much larger.
    """
    factors = [size_factor(trial, target) for trial in trials]
    return [
        trial if factor == 1 else replace(trial, xyz_m=factor * trial.xyz_m, sd_m=factor * trial.sd_m)
        for trial, factor in zip(trials, factors, strict=True)
    ]
