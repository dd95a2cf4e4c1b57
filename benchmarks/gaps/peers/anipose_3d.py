"""Anipose's 3D filter on pixels (Karashchuk et al. 2021, Cell Reports 36, 109730), as aniposelib's ``optim_points``.

Points minimise the sum of squares of reprojection errors in pixels, those above 15 px as the root of their size, of
``smooth`` times second differences over the mean step between frames, and of ``LENGTH`` times 100 times what bones
differ from their length, as a share of it. Bones are the pairs of markers that keep their distance in training, their
lengths are found with the points. aniposelib minimises by ``scipy.optimize.least_squares``, we by Gauss-Newton steps
with banded matrices, which find the same minimum in less time. It is given the pixels that the product believes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solveh_banded
from scipy.sparse import coo_array

from benchmarks.gaps.method import Estimate, Filler, Method, Trial
from benchmarks.gaps.peers.intervals import tune
from benchmarks.gaps.peers.rays import Rays, projected, rays_of
from eal.arrays import Array

THRESHOLD_PX, LENGTH, STEPS = 15.0, 2.0, 8
Rows = tuple[Array, Array, Array]
"""Residuals (k,), the variables of each (k, v), and its derivatives by them (k, v)."""


def bones(trials: Sequence[Trial], *, spread: float = 0.05) -> list[list[int]]:
    """Pairs of markers whose distance varies by less than a share, the stiffest first, one tree a set of markers."""
    xyz = np.concatenate([trial.xyz_m for trial in trials])
    pairs = []
    for a in range(xyz.shape[1]):
        for b in range(a):
            length = np.linalg.norm(xyz[:, a] - xyz[:, b], axis=-1)
            length = length[np.isfinite(length)]
            if len(length) > 20:
                pairs.append((float(length.std() / length.mean()), b, a))
    group = list(range(xyz.shape[1]))
    chosen = []
    for share, b, a in sorted(pairs):
        if share < spread and group[a] != group[b]:
            chosen.append([b, a])
            group = [group[b] if g == group[a] else g for g in group]
    return chosen


def reprojection(rays: Rays, xyz_m: Array) -> list[Rows]:
    """Errors of all rays in pixels."""
    n_markers = xyz_m.shape[1]
    out = []
    for matrix, uv_px in zip(rays.matrices, rays.uv_px, strict=True):
        frame, marker = np.nonzero(np.isfinite(uv_px[..., 0]))
        uv, slope = projected(matrix, xyz_m[frame, marker])
        error = uv - uv_px[frame, marker]
        size = np.linalg.norm(error, axis=1)
        far = np.maximum(size, THRESHOLD_PX)
        weight = np.where(size > THRESHOLD_PX, THRESHOLD_PX * (2 * np.sqrt(far / THRESHOLD_PX) - 1) / far, 1.0)
        where = 3 * (frame * n_markers + marker)[:, None] + np.arange(3)
        out.append(
            (
                (weight[:, None] * error).ravel(),
                np.repeat(where, 2, axis=0),
                (weight[:, None, None] * slope).reshape(-1, 3),
            )
        )
    return out


def smoothness(xyz_m: Array, scale: float) -> Rows:
    """Second differences of every coordinate, in units of 1 / scale."""
    flat = xyz_m.reshape(len(xyz_m), -1)
    error = scale * (flat[2:] - 2 * flat[1:-1] + flat[:-2])
    first = np.arange(error.size)
    where = first[:, None] + flat.shape[1] * np.arange(3)
    return error.ravel(), where, np.tile(scale * np.array([1.0, -2.0, 1.0]), (error.size, 1))


def lengths(xyz_m: Array, pairs: Sequence[Sequence[int]], length_m: Array) -> list[Rows]:
    """What bones differ from their lengths, in per cent times ``LENGTH``."""
    n_frames, n_markers, _ = xyz_m.shape
    out = []
    for (a, b), known in zip(pairs, length_m, strict=True):
        apart = xyz_m[:, a] - xyz_m[:, b]
        size = np.maximum(np.linalg.norm(apart, axis=1), 1e-9)
        scale = 100 * LENGTH / known
        slope = scale * apart / size[:, None]
        start = 3 * n_markers * np.arange(n_frames)[:, None]
        where = np.concatenate([start + 3 * a + np.arange(3), start + 3 * b + np.arange(3)], axis=1)
        out.append((scale * (size - known), where, np.concatenate([slope, -slope], axis=1)))
    return out


def step(rows: Sequence[Rows], count: int, width: int) -> Array:
    """(count,) step of Gauss-Newton; ``width`` is the most that two variables of a residual are apart."""
    band = np.zeros((width + 1, count))
    right = np.zeros(count)
    for error, where, slope in rows:
        np.add.at(right, where.ravel(), (slope * error[:, None]).ravel())
        size = where.shape[1]
        i, j = np.repeat(where, size, axis=1), np.tile(where, (1, size))
        product = (slope[:, :, None] * slope[:, None, :]).reshape(len(slope), -1)
        low = i >= j
        band += coo_array((product[low], ((i - j)[low], j[low])), shape=band.shape).toarray()
    band[0] += 1e-9 * band[0].max()
    return -solveh_banded(band, right, lower=True)


@dataclass(frozen=True, eq=False)
class PointOptimiser:
    """The filter with its smoothness and bones."""

    smooth: float
    pairs: Sequence[Sequence[int]]

    def __call__(self, trial: Trial) -> Estimate:
        """Optimise all points together, beginning with a straight line through every gap."""
        rays = rays_of(trial)
        xyz = straight(rays.xyz_m)
        _, n_markers, _ = xyz.shape
        scale = self.smooth / float(np.mean(np.abs(np.diff(xyz, axis=0))))
        width = 6 * n_markers + 2 if len(xyz) > 2 else 3 * n_markers
        for _ in range(STEPS):
            apart = [np.linalg.norm(xyz[:, a] - xyz[:, b], axis=1) for a, b in self.pairs]
            known = np.array([np.median(part) for part in apart])
            rows = [*reprojection(rays, xyz), smoothness(xyz, scale), *lengths(xyz, self.pairs, known)]
            change = step(rows, xyz.size, max(width, 3 * n_markers)).reshape(xyz.shape)
            xyz = xyz + change
            if np.abs(change).max() < 1e-6:
                break
        return Estimate(xyz, None)


def straight(xyz_m: Array) -> Array:
    """(T, M, 3) points with straight lines through gaps; a marker that is never seen is put where the others are."""
    out = np.array(xyz_m)
    time = np.arange(len(out))
    middle = np.nanmean(xyz_m.reshape(-1, 3), axis=0)
    for m in range(out.shape[1]):
        seen = np.isfinite(out[:, m, 0])
        for k in range(3):
            out[:, m, k] = np.interp(time, time[seen], out[seen, m, k]) if seen.any() else middle[k]
    return out


@dataclass(frozen=True)
class Anipose3D:
    """Anipose's filter on the cameras of the trial."""

    name: str = "anipose_3d"
    needs_film: bool = True

    def learn(self, training: Sequence[Trial]) -> Filler:
        """Choose the smoothness by hidden gaps; bones are the pairs that keep their distance."""

        def fit(smooth: float, trials: Sequence[Trial]) -> Filler:
            return PointOptimiser(smooth, bones(trials))

        return tune([4.0, 16.0], training, fit)


def peers() -> list[Method]:
    """The filter."""
    return [Anipose3D()]
