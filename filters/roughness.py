"""How rough the residual of each marker is: the rate of its Matern-5/2 process, by the likelihood of its samples."""

import numpy as np
from mocap.filters.motion.pose import STATIONARY, matern_flow, matern_noise

from eal.arrays import Array

RATES = 2.0 ** np.arange(0, 3.5, 0.5)
"""Multiples of the common rate that are looked at."""
MOST_FRAMES = 400
"""Of longer recordings so many frames in the middle are looked at."""


def marker_rates(residual: Array, noise_sd: Array, dt_s: float, sd: Array, common_hz: float) -> Array:
    """Rate of each marker's residual, the same for its three coordinates: the common one, or a higher one.

    Elbows and knees move by themselves in ways that no shape has, at twice the rate of other markers. Each coordinate
    is a Matern-5/2 process of standard deviation ``sd`` seen with white noise; its likelihood is that of a Kalman
    filter of three states (Hartikainen & Sarkka 2010), here of all coordinates and rates at once. The rate is the
    likeliest. Lower rates than the common one are not looked at: where noise hides a residual they are likeliest, and
    make velocities look certain.

    Args:
        residual: (T, 3M) what the subspace leaves of each coordinate in metres; NaN where not seen.
        noise_sd: (T, 3M) standard deviation of its white noise.
        dt_s: Time step.
        sd: (3M,) standard deviation of the process.
        common_hz: The common rate, 1/s.

    Returns:
        (3M,) rates in 1/s.
    """
    middle = max(0, (len(residual) - MOST_FRAMES) // 2)
    part = slice(middle, middle + MOST_FRAMES)
    rates = common_hz * RATES
    turn = np.moveaxis(matern_flow(rates * dt_s), -1, 0)[:, None]  # (K, 1, 3, 3), of [e, e1 / rate, e2 / rate^2]
    size = (sd**2)[:, None, None]
    added = np.moveaxis(matern_noise(rates * dt_s), -1, 0)[:, None] * size  # (K, D, 3, 3)
    mean = np.zeros((len(rates), len(sd), 3))
    cov = np.broadcast_to(STATIONARY * size, (len(rates), len(sd), 3, 3))
    total = np.zeros((len(rates), len(sd)))
    for y, r in zip(residual[part], np.maximum(noise_sd[part], 1e-6) ** 2, strict=True):
        known = np.isfinite(y)
        spread = np.where(known, cov[..., 0, 0] + r, np.inf)  # what was not seen says nothing
        away = np.where(known, y - mean[..., 0], 0.0)
        total -= np.where(known, 0.5 * (np.log(np.where(known, spread, 1.0)) + away**2 / spread), 0.0)
        gain = cov[..., 0] / spread[..., None]
        mean = (turn @ (mean + gain * away[..., None])[..., None])[..., 0]
        cov = turn @ (cov - gain[..., None] * cov[..., None, 0, :]) @ np.swapaxes(turn, -1, -2) + added
    total = total.reshape(len(rates), -1, 3).sum(axis=2)
    return np.repeat(rates[total.argmax(axis=0)], 3)


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
