"""Missing markers by regression on the others, in the same frame and in frames before and after: delayed poses.

The conditional mean of a Gaussian over poses stacked with delayed and advanced copies of themselves: the standard
imputation of missing markers by the covariance of all (Liu & McMillan 2006; Tits, Tilmanne & Dutoit 2018), with delays
as in singular spectrum analysis. It knows nothing of dynamics or of the gap's edges, and so errs differently from the
motion models, which makes a mixture of both better than either (``design/mixture.py``).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from filters.hidden import unseen_runs
from filters.poses import MarkerTrial, PoseTrial, Shapes, certain_shapes
from mocap.arrays import Array
from mocap.body import smooth_series

EDGE = np.array((0, 1, 2, 3, 5, 8))
"""Frames on each side of a gap, counted from its edge, in which the regression is compared with what was measured."""


@dataclass(frozen=True, kw_only=True)
class DelaySettings:
    """Choices of the regression; its poses are those of the pose models.

    Attributes:
        ranks: As in ``PoseSettings``, of the subspace that completes poses.
        body_hz: As there.
        turns: As there.
        lags: Delays, in units of the time in which the motion turns by a radian, sd(z) / sd(zdot); 0 is one of them.
        memory: How long what the regression misses by at the edges is carried into a gap, in the same unit.
        cutoff: Faster motion in a gap is taken for noise, in radians a unit of the same time.
        ridge: Added to the variances, as a share of their mean.
        certain: Poses known better than this are learned from.
    """

    ranks: tuple[int, ...]
    body_hz: float = 3.0
    turns: bool = True
    lags: tuple[float, ...] = (-1.2, -0.4, 0.0, 0.4, 1.2)
    memory: float = 1.0
    cutoff: float = 4.0
    ridge: float = 0.1
    certain: float = 0.8


@dataclass(frozen=True, eq=False)
class Gap:
    """Frames in which a marker is not seen.

    Attributes:
        marker: Which.
        inside: (n,) its frames.
        edges: (e,) frames near it in which the marker is seen.
        others: (M,) True for markers that are seen in at least half of it: what the regression may look at.
    """

    marker: int
    inside: NDArray[np.int64]
    edges: NDArray[np.int64]
    others: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Filled:
    """The gaps of a trial.

    Attributes:
        xyz_m: (T, M, 3) positions in the world; NaN where the trial has a measurement.
        cov_m2: (T, M, 3, 3) their covariances.
    """

    xyz_m: Array
    cov_m2: Array


def fill_delayed(trial: MarkerTrial, trials: Sequence[PoseTrial], shapes: Shapes, settings: DelaySettings) -> Filled:
    """Fill the gaps of a trial.

    Args:
        trial: The trial.
        trials: Poses of all trials; the last is this one.
        shapes: Their shapes.
        settings: Choices.
    """
    seen, frames = trial.seen, trials[-1].frames
    tau = _radian(shapes) / trial.dt_s
    lags = np.unique(np.round(np.array(settings.lags) * tau).astype(int))
    whole = completed(trials, shapes)
    noise = float(np.nanmedian(trial.sd_m)) ** 2 if seen.any() else 0.0
    mean, cov = _gaussian(whole, certain_shapes(shapes, settings.certain), lags, settings.ridge, noise)
    track = whole[-1].reshape(*seen.shape, 3)
    y, spread = np.full(track.shape, np.nan), np.full((*track.shape, 3), np.nan)
    stacked = delayed(whole[-1], lags)
    gaps = list(gaps_of(seen))
    for others in np.unique([gap.others for gap in gaps], axis=0) if gaps else []:
        alike = [gap for gap in gaps if (gap.others == others).all()]
        rows = np.unique(np.concatenate([np.r_[gap.inside, gap.edges] for gap in alike]))
        wanted = np.unique([gap.marker for gap in alike])
        said, left = regression(stacked[rows], others, wanted, lags, mean, cov)
        for gap in alike:
            m, column = gap.marker, int(np.searchsorted(wanted, gap.marker))
            inside, edges = np.searchsorted(rows, gap.inside), np.searchsorted(rows, gap.edges)
            miss = track[gap.edges, m] - said[edges, column]
            variance = max(float(np.sum(miss**2)) / max(miss.size, 1), float(np.mean(left[..., 0, 0])))
            ratio = noise / variance + 1e-9
            shift, share = carried(gap.edges, miss, gap.inside, memory=settings.memory * tau, noise=ratio)
            y[gap.inside, m] = said[inside, column] + shift
            y[gap.inside, m] = _smoothed(
                np.where(seen[:, m, None], track[:, m], y[:, m]), seen[:, m], gap.inside, settings.cutoff / tau
            )
            spread[gap.inside, m] = share[:, None, None] * left[inside, column]
    rotation = frames.rotation[:, None]
    xyz = np.einsum("tij,tmj->tmi", frames.rotation, y) + frames.position_m[:, None]
    return Filled(xyz, rotation @ spread @ np.swapaxes(rotation, -1, -2))


def gaps_of(seen: NDArray[np.bool_]) -> Iterator[Gap]:
    """All gaps of (T, M) sightings, those at the ends of the trial included."""
    for marker, start, stop in unseen_runs(seen):
        near = np.concatenate([start - 1 - EDGE[::-1], stop + EDGE])
        near = near[(near >= 0) & (near < len(seen))]
        others = seen[start:stop].mean(axis=0) >= 0.5
        yield Gap(marker, np.arange(start, stop), near[seen[near, marker]], others)


def completed(trials: Sequence[PoseTrial], shapes: Shapes) -> list[Array]:
    """(T, 3M) poses of each trial, as the subspace has them where a marker is not seen."""
    subspace = shapes.subspace
    return [
        np.where(np.isfinite(trial.y), trial.y, subspace.mean + offset + z @ subspace.basis.T)
        for trial, z, offset in zip(trials, shapes.z, shapes.offset, strict=True)
    ]


def delayed(y: Array, lags: NDArray[np.int64]) -> Array:
    """(T, L, D) rows [y(t + lag) for every lag] of (T, D) poses; NaN beyond the ends."""
    out = np.full((len(y), len(lags), y.shape[1]), np.nan)
    for k, lag in enumerate(lags):
        low, high = max(0, -lag), min(len(y), len(y) - lag)
        if high > low:
            out[low:high, k] = y[low + lag : high + lag]
    return out


def carried(
    edges: NDArray[np.int64], miss: Array, inside: NDArray[np.int64], *, memory: float, noise: float
) -> tuple[Array, Array]:
    """What is missed by at the edges, inside the gap: a Matern-3/2 process in time (Rasmussen & Williams 2006, 4.17).

    Args:
        edges: (e,) frames.
        miss: (e, 3) measurement less regression there.
        inside: (n,) frames of the gap.
        memory: Correlation time in frames.
        noise: Variance of a measurement over that of what is missed.

    Returns:
        (n, 3) posterior mean and (n,) share of variance that is left.
    """
    if not len(edges):
        return np.zeros((len(inside), 3)), np.ones(len(inside))

    def kernel(a: NDArray[np.int64], b: NDArray[np.int64]) -> Array:
        scaled = np.sqrt(3) * np.abs(a[:, None] - b) / memory
        return (1 + scaled) * np.exp(-scaled)

    cross = kernel(inside, edges)
    weights = np.linalg.solve(kernel(edges, edges) + noise * np.eye(len(edges)), cross.T).T
    return weights @ miss, np.clip(1 - np.sum(weights * cross, axis=1), 1e-6, 1.0)


def _smoothed(track: Array, seen: NDArray[np.bool_], inside: NDArray[np.int64], cutoff: float) -> Array:
    """(n, 3) a gap of a track (T, 3), smoothed with the measured samples near it held; cutoff in radians a frame."""
    near = np.arange(max(0, inside[0] - 10), min(len(track), inside[-1] + 11))
    here = (near >= inside[0]) & (near <= inside[-1])
    weight = np.where(seen[near], 1e4, here * 1.0)
    return smooth_series(track[near], weight, dt_s=1.0, cutoff_hz=cutoff / (2 * np.pi))[here]


def _radian(shapes: Shapes) -> float:
    """Time in seconds in which the motion turns by a radian."""
    z, rate = np.concatenate(shapes.z), np.concatenate(shapes.rate)
    return float(np.sqrt(z.var(axis=0).sum() / max(rate.var(axis=0).sum(), 1e-300)))


def _gaussian(
    whole: Sequence[Array], certain: Sequence[NDArray[np.bool_]], lags: NDArray[np.int64], ridge: float, noise: float
) -> tuple[Array, Array]:
    """Mean (L, D) and covariance (L, D, L, D) of delayed poses."""
    rows = np.concatenate([delayed(y, lags)[keep] for y, keep in zip(whole, certain, strict=True)])
    rows = rows[np.isfinite(rows).all(axis=(1, 2))]
    shape = rows.shape[1:]
    if len(rows) < 2:
        poses = np.concatenate(whole)
        rows = np.repeat(poses[:, None], len(lags), axis=1)
    flat = rows.reshape(len(rows), -1)
    mean = flat.mean(axis=0)
    cov = (flat - mean).T @ (flat - mean) / len(flat)
    cov += (ridge * np.trace(cov) / len(cov) + noise + 1e-14) * np.eye(len(cov))
    return mean.reshape(shape), cov.reshape(*shape, *shape)


def regression(
    rows: Array, others: NDArray[np.bool_], wanted: NDArray[np.int64], lags: NDArray[np.int64], mean: Array, cov: Array
) -> tuple[Array, Array]:
    """Wanted markers from the others.

    Args:
        rows: (n, L, D) delayed poses; NaN beyond the ends of the trial.
        others: (M,) markers to look at.
        wanted: (k,) markers that are asked for.
        lags: (L,) delays.
        mean: Of delayed poses.
        cov: Of delayed poses.

    Returns:
        (n, k, 3) positions and (n, k, 3, 3) covariances.
    """
    now, size = int(np.searchsorted(lags, 0)), rows.shape[2]
    flat, centre, square = rows.reshape(len(rows), -1), mean.ravel(), cov.reshape(mean.size, mean.size)
    asked = now * size + (3 * wanted[:, None] + np.arange(3)).ravel()
    said, left = np.empty((len(rows), len(wanted), 3)), np.empty((len(rows), len(wanted), 3, 3))
    inside = np.isfinite(rows[:, :, 0])
    for pattern in np.unique(inside, axis=0):
        here = (inside == pattern).all(axis=1)
        look = np.flatnonzero((pattern[:, None] & np.repeat(others, 3)).ravel())
        cross = square[np.ix_(look, asked)]
        weights = np.linalg.solve(square[np.ix_(look, look)], cross)
        said[here] = (centre[asked] + (flat[np.ix_(here, look)] - centre[look]) @ weights).reshape(-1, len(wanted), 3)
        rest = (square[np.ix_(asked, asked)] - cross.T @ weights).reshape(len(wanted), 3, len(wanted), 3)
        left[here] = np.moveaxis(np.diagonal(rest, axis1=0, axis2=2), -1, 0)
    return said, left
