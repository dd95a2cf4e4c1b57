"""What a correction by hand shows of its neighbours: whoever digitised a frame wrong did so before and after, too."""

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.cameras.triangulate import linear, residual_px
from mocap.cleaning.click_noise import SHRINK
from mocap.filters.models.constant_velocity import fastest_hz
from mocap.filters.whittaker import smooth_series

ERROR = 5.0
"""Rays miss each other if they do so by more standard deviations (``mocap.cameras.triangulate.robust``)."""


def hand_sd(matrices: Array, hand_px: Array, *, usual_px: float) -> tuple[float, NDArray[np.bool_]]:
    """Standard deviation of a coordinate of a person's clicks, and (...) points at which these contradict each other.

    The mean square of what is left of clicks that meet, with ``SHRINK`` more errors of the usual deviation: a person's
    clicks are few.

    Args:
        matrices: (C, 3, 4) projections.
        hand_px: (C, ..., 2) ideal pixels of the clicks; NaN elsewhere.
        usual_px: Deviation of the recording's own.
    """
    free = np.maximum(2 * np.isfinite(hand_px[..., 0]).sum(axis=0) - 3, 0)
    missed = np.nan_to_num(residual_px(matrices, hand_px, linear(matrices, hand_px)))
    met = (free > 0) & (missed <= ERROR * usual_px)
    squares = SHRINK * usual_px**2 + np.sum((free * missed**2)[met])
    sd = float(np.sqrt(squares / (SHRINK + free[met].sum())))
    return sd, missed > ERROR * max(sd, usual_px)


def carried(
    uv_px: Array, sd_px: Array, hand_px: Array, *, hand_sd_px: float, left: float, dt_s: float
) -> tuple[Array, Array, Array]:
    """Errors that rays are expected to have by the corrections beside them.

    A correction shows the error e of its camera and marker: of the path of the rays around it, without the one that was
    there, for an error of one frame says nothing of others. Of |e|^2 what both the click and the path err by is taken
    off, down to 0, which leaves rays that were right where they are. Each error lasts from frame to
    frame with the probability ``left``: in another frame it is that of a correction with the probability w, and with
    the rest of it none, so that it has the mean sum w e and in each coordinate the variance
    (sum w |e|^2 - |sum w e|^2) / 2. With rho = left^(frames apart), w = R^-1 rho, R the same between corrections: of a
    frame between two corrections both have a share, on either side of all the nearest one alone.

    Args:
        uv_px: (C, T, M, 2) rays without corrections; NaN where not seen.
        sd_px: (C, T, M) deviation of a coordinate of each.
        hand_px: (C, T, M, 2) where a person placed markers; NaN elsewhere.
        hand_sd_px: Deviation of that.
        left: Share of an error that is left a frame later (``mocap.cleaning.persistence.share_left``).
        dt_s: Time step.

    Returns:
        (C, T, M, 2) errors, (C, T, M) the variance of a coordinate, and (C, T, M) how probable it is that an error is
        that of a correction (sum w).
    """
    mean, every = np.zeros_like(uv_px), np.arange(uv_px.shape[1])
    variance, share = np.zeros(uv_px.shape[:3]), np.zeros(uv_px.shape[:3])
    seen = np.pad(np.isfinite(uv_px[..., 0]), ((0, 0), (1, 1), (0, 0)))
    near = seen[:, 1:-1] | (seen[:, 2:] & seen[:, :-2])  # elsewhere the path is a guess
    shows = np.isfinite(hand_px[..., 0]) & near & (seen.sum(axis=1, keepdims=True) > 2)
    for c, m in np.argwhere(shows.any(axis=1)):
        at = np.flatnonzero(shows[c, :, m])
        path, noise = _paths(uv_px[c, :, m], sd_px[c, :, m], at, dt_s)
        e = path - hand_px[c, at, m]
        size = np.maximum(np.sum(e**2, axis=1), 1e-12)
        e = e * np.maximum(1 - (2 * hand_sd_px**2 + noise) / size, 0.0)[:, None]
        between = left ** np.abs(at[:, None] - at)
        w = np.linalg.solve(between, left ** np.abs(at[:, None] - every)).T
        mean[c, :, m], share[c, :, m] = w @ e, w.sum(axis=1)
        variance[c, :, m] = np.maximum(w @ np.sum(e**2, axis=1) - np.sum(mean[c, :, m] ** 2, axis=1), 0.0) / 2
    return mean, variance, share


def _paths(uv_px: Array, sd_px: Array, at: NDArray[np.int64], dt_s: float) -> tuple[Array, Array]:
    """(n, 2) where the others of a track's (T, 2) rays have it in n frames, and (n,) squares of what they err by.

    Motion that is faster than a motion model's is noise. Without a sample y the smoothed series x is
    (x - h y) / (1 - h), h its share of itself; squares are those of samples about the same, by their median.
    """
    seen = np.isfinite(uv_px[:, 0])
    weight = np.where(seen, (np.min(sd_px[seen]) / sd_px) ** 2, 0.0)
    alone = np.zeros((len(uv_px), len(at)))
    alone[at, np.arange(len(at))] = 1.0
    smooth = smooth_series(np.hstack([uv_px, alone]), weight, dt_s=dt_s, cutoff_hz=fastest_hz(dt_s))
    own = smooth[at, 2 + np.arange(len(at))]
    path = (smooth[at, :2] - own[:, None] * np.nan_to_num(uv_px[at])) / (1 - own)[:, None]
    usual = np.median(np.sum((uv_px - smooth[:, :2])[seen] ** 2, axis=1)) / np.log(2)
    return path, usual / (1 - own) ** 2
