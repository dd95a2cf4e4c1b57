"""How smooth markers move: rate, size and noise of ``motion.smooth_acceleration``, by the likelihood of a recording."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mocap.filters.motion.smooth_acceleration import smooth_step, stationary
from numpy.typing import NDArray

from eal.arrays import Array, varying

MOST_FRAMES = 600
"""Of longer recordings so many frames in the middle tell rate, noise and densities. Chosen; not measured."""
FAR = 3.0
"""Positions and velocities that are free begin within so many of the deviations that the recording shows."""
RATES, WINDOWS = 8, 12
"""How many rates and windows are looked at first, from the shortest that frames show to the recording's length."""
VAGUE = 1e9
"""No derivative is believed to vary by more than the root of so many deviations of the noise a frame: beyond it nothing
is left of a covariance in double precision."""
INTENSITIES = 2.0 ** np.arange(-2, 3)
"""Multiples of a marker's density that are looked at in each frame. To 16 times either way, a body that bobs in one
direction and glides in the others is stated too certain across gaps (docs/experiments/single_points.md)."""
TURN, WHILE = 0.7, 5.0
"""The logarithm of a marker's density wanders by so much in so many windows (``likeliest``). Chosen; with 1 in place of
0.7 errors of accelerations change by -3 to 2 %."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Smoothness:
    """What a recording is likeliest under, of one order.

    Attributes:
        order: Number n of states of a coordinate.
        free: How many of them, from the position on, are drawn to no mean.
        rate_hz: At which the others forget themselves, 1/s.
        density: (M,) of the white noise that drives a coordinate of each marker, m^2 / s^(2n - 1).
        intensity: (T, M) by which it is multiplied in the step that leads to each frame.
        window_s: (M,) over which each marker is averaged, about.
        noise: By this factor the stated deviations of the noise are wrong.
        log_likelihood: Of all markers together.
    """

    order: int
    free: int
    rate_hz: float
    density: Array
    intensity: Array
    window_s: Array
    noise: float
    log_likelihood: float


def likeliest(xyz_m: Array, sd_m: Array, dt_s: float, *, order: int, free: int) -> Smoothness:
    """Rate and noise of all markers together, density of each: those under which the recording is likeliest.

    Densities are looked for as the window over which the smoother averages, in frames, w = (q / r)^(-1 / (2n - 1)) for
    the variance r of the noise: how finely does then not depend on the order. The factor on the noise is the one of
    highest likelihood, in closed form. A coarse grid, then three finer ones about the best.

    Animals rest, turn and strike: that density is a mean. Where a marker is driven more strongly and where less is told
    by filters of ``INTENSITIES`` side by side, whose likelihoods are weighted as those of a hidden Markov chain
    (Rabiner 1989) that wanders between neighbours.

    Args:
        xyz_m: (T, M, 3) markers; NaN where not seen; each is seen in some frames.
        sd_m: (T, M) stated deviation of the noise of a coordinate.
        dt_s: Time step.
        order: n.
        free: d.
    """
    axes, usual = varying(xyz_m), np.nanmedian(sd_m, axis=0)
    y = (xyz_m - np.nanmean(xyz_m, axis=0))[..., axes] / usual[:, None]
    r = (np.where(np.isfinite(sd_m), sd_m, usual) / usual) ** 2
    middle = max(0, (len(xyz_m) - MOST_FRAMES) // 2)
    part = slice(middle, middle + MOST_FRAMES)
    n_frames, n_markers = r[part].shape
    steps = np.diff(y, axis=0) ** 2  # none of markers that are seen in single frames: as far as they are apart
    place = float(np.nanmean(y**2))
    wide = FAR**2 * place, FAR**2 * (float(np.nanmean(steps)) if np.isfinite(steps).any() else place)
    known = np.isfinite(y[..., 0])
    count = y.shape[-1] * known[part].sum(axis=0)
    rates = np.geomspace(1 / n_frames, 0.7, RATES) if free < order else np.zeros(1)
    windows = np.repeat(np.geomspace(0.7, n_frames, WINDOWS)[:, None], n_markers, axis=1)
    finer, near = np.log(n_frames) / np.array([RATES - 1, WINDOWS - 1]), np.arange(-2, 3)
    rate, window, noise = 1.0, windows[0], 1.0
    for _ in range(4):
        sums = np.zeros((2, len(rates), *windows.shape))

        def add(_frame: int, log: Array, square: Array, sums: Array = sums) -> None:
            sums[0] += log
            sums[1] += square

        _filtered(y[part], r[part], rates, windows, (order, free), wide, add)
        factor = np.ones(len(rates))  # common to all: the best window of each marker is looked for under it
        for _ in range(4):
            at = (sums[0] + sums[1] / factor[:, None, None] ** 2).argmin(axis=1)[:, None]
            log, square = (np.take_along_axis(one, at, axis=1).sum(axis=(1, 2)) for one in sums)
            factor = np.sqrt(np.maximum(square / count.sum(), 1e-8))
        one = int(np.argmin(log + square / factor**2 + count.sum() * np.log(factor**2)))
        rate, window, noise = float(rates[one]), windows[at[one, 0], np.arange(n_markers)], float(factor[one])
        finer = 0.4 * finer
        rates = np.unique(np.clip(rate * np.exp(finer[0] * near), 1 / n_frames, 1.5)) if free < order else rates
        windows = window * np.exp(finer[1] * near[:, None])
    levels = window * INTENSITIES[:, None] ** (1 / (1 - 2 * order))
    found = np.zeros((len(y), *levels.shape))

    def keep(frame: int, log: Array, square: Array) -> None:
        found[frame] = -0.5 * (log + square / noise**2)[0]

    _filtered(y, r, np.array([rate]), levels, (order, free), wide, keep)
    intensity, evidence = _wandering(found, TURN**2 / (WHILE * window))
    scale = -float(np.sum(y.shape[-1] * known * np.log(noise * usual)))  # of positions in metres
    return Smoothness(
        order=order,
        free=free,
        rate_hz=rate / dt_s,
        density=(noise * usual) ** 2 * window ** (1.0 - 2 * order) / dt_s ** (2 * order - 1),
        intensity=intensity,
        window_s=window * dt_s,
        noise=noise,
        log_likelihood=float(evidence.sum()) + scale,
    )


def _filtered(
    y: Array,
    r: Array,
    rates: Array,
    windows: Array,
    kind: tuple[int, int],
    wide: tuple[float, float],
    take: Callable[[int, Array, Array], None],
) -> None:
    """Filter forward, with the step for a unit of time, under all rates (R,) and windows (W, M) at once.

    Args:
        y: (T, M, A) positions, in units of each marker's noise.
        r: (T, M) variance of the noise.
        rates: A step.
        windows: Frames.
        kind: n, d.
        wide: Variances of position and velocity at the start, where they are free.
        take: Called with each frame, and (R, W, M) A log S and v^2 / S, summed over coordinates, for the innovation v
            and its variance S; where nothing is seen both are 0.
    """
    (n_frames, n_markers, axes), (n, free) = y.shape, kind
    q = windows ** (1.0 - 2 * n)
    models = [smooth_step(n, free, float(rate), 1.0) for rate in rates]
    chain = np.array([one for one, _ in models])
    both = np.einsum("rab,rcd->rbdac", chain, chain).reshape(-1, 1, n * n, n * n)
    noise = np.array([one for _, one in models]).reshape(-1, 1, 1, n * n) * q[..., None]  # (R, W, M, n n)
    cov = np.zeros((len(rates), *q.shape, n, n))
    for k in range(free):
        cov[..., k, k] = wide[min(k, 1)] * (10 / n_frames) ** (2 * max(k - 1, 0))
    if free < n:
        lasting = np.array([stationary(n, free, float(rate)) for rate in rates])
        cov[..., free:, free:] = lasting[:, None, None] * q[..., None, None]
    vague = np.einsum("rwmaa->rwma", cov[..., free:, free:]).max(axis=-1, initial=0.0) > VAGUE
    cov = np.where(vague[..., None, None], 0.0, cov).reshape(noise.shape)
    mean = np.zeros((len(rates), len(q), n_markers, axes, n))
    turned = chain[:, None].swapaxes(2, 3)
    known = np.asarray(np.isfinite(y).all(axis=2))
    r = np.where(known, r, np.inf)
    for frame in range(n_frames):
        there = known[frame]
        spread = cov[..., 0] + r[frame]
        away = np.where(there[:, None], y[frame] - mean[..., 0], 0.0)
        lost = ~(spread >= 0.99 * r[frame])  # of a variance below the noise's own no digit is left
        spread[lost] = np.inf
        vague |= lost
        log = axes * np.log(np.where(there & ~vague, spread, 1.0))
        take(frame, np.where(vague, 1e6, log), np.sum(away**2, axis=-1) / spread)
        gain = cov[..., :n] / spread[..., None]
        mean = mean + gain[..., None, :] * away[..., None]
        mean = (mean.reshape(len(rates), 1, -1, n) @ turned).reshape(mean.shape)
        left = cov - (gain[..., None] * cov[..., None, :n]).reshape(cov.shape)
        cov = (left.reshape(len(rates), 1, -1, n * n) @ both).reshape(cov.shape) + noise


def _wandering(logs: Array, turn: Array) -> tuple[Array, Array]:
    """(T, M) geometric mean of the intensity in each frame, over its posterior, and (M,) log evidence.

    Args:
        logs: (T, K, M) log likelihood of each frame under each of ``INTENSITIES``.
        turn: (M,) variance of a step of the logarithm.
    """
    logs = np.moveaxis(logs, 1, 2)
    n_frames, _, count = logs.shape
    height = np.log(INTENSITIES)
    step = np.minimum(turn / (height[1] - height[0]) ** 2, 2 / 3)[:, None, None]
    move = np.eye(count) + 0.5 * step * (np.eye(count, k=1) + np.eye(count, k=-1) - 2 * np.eye(count))
    move += np.eye(count) * (1 - move.sum(axis=2, keepdims=True))
    share = np.repeat(np.exp(-0.5 * (height / TURN) ** 2)[None], len(turn), axis=0)
    share /= share.sum(axis=1, keepdims=True)
    before, after, evidence = np.zeros(logs.shape), np.zeros(logs.shape), np.zeros(len(turn))
    for frame in range(n_frames):
        before[frame] = share
        most = logs[frame].max(axis=1, keepdims=True)
        share = share * np.exp(logs[frame] - most)
        total = share.sum(axis=1, keepdims=True)
        evidence += (np.log(total) + most)[:, 0]
        after[frame] = share = share / total
        share = np.einsum("mk,mkl->ml", share, move)
    for frame in range(n_frames - 2, -1, -1):
        after[frame] *= np.einsum("mkl,ml->mk", move, after[frame + 1] / np.maximum(before[frame + 1], 1e-300))
        after[frame] /= after[frame].sum(axis=1, keepdims=True)
    return np.exp(after @ height), evidence


def seen_enough(xyz_m: Array, least: int = 10) -> NDArray[np.int64]:
    """Markers that are seen in so many frames at least."""
    return np.flatnonzero(np.isfinite(xyz_m[..., 0]).sum(axis=0) >= least)
