"""Constant acceleration, learned from a recording."""

import numpy as np

from filters.learn import learn_constant_velocity
from filters.motion.constant_acceleration import ConstantAcceleration
from filters.subspace import bridge
from mocap.arrays import Array
from mocap.body import smooth_series


def jerk_moments(y: Array, *, dt_s: float, cutoff_hz: float) -> tuple[Array, Array]:
    """Standard deviation of the acceleration, and spectral density of a white jerk that moves like a series.

    S = 2 sd(acceleration) sd(jerk): for an oscillation of variance a^2 at w this is 2 a^2 w^5, as its jerk has variance
    a^2 w^6 and keeps its sign for about 1 / w.

    Args:
        y: (T, k) series.
        dt_s: Time step.
        cutoff_hz: Faster motion is taken for noise.

    Returns:
        (k,) deviations in unit/s^2, and (k,) densities in unit^2/s^5, positive.
    """
    smooth = smooth_series(y, np.ones(len(y)), dt_s=dt_s, cutoff_hz=cutoff_hz)
    acceleration = np.gradient(np.gradient(smooth, dt_s, axis=0), dt_s, axis=0)
    density = 2 * acceleration.std(axis=0) * np.gradient(acceleration, dt_s, axis=0).std(axis=0)
    return acceleration.std(axis=0), np.maximum(density, 1e-6 * max(density.max(), 1e-12))


def learn_constant_acceleration(xyz_m: Array, *, dt_s: float) -> ConstantAcceleration:
    """Constant acceleration for each marker, with the jerk that the recording shows.

    Markers that are seen too seldom take the median of the others; where all are, the jerk changes the acceleration by
    itself within a frame.

    Args:
        xyz_m: (T, M, 3) markers in the world; NaN where not seen. One that is never seen starts amid the others.
        dt_s: Time step.
    """
    start = learn_constant_velocity(xyz_m, dt_s=dt_s)
    seen = np.isfinite(xyz_m[..., 0])
    sd, density = np.full((2, xyz_m.shape[1]), np.nan)
    for marker in np.flatnonzero(seen.sum(axis=0) >= 10):
        frames = np.flatnonzero(seen[:, marker])
        series = bridge(xyz_m[frames[0] : frames[-1] + 1, marker])
        each = jerk_moments(series, dt_s=dt_s, cutoff_hz=min(30.0, 0.2 / dt_s))
        sd[marker], density[marker] = np.sqrt(np.mean(each[0] ** 2)), each[1].mean()
    if np.isfinite(density).any():
        known = np.isfinite(density)
        sd, density = np.where(known, sd, np.median(sd[known])), np.where(known, density, np.median(density[known]))
    else:
        sd = np.full(len(sd), start.speed_sd_m_s / dt_s)
        density = sd**2 / dt_s
    return ConstantAcceleration(
        start_m=start.start_m,
        start_sd_m=start.start_sd_m,
        speed_sd_m_s=start.speed_sd_m_s,
        acceleration_sd_m_s2=2 * np.maximum(sd, 1e-3),
        density=np.maximum(density, 1e-9),  # a marker that never moves still has a covariance
    )
