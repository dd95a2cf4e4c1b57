"""Ways from a network's clicks to points: what people do without this program, and what it does."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.ndimage import median_filter
from scipy.signal import butter, sosfiltfilt

from benchmarks.arena.flights import FPS, PAIRS, Flight
from eal.arrays import Array
from mocap.cameras.triangulate import linear, residual_px
from mocap.cleaning.cleaned import cleaned
from mocap.cleaning.swaps import Swap
from mocap.report.job import run_job

LEAST = 0.475
"""Clicks of lower likelihood are left out, as the authors of the flights do."""
CUTOFF_HZ = 45.0
"""Of the Butterworth filter, as theirs."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Outcome:
    """What a method makes of a flight.

    Attributes:
        xyz_m: (T, M, 3) points; NaN where it gives none.
        cov_m2: (T, M, 3, 3) covariance; None: the method states none.
        swaps: Runs of frames in which it exchanged names.
    """

    xyz_m: Array
    cov_m2: Array | None = None
    swaps: tuple[Swap, ...] = ()


def believed(flight: Flight) -> Array:
    """(C, T, M, 2) ideal pixels of clicks with a likelihood of at least ``LEAST``."""
    return np.where((flight.likelihood < LEAST)[..., None], np.nan, flight.recording.ideal_px)


def triangulation(flight: Flight) -> Outcome:
    """Linear triangulation of the believed clicks, nothing else."""
    return Outcome(xyz_m=linear(flight.recording.matrices, believed(flight)))


def as_counted(flight: Flight) -> Outcome:
    """The same with pixels as DeepLabCut counts them, from 0, where the calibration counts from 1."""
    return Outcome(xyz_m=linear(flight.recording.matrices, believed(flight) - 1.0))


def butterworth(flight: Flight) -> Outcome:
    """Triangulation, small gaps interpolated, and a zero-lag Butterworth filter of order 4."""
    return Outcome(xyz_m=low_pass(triangulation(flight).xyz_m))


def low_pass(xyz_m: Array) -> Array:
    """A zero-lag low pass of each marker between its first and last sighting, over gaps filled linearly."""
    sos = butter(2, CUTOFF_HZ, fs=FPS, output="sos")
    out = np.full_like(xyz_m, np.nan)
    for marker in range(xyz_m.shape[1]):
        frames = np.flatnonzero(np.isfinite(xyz_m[:, marker, 0]))
        if len(frames) < 15:
            out[frames, marker] = xyz_m[frames, marker]
            continue
        inside = np.arange(frames[0], frames[-1] + 1)
        filled = np.stack([np.interp(inside, frames, xyz_m[frames, marker, k]) for k in range(3)], axis=1)
        out[inside, marker] = sosfiltfilt(sos, filled, axis=0)
    return out


def authors(flight: Flight, *, penalty_px: float = 2.0) -> Outcome:
    """Swap repair and filters after the description of the authors of the flights (written anew).

    In every frame each camera gives to one point of a pair its left click, its right one or none; the assignment with
    the smallest residual, ``penalty_px`` more where a camera gives none, is the side of which more likelihood is in it;
    the other point is the best assignment of clicks that are left. Points are kept where neither speed, residual nor
    likelihood is bad and two of the three are good; then outliers from a running median go, and a low pass follows.
    """
    uv, likelihood = believed(flight), np.where(flight.likelihood < LEAST, np.nan, flight.likelihood)
    matrices = flight.recording.matrices
    xyz = linear(matrices, uv)
    residual, sure = residual_px(matrices, uv, xyz), _mean(likelihood)
    for left, right in PAIRS:
        for marker, (x, r, s) in zip(
            (left, right), _assigned(matrices, uv, likelihood, left, right, penalty_px), strict=True
        ):
            xyz[:, marker], residual[:, marker], sure[:, marker] = x, r, s
    speed = np.full(residual.shape, np.nan)
    speed[1:] = np.linalg.norm(np.diff(xyz, axis=0), axis=-1) * FPS
    usual = np.nanquantile(speed, 0.75, axis=0)
    good = [speed < 3 * usual, residual < 4, sure > 0.55]
    kept = (np.sum(good, axis=0) >= 2) & ~(speed > 9 * usual) & ~(residual > 16) & ~(sure < 0.525)
    xyz = np.where(kept[..., None], xyz, np.nan)
    for marker in range(xyz.shape[1]):
        frames = np.flatnonzero(np.isfinite(xyz[:, marker, 0]))
        path = xyz[frames, marker]
        off = np.abs(path - median_filter(path, size=(9, 1)))
        bad = (off > 3 * 1.4826 * np.maximum(median_filter(off, size=(9, 1)), 1e-5)).any(axis=1)
        xyz[frames[bad], marker] = np.nan
    return Outcome(xyz_m=low_pass(xyz))


