"""Errors of clicks that last: what no filter averages out over frames.

A person or a network that clicks a landmark too far to the left does so again in the next frame, and lenses and
calibrations err alike for as long as a marker is in one place. Such errors show as residuals of triangulation that
resemble those of the frames before.
"""

import numpy as np

from eal.arrays import Array
from mocap.cameras.linearised import fit, linearise

LAG = 3
"""Frames between residuals that are compared: errors that last longer do not average out over the frames that a filter
smooths over."""
UNSEEN = 2.0
"""Variance of lasting errors that all cameras of a point share, over that of those which differ between cameras. Rays
show nothing of it: it is by how much a network's points are off two people's beyond what rays show (three flights: 1.5
to 3)."""
FEWEST = 30.0
"""Redundant errors without which nothing is said of what lasts."""
SHRINK = 30.0
"""Redundant errors of the usual variance that each marker's own are averaged with."""


def persistent_px(matrices: Array, uv_px: Array, xyz_m: Array, *, relative: Array) -> Array:
    """(M,) standard deviation of a pixel coordinate of errors that last longer than ``LAG`` frames; NaN: not known.

    The residual r of a ray with redundancy rho (``mocap.cameras.linearised.Fit``) has E |r|^2 = rho s^2: its own point
    takes up the rest. Residuals t frames apart therefore have E r_0 r_t = sqrt(rho_0 rho_t) c(t), and the
    autocovariance c at ``LAG`` is the variance of what lasts; white errors have none. That the part of such an error
    which the point takes up is as large as that which shows is what makes it the variance of the point.

    Args:
        matrices: (C, 3, 4) projections.
        uv_px: (C, T, M, 2) believed ideal pixels; NaN where not seen.
        xyz_m: (T, M, 3) points near which to linearise.
        relative: (C, T, M) deviations of rays relative to a usual one's, by which residuals are divided.
    """
    if uv_px.shape[1] <= LAG:
        return np.full(uv_px.shape[2], np.nan)
    share, product = _at_lag(*_residuals(matrices, uv_px, xyz_m, relative), LAG)
    if share.sum() < FEWEST:
        return np.full(uv_px.shape[2], np.nan)
    usual = product.sum() / max(float(share.sum()), 1e-12)
    return np.sqrt(np.maximum((product + SHRINK * usual) / (share + SHRINK), 0.0))


def share_left(matrices: Array, uv_px: Array, xyz_m: Array, *, relative: Array) -> float:
    """Share a of an error that lasts which is left a frame later, below 1.

    If the autocovariance is c(t) = c(LAG) a^(t - LAG), its sum from ``LAG`` on is c(LAG) / (1 - a); it is added up as
    far as c exceeds its own deviation in white noise, c(0) / sqrt(n). Errors that last less than ``LAG`` frames are not
    told from white ones: 1 / (1 - a) is that at least. Where nothing is known errors last as long as the recording.

    Args:
        matrices: As of ``persistent_px``.
        uv_px: As there.
        xyz_m: As there.
        relative: As there.
    """
    n_frames, found = uv_px.shape[1], _residuals(matrices, uv_px, xyz_m, relative)
    share, product = (float(part.sum()) for part in _at_lag(*found, 0))
    if n_frames <= LAG or share < FEWEST:
        return 1 - 1 / max(n_frames, LAG)
    usual, covariances = product / share, list[float]()
    for lag in range(LAG, n_frames):
        share, product = (float(part.sum()) for part in _at_lag(*found, lag))
        if product <= usual * np.sqrt(share):
            break
        covariances.append(product / share)
    return 1 - 1 / max(sum(covariances) / covariances[0] if covariances else 0.0, LAG)


def _residuals(matrices: Array, uv_px: Array, xyz_m: Array, relative: Array) -> tuple[Array, Array]:
    """(C, T, M, 2) residuals over their relative deviations, and (C, T, M) their redundancies, 0 where next to none."""
    problem = linearise(matrices, uv_px.reshape(len(uv_px), -1, 2), xyz_m.reshape(-1, 3))
    found = fit(problem, (1 / relative**2).reshape(len(uv_px), -1))
    redundancy = found.redundancy.reshape(uv_px.shape[:3])
    known = redundancy > 0.1
    residual = found.residual.reshape(uv_px.shape) / relative[..., None]
    return np.where(known[..., None], residual, 0.0), np.where(known, redundancy, 0.0)


def _at_lag(residual: Array, redundancy: Array, lag: int) -> tuple[Array, Array]:
    """(M,) sums of sqrt(rho_0 rho_t) and of r_0 r_t over residuals t frames apart."""
    later, before = slice(lag, None), slice(None, residual.shape[1] - lag)
    share = np.sqrt(redundancy[:, later] * redundancy[:, before])
    product = np.sum(residual[:, later] * residual[:, before], axis=-1)
    return share.sum(axis=(0, 1)), product.sum(axis=(0, 1))


def lasting_share(lasting_px: Array, usual_px: Array, *, removed_px: float = 0.0) -> Array:
    """(M,) covariance of a point that does not average out over frames, over that of its clicks in one frame.

    With the variance s^2 of what lasts of a click's s0^2: (1 + ``UNSEEN``) s^2 / s0^2. Where it is not known what lasts
    (frames too far apart for any filter to average over) all errors do, those with the variance r^2 that were taken for
    slow ones and removed included: (1 + ``UNSEEN``) (s0^2 + r^2) / s0^2, less 1 for what the clicks' covariance holds.

    Args:
        lasting_px: (M,) deviations of errors that last; NaN: not known.
        usual_px: (M,) deviations of the errors that the clicks' covariance holds.
        removed_px: Deviation of the slow errors that were removed.
    """
    known = (1 + UNSEEN) * (np.nan_to_num(lasting_px) / usual_px) ** 2
    unknown = UNSEEN + (1 + UNSEEN) * (removed_px / usual_px) ** 2
    return np.where(np.isfinite(lasting_px), known, unknown)
