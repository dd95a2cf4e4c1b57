"""Slowly varying pixel errors, which do not average out: the residual of a camera and marker keeps its sign for long.

Errors of lens and calibration reach several pixels where a digitiser's jitter is half a pixel. Treated as white noise
such errors make a smoothed track too confident, and let it jump when a camera loses the marker. With the eight rounds
below such a jump shrinks by about a quarter, with 128 by half: an error common to all rays of a point stays.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.cameras.triangulate import MISSES, fit, linear, linearise, pixel_sd, project, refine, residual_px
from mocap.cleaning.click_noise import SHRINK
from mocap.filters.whittaker import fastest_hz, smooth_series, smoother


@dataclass(frozen=True, eq=False, kw_only=True)
class RayBias:
    """Slowly varying error of every observation (camera, frame, marker).

    Attributes:
        bias_px: (C, T, M, 2) to subtract from ideal pixels; 0 where nothing is known or nothing was found.
        sd_px: Standard deviation of the bias over all rays but those of cameras that went bad; 0 where none was found.
        jitter_px: Standard deviation of a pixel coordinate once the bias is subtracted.
    """

    bias_px: Array
    sd_px: float
    jitter_px: float


def ray_bias(
    matrices: Array,
    uv_px: Array,
    *,
    dt_s: float,
    iterations: int = 8,
    relative: Array | None = None,
) -> RayBias:
    """Slowly varying pixel errors, estimated from the residuals of triangulation.

    Alternates between points (least squares on corrected pixels) and biases (residuals of each camera and marker,
    smoothed over time): the minimum of sum |uv - project(x) - b|^2 + penalty on the second difference of b, in which a
    point may move freely but a bias may not jump. An error common to all rays of a point is not observable and stays
    in the point. Found only if the smoothed residuals exceed three times the variance that white noise would leave.

    Args:
        matrices: (C, 3, 4) projections.
        uv_px: (C, T, M, 2) ideal pixels without rays that miss; NaN where not seen.
        dt_s: Time step.
        iterations: Rounds.
        relative: (C, T, M) deviations of rays, relative to a usual one's; None: 1.
    """
    cutoff_hz = min(8.0, 0.05 / dt_s)  # faster errors count as jitter
    seen = np.isfinite(uv_px[..., 0])
    count = seen.sum(axis=0)
    none = np.zeros_like(uv_px)
    spread = np.ones(seen.shape) if relative is None else relative
    xyz = linear(matrices, uv_px, relative=spread)
    total = pixel_sd(residual_px(matrices, uv_px, xyz, relative=spread), count)
    if len(xyz) < 3:
        return RayBias(bias_px=none, sd_px=0.0, jitter_px=total)
    redundant = count >= 2
    weight = np.where(seen & redundant, 1 / spread**2, 0.0).swapaxes(1, 2)  # (C, M, T)
    many = np.count_nonzero(weight, axis=-1) >= 3
    smooth = smoother(weight[many], dt_s=dt_s, cutoff_hz=cutoff_hz) if many.any() else None
    bias = none
    for _ in range(iterations):
        corrected = uv_px - bias
        xyz, _ = refine(matrices, corrected, linear(matrices, corrected, relative=spread), sd_px=spread, iterations=3)
        if smooth is None:
            break
        residual = np.nan_to_num(np.swapaxes(uv_px - project(matrices, xyz), 1, 2))  # (C, M, T, 2)
        slow = np.zeros_like(residual)
        slow[many] = smooth(residual[many])
        bias = np.where(seen[..., None], slow.swapaxes(1, 2), 0.0)
    corrected = uv_px - bias
    good = seen & redundant & (spread <= 1.0)  # a camera that went bad is no measure of the others
    if (good.sum(axis=0) >= 2).any():
        corrected, count = np.where(good[..., None], corrected, np.nan), good.sum(axis=0)
    else:
        good = seen & redundant
    jitter = pixel_sd(residual_px(matrices, corrected, linear(matrices, corrected)), count)
    sd = float(np.sqrt(np.mean(bias[good] ** 2)))
    white = jitter**2 * 2 * cutoff_hz * dt_s  # variance of white noise after a low pass of that cutoff
    if sd**2 < 3 * white:
        return RayBias(bias_px=none, sd_px=0.0, jitter_px=total)
    return RayBias(bias_px=bias, sd_px=sd, jitter_px=jitter)


def lasting_bias(bias_px: Array, uv_px: Array) -> Array:
    """(C, T, M, 2) slow errors of each camera and marker in all frames: between those that it saw, interpolated.

    Args:
        bias_px: (C, T, M, 2) ``RayBias.bias_px``.
        uv_px: (C, T, M, 2) what it was estimated from; NaN where not seen.
    """
    out = np.zeros_like(bias_px)
    every = np.arange(bias_px.shape[1])
    for camera, marker in np.ndindex(bias_px.shape[0], bias_px.shape[2]):
        seen = np.flatnonzero(np.isfinite(uv_px[camera, :, marker, 0]))
        for axis in range(2 if len(seen) else 0):
            out[camera, :, marker, axis] = np.interp(every, seen, bias_px[camera, seen, marker, axis])
    return out


LAG = 3
"""Frames between residuals that are compared: errors that last longer do not average out over the frames that a filter
smooths over."""
UNSEEN = 2.0
"""Variance of lasting errors that all cameras of a point share, over that of those which differ between cameras. Rays
show nothing of it: it is by how much a network's points are off two people's beyond what rays show (three flights: 1.5
to 3)."""


def persistent_px(matrices: Array, uv_px: Array, xyz_m: Array, *, relative: Array) -> Array:
    """(M,) standard deviation of a pixel coordinate of errors that last longer than ``LAG`` frames; NaN: not known.

    The residual r of a ray with redundancy rho (``Fit``) has E |r|^2 = rho s^2: its own point takes up the rest.
    Residuals t frames apart therefore have E r_0 r_t = sqrt(rho_0 rho_t) c(t), and the autocovariance c at ``LAG`` is
    the variance of what lasts; white errors have none. That the part of such an error which the point takes up is as
    large as that which shows is what makes it the variance of the point.

    Args:
        matrices: (C, 3, 4) projections.
        uv_px: (C, T, M, 2) believed ideal pixels; NaN where not seen.
        xyz_m: (T, M, 3) points near which to linearise.
        relative: (C, T, M) deviations of rays relative to a usual one's, by which residuals are divided.
    """
    if uv_px.shape[1] <= LAG:
        return np.full(uv_px.shape[2], np.nan)
    share, product = _at_lag(*_relative_residuals(matrices, uv_px, xyz_m, relative), LAG)
    if share.sum() < SHRINK:  # else more would be drawn than is known
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
    n_frames, found = uv_px.shape[1], _relative_residuals(matrices, uv_px, xyz_m, relative)
    share, product = (float(part.sum()) for part in _at_lag(*found, 0))
    if n_frames <= LAG or share < SHRINK:
        return 1 - 1 / max(n_frames, LAG)
    usual, covariances = product / share, list[float]()
    for lag in range(LAG, n_frames):
        share, product = (float(part.sum()) for part in _at_lag(*found, lag))
        if product <= usual * np.sqrt(share):
            break
        covariances.append(product / share)
    return 1 - 1 / max(sum(covariances) / covariances[0] if covariances else 0.0, LAG)


def _relative_residuals(matrices: Array, uv_px: Array, xyz_m: Array, relative: Array) -> tuple[Array, Array]:
    """(C, T, M, 2) residuals over their relative deviations, and (C, T, M) their redundancies, 0 where next to none."""
    problem = linearise(matrices, uv_px.reshape(len(uv_px), -1, 2), xyz_m.reshape(-1, 3))
    found = fit(problem, (1 / relative**2).reshape(len(uv_px), -1))
    redundancy = found.redundancy.reshape(uv_px.shape[:3])
    redundant = redundancy > 0.1
    residual = found.residual.reshape(uv_px.shape) / relative[..., None]
    return np.where(redundant[..., None], residual, 0.0), np.where(redundant, redundancy, 0.0)


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
    met = (free > 0) & (missed <= MISSES * usual_px)
    squares = SHRINK * usual_px**2 + np.sum((free * missed**2)[met])
    sd = float(np.sqrt(squares / (SHRINK + free[met].sum())))
    return sd, missed > MISSES * max(sd, usual_px)


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
        left: Share of an error that is left a frame later (``mocap.cleaning.bias.share_left``).
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