def _mean(likelihood: Array) -> Array:
    seen = np.isfinite(likelihood).sum(axis=0)
    return np.where(seen > 0, np.nansum(likelihood, axis=0) / np.maximum(seen, 1), np.nan)


def _assigned(
    matrices: Array, uv: Array, likelihood: Array, left: int, right: int, penalty_px: float
) -> list[tuple[Array, Array, Array]]:
    """Points, residuals and likelihoods of the left and the right one of a pair, (T, 3), (T,) and (T,) each."""
    ways = np.array([way for way in product((0, 1, 2), repeat=len(uv)) if np.count_nonzero(way) >= 2])
    clicks = np.stack([np.full_like(uv[:, :, left], np.nan), uv[:, :, left], uv[:, :, right]])
    chance = np.stack([np.full_like(likelihood[:, :, left], np.nan), likelihood[:, :, left], likelihood[:, :, right]])
    camera = np.arange(len(uv))
    points, misses, weight, sums = [], [], [], []
    for way in ways:
        pixels, p = clicks[way, camera], chance[way, camera]
        points.append(linear(matrices, pixels))
        all_used = np.isfinite(pixels[..., 0]).all(axis=0)
        misses.append(residual_px(matrices, pixels, points[-1]) + np.where(all_used, 0.0, penalty_px))
        weight.append(_mean(p))
        side = [np.nansum(np.where((way == k)[:, None], p, 0.0), axis=0) for k in (1, 2)]
        sums.append(
            np.where(side[0] == side[1], np.where((way == 1).sum() >= 2, 1, 2), np.where(side[0] > side[1], 1, 2))
        )
    points, misses, weight, sums = (np.stack(v) for v in (points, misses, weight, sums))
    n_frames = points.shape[1]
    unknown = np.full(n_frames, np.nan)
    out = [(np.full((n_frames, 3), np.nan), unknown.copy(), unknown.copy()) for _ in (1, 2)]
    for frame in range(n_frames):
        free = np.isfinite(misses[:, frame])
        for _ in (1, 2):
            if not free.any():
                break
            best = int(np.argmin(np.where(free, misses[:, frame], np.inf)))
            side = int(sums[best, frame]) - 1
            out[side][0][frame], out[side][1][frame], out[side][2][frame] = (
                points[best, frame], misses[best, frame], weight[best, frame],
            )  # fmt: skip
            shared = (ways == ways[best]) & (ways[best] > 0)
            free = free & ~shared.any(axis=1) & (sums[:, frame] - 1 != side)
    return out


def ours(flight: Flight) -> Outcome:
    """This program: ``mocap track`` on the network's files."""
    run, prepared = run_job(flight.recording, validated=False)
    return Outcome(xyz_m=run.xyz_m, cov_m2=run.cov_m2, swaps=cleaned(prepared).swaps)


def one_person(flight: Flight) -> Outcome:
    """The points of the first person, to be compared with the second."""
    return Outcome(xyz_m=flight.people_m[0])


def one_person_tracked(flight: Flight) -> Outcome:
    """This program on the first person's project."""
    run, prepared = run_job(replace(flight.people[0]), validated=False)
    row = np.rint(prepared.t_s * FPS).astype(np.int64)
    shape = flight.truth_m.shape
    xyz, cov = np.full(shape, np.nan), np.full((*shape, 3), np.nan)
    xyz[row], cov[row] = run.xyz_m, run.cov_m2
    return Outcome(xyz_m=xyz, cov_m2=cov)


METHODS: dict[str, Callable[[Flight], Outcome]] = {
    "plain triangulation": triangulation,
    "the same, pixels from 0": as_counted,
    "Butterworth": butterworth,
    "authors' repair and filters": authors,
    "this program": ours,
}
