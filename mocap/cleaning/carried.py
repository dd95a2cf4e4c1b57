"""What a correction by hand shows of its neighbours: whoever digitised a frame wrong did so before and after, too."""

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.cameras.triangulate import linear, residual_px
from mocap.cleaning.click_noise import SHRINK

ERROR = 5.0
"""Rays miss each other if they do so by more standard deviations (``mocap.cameras.triangulate.robust``)."""


def hand_sd(matrices: Array, hand_px: Array, *, usual_px: float) -> tuple[float, NDArray[np.bool_]]:
    """Standard deviation of a coordinate of a person's clicks, and (T, M) points at which these contradict each other.

    The mean square of what is left of clicks that meet, with ``SHRINK`` more errors of the usual deviation: a person's
    clicks are few.

    Args:
        matrices: (C, 3, 4) projections.
        hand_px: (C, T, M, 2) ideal pixels of the clicks; NaN elsewhere.
        usual_px: Deviation of the recording's own.
    """
    free = np.maximum(2 * np.isfinite(hand_px[..., 0]).sum(axis=0) - 3, 0)
    missed = np.nan_to_num(residual_px(matrices, hand_px, linear(matrices, hand_px)))
    met = (free > 0) & (missed <= ERROR * usual_px)
    squares = SHRINK * usual_px**2 + np.sum((free * missed**2)[met])
    sd = float(np.sqrt(squares / (SHRINK + free[met].sum())))
    return sd, missed > ERROR * max(sd, usual_px)


def carried(
    uv_px: Array, sd_px: Array, hand_px: Array, *, hand_sd_px: float, left: float
) -> tuple[Array, Array, Array]:
    """Errors that rays are expected to have by the corrections beside them.

    A correction shows the error e of its camera and marker: of the ray that was there, or of the mean of both its
    neighbours, whichever is smaller, for an error of one frame says nothing of others. Of e^2 the variance of both
    clicks is taken off, down to 0, which leaves rays that were right where they are. Each error lasts from frame to
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

    Returns:
        (C, T, M, 2) errors, (C, T, M) the variance of a coordinate, and (C, T, M) how probable it is that an error is
        that of a correction (sum w).
    """
    mean, every = np.zeros_like(uv_px), np.arange(uv_px.shape[1])
    variance, share = np.zeros(uv_px.shape[:3]), np.zeros(uv_px.shape[:3])
    beside = np.full_like(uv_px, np.nan)
    beside[:, 1:-1] = (uv_px[:, 2:] + uv_px[:, :-2]) / 2
    shown = np.stack([uv_px - hand_px, beside - hand_px])
    size = np.sum(shown**2, axis=-1)
    least = np.fmin(*size)
    error = np.where((size[0] == least)[..., None], *shown)
    for c, m in np.argwhere(np.isfinite(least).any(axis=1)):
        at = np.flatnonzero(np.isfinite(least[c, :, m]))
        clicks = hand_sd_px**2 + np.nan_to_num(sd_px[c, at, m] ** 2)
        e = error[c, at, m] * np.maximum(1 - 2 * clicks / np.maximum(least[c, at, m], 1e-12), 0.0)[:, None]
        between = left ** np.abs(at[:, None] - at)
        w = np.linalg.solve(between, left ** np.abs(at[:, None] - every)).T
        mean[c, :, m], share[c, :, m] = w @ e, w.sum(axis=1)
        variance[c, :, m] = np.maximum(w @ np.sum(e**2, axis=1) - np.sum(mean[c, :, m] ** 2, axis=1), 0.0) / 2
    return mean, variance, share
