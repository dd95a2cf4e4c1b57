"""How rough the residual of each marker is: the rate of its Matern-5/2 process, by the likelihood of what was measured."""

import numpy as np
from mocap.filters.motion.pose import STATIONARY, matern_flow, matern_noise

from eal.arrays import Array

RATES, SIZES = 2.0 ** np.arange(-2, 4), 2.0 ** -np.arange(4)
"""Of rates and standard deviations these multiples are looked at."""
MOST_FRAMES = 400
"""Of longer recordings so many frames in the middle are looked at: a rate is known to 5 % from a few hundred."""


def marker_rates(residual: Array, noise_sd: Array, dt_s: float, sd: Array, common_hz: float) -> Array:
    """Rate of each marker's residual, the same for its three coordinates, given their standard deviations.

    Each coordinate is a Matern-5/2 process of variance ``sd``^2 seen with white noise; its likelihood is that of a
    Kalman filter of three states (Hartikainen & Sarkka 2010), here of all coordinates and rates at once. The rate is
    the mean of its logarithm under that likelihood: where nothing was seen it stays the common one.

    Args:
        residual: (T, 3M) what the subspace leaves of each coordinate in metres; NaN where not seen.
        noise_sd: (T, 3M) standard deviation of its white noise.
        dt_s: Time step.
        sd: (3M,) standard deviation of the process.
        common_hz: Rate in the middle of those looked at, 1/s.

    Returns:
        (3M,) rates in 1/s.
    """
    middle = max(0, (len(residual) - MOST_FRAMES) // 2)
    part = slice(middle, middle + MOST_FRAMES)
    seen, count = residual[part], residual.shape[1]
    noise = np.maximum(noise_sd[part], 1e-6) ** 2
    rates, sizes = np.repeat(common_hz * RATES, len(SIZES)), np.tile(SIZES, len(RATES))
    turn = np.moveaxis(matern_flow(rates * dt_s), -1, 0)[:, None]  # (K, 1, 3, 3)
    root = np.moveaxis(matern_noise(rates * dt_s), -1, 0)[:, None]
    added = (root @ np.swapaxes(root, -1, -2)) * ((sizes[:, None] * sd) ** 2)[..., None, None]  # (K, D, 3, 3)
    mean = np.zeros((len(rates), count, 3))
    cov = STATIONARY * ((sizes[:, None] * sd) ** 2)[..., None, None]
    total = np.zeros((len(rates), count))
    for y, r in zip(seen, noise, strict=True):
        known = np.isfinite(y)
        spread = np.where(known, cov[..., 0, 0] + r, np.inf)  # what was not seen says nothing
        away = np.where(known, y - mean[..., 0], 0.0)
        total -= np.where(known, 0.5 * (np.log(np.where(known, spread, 1.0)) + away**2 / spread), 0.0)
        gain = cov[..., 0] / spread[..., None]
        mean = mean + gain * away[..., None]
        cov = cov - gain[..., None] * cov[..., None, 0, :]
        mean = (turn @ mean[..., None])[..., 0]
        cov = turn @ cov @ np.swapaxes(turn, -1, -2) + added
    total = total.reshape(len(rates), -1, 3).sum(axis=2)
    weight = np.exp(total - total.max(axis=0))
    white = np.sqrt(np.nanmedian(np.where(np.isfinite(seen), noise, np.nan).reshape(len(seen), -1, 3), axis=(0, 2)))
    each = np.sqrt(np.mean(sd.reshape(-1, 3) ** 2, axis=1))
    alike = alike_at_noise(rates[:, None], sizes[:, None] * each, each, np.nan_to_num(white, nan=1e-6), dt_s)
    found = np.exp(np.sum(np.log(alike) * weight, axis=0) / weight.sum(axis=0))
    return np.repeat(found, 3)


def out_of_sample(residual: Array, noise_sd: Array, basis: Array) -> tuple[Array, Array]:
    """(T, 3M) residuals of each marker from the pose of all others, and the noise in them.

    A pose fitted to all markers follows each of them in part: left out, a marker of leverage H = B B^T is missed by
    (1 - H)^-1 of what it is missed by (Cook & Weisberg 1982).

    Args:
        residual: (T, 3M) residuals from the pose of all.
        noise_sd: (T, M) standard deviation of a measured coordinate.
        basis: (3M, r) orthonormal basis of poses.
    """
    each = basis.reshape(-1, 3, basis.shape[1])
    left = np.eye(3) - each @ np.swapaxes(each, 1, 2)
    inverse = np.linalg.inv(left + 1e-3 * np.eye(3))
    missed = np.einsum("mij,tmj->tmi", inverse, residual.reshape(len(residual), -1, 3))
    wider = np.sqrt(np.einsum("mii->mi", inverse))
    return missed.reshape(residual.shape), (noise_sd[..., None] * wider).reshape(residual.shape)


def alike_at_noise(rate: Array, size: Array, sd: Array, noise_sd: Array, dt_s: float) -> Array:
    """Rate of a process of standard deviation ``sd`` that has the spectrum of another where noise hides that.

    The spectrum of a Matern-5/2 process is 16/3 s^2 a^5 / (a^2 + w^2)^3. A smoother follows what lies above the noise,
    density r^2 dt, and what its velocities are uncertain by lies about the frequency where both are equal.

    Args:
        rate: (...) rate a of the other process, 1/s.
        size: (...) its standard deviation s.
        sd: (...) standard deviation of the process that is asked for.
        noise_sd: (...) standard deviation r of the noise.
        dt_s: Time step.
    """
    level = np.cbrt(16 / 3 * size**2 * rate**5 / (noise_sd**2 * dt_s))
    w2 = np.maximum(level - rate**2, 0.0)
    wanted = 5 * np.log(rate) - 3 * np.log(rate**2 + w2) + 2 * np.log(size / sd)
    low, high = np.full(np.broadcast(wanted, sd).shape, 1e-3), np.minimum(rate, np.sqrt(5 * np.maximum(w2, rate**2 / 5)))
    high = high * np.ones_like(low)
    for _ in range(60):  # bisection of a function that increases
        middle = np.sqrt(low * high)
        above = 5 * np.log(middle) - 3 * np.log(middle**2 + w2) > wanted
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return high
