"""Gaps made on purpose in measured trials, to see how a model fills them."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from filters.poses import MarkerTrial
from mocap.arrays import Array

GAP_FRAMES = (10, 25, 50, 100)
"""Lengths of the gaps that a model is prepared for, as far as trials have room for them."""


def unseen_runs(seen: NDArray[np.bool_]) -> Iterator[tuple[int, int, int]]:
    """Marker, first frame and frame after the last of every run of (T, M) sightings in which a marker is not seen."""
    edges = np.diff(np.pad((~seen).astype(np.int8), ((1, 1), (0, 0))), axis=0).T
    marker, start = np.nonzero(edges == 1)
    _, stop = np.nonzero(edges == -1)
    yield from zip(marker.tolist(), start.tolist(), stop.tolist(), strict=True)


def lengths_for(n_frames: int) -> list[int]:
    """Lengths of gaps that a trial has room for."""
    lengths = [n for n in GAP_FRAMES if max(1.5 * n, n + 6) <= n_frames] or [max(1, n_frames // 4)]
    return [n for n in lengths if n + 6 <= n_frames]


@dataclass(frozen=True, eq=False, kw_only=True)
class Hidden:
    """A trial with samples hidden.

    Attributes:
        trial: The trial as it was measured.
        mask: (T, M) what is hidden; all of it was measured.
        gap: (T, M) number of the gap that a hidden sample lies in; -1 else.
        length: (T, M) length of that gap in frames; 0 else.
    """

    trial: MarkerTrial
    mask: NDArray[np.bool_]
    gap: NDArray[np.int64]
    length: NDArray[np.int64]

    @property
    def shown(self) -> MarkerTrial:
        """The trial without what is hidden."""
        return replace(self.trial, xyz_m=np.where(self.mask[..., None], np.nan, self.trial.xyz_m))

    def count(self, frames: int) -> int:
        """Number of gaps of that length."""
        return len(np.unique(self.gap[self.length == frames]))


def hide_groups(trial: MarkerTrial, rng: np.random.Generator) -> Hidden:
    """Hide markers as recordings lose them: one, it with its neighbours, half, three quarters; for 10 to 100 frames.

    Gaps lie apart by a quarter of their length, were measured in three frames on both sides and for at least half of
    their length. Lengths take turns from a random one on downwards: a trial that has no room for all holds others each
    time. There is at most one gap of each length for each size of group.

    Args:
        trial: The trial.
        rng: Where to hide.
    """
    seen = trial.seen
    n_frames, n_markers = seen.shape
    known = np.where(np.asarray(seen.any(axis=1))[:, None, None], trial.xyz_m, 0.0)
    centred = trial.xyz_m - np.nanmean(known, axis=1, keepdims=True)
    place = np.nansum(centred, axis=0) / np.maximum(seen.sum(axis=0), 1)[:, None]
    near = np.argsort(np.linalg.norm(place[:, None] - place[None], axis=-1), axis=1)
    gap, length = np.full(seen.shape, -1), np.zeros(seen.shape, dtype=np.int64)
    busy = np.zeros(n_frames, dtype=bool)
    sizes = (1, max(2, n_markers // 4), max(3, n_markers // 2), max(4, 3 * n_markers // 4))
    lengths = lengths_for(n_frames)
    number, turn = 0, int(rng.integers(max(len(lengths), 1)))
    order = [*lengths[turn::-1], *lengths[:turn:-1]]
    for size, frames in product(rng.permutation(sizes), order):
        for _ in range(30):
            start = int(rng.integers(3, max(n_frames - frames - 3, 4)))
            inside = slice(start, start + frames)
            group = near[rng.integers(n_markers), :size]
            sides = np.concatenate([seen[start - 3 : start], seen[start + frames : start + frames + 3]])
            group = group[sides[:, group].all(axis=0) & (seen[inside][:, group].mean(axis=0) >= 0.5)]
            if len(group) and not busy[max(0, start - frames // 4) : start + frames + frames // 4].any():
                busy[inside] = True
                gap[inside, group], length[inside, group] = number, frames
                number += 1
                break
    mask = (gap >= 0) & seen
    return Hidden(trial=trial, mask=mask, gap=np.where(mask, gap, -1), length=np.where(mask, length, 0))


@dataclass(frozen=True, eq=False, kw_only=True)
class Fill:
    """What one model said of n hidden samples.

    Attributes:
        miss_m: (n, 3) estimates minus measurements.
        variance: (n, 3) stated variance of the estimates.
        noise: (n,) variance of the measurements.
        gap: (n,) number of the gap.
        length: (n,) its length in frames.
    """

    miss_m: Array
    variance: Array
    noise: Array
    gap: NDArray[np.int64]
    length: NDArray[np.int64]

    @property
    def apart(self) -> Array:
        """(n, 3) stated variance of what estimates and measurements lie apart."""
        return self.variance + self.noise[:, None]

    @property
    def log_rmse(self) -> float:
        """Mean over lengths of the logarithm of the root mean square distance in metres."""
        squared = np.sum(self.miss_m**2, axis=1)
        return float(np.mean([0.5 * np.log(squared[self.length == n].mean()) for n in np.unique(self.length)]))

    @property
    def cost(self) -> float:
        """What a search makes small: accuracy, and where the model is sure for good reason.

        Mean over lengths of (log rmse + the negative log density of a coordinate after the stated deviations were
        scaled by one best factor) / 2; the factor is learned afterwards (``Mixture.widen``).
        """
        density = []
        for n in np.unique(self.length):
            variance, squared = self.apart[self.length == n], self.miss_m[self.length == n] ** 2
            density.append(0.5 * np.log(variance).mean() + 0.5 * np.log(np.mean(squared / variance)))
        return 0.5 * (self.log_rmse + float(np.mean(density)))


def fill_of(hidden: Hidden, xyz_m: Array, cov_m2: Array) -> Fill:
    """Compare estimates (T, M, 3) with covariance (T, M, 3, 3) with what was hidden."""
    where = hidden.mask
    return Fill(
        miss_m=(xyz_m - hidden.trial.xyz_m)[where],
        variance=np.diagonal(cov_m2[where], axis1=-2, axis2=-1),
        noise=hidden.trial.sd_m[where] ** 2,
        gap=hidden.gap[where],
        length=hidden.length[where],
    )


def joined_fills(fills: list[Fill]) -> Fill:
    """The hidden samples of several trials together."""
    start = np.cumsum([0, *(int(f.gap.max(initial=-1)) + 1 for f in fills)])
    return Fill(
        miss_m=np.concatenate([f.miss_m for f in fills]),
        variance=np.concatenate([f.variance for f in fills]),
        noise=np.concatenate([f.noise for f in fills]),
        gap=np.concatenate([f.gap + s for f, s in zip(fills, start, strict=False)]),
        length=np.concatenate([f.length for f in fills]),
    )
