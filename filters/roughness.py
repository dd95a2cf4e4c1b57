"""How rough the residual of each marker is: the rate of its Matern-5/2 process, by the likelihood of its samples."""

import numpy as np
from mocap.filters.motion.pose import STATIONARY, matern_flow, matern_noise

from eal.arrays import Array

RATES = 2.0 ** np.arange(-2, 3.5, 0.5)
"""Multiples of the usual rate that are looked at."""
NOISES = 2.0 ** np.arange(-0.75, 0.25, 0.25)
"""Multiples of the stated noise that are looked at, as scales of Student's t."""
RATE_FRAMES = 400
"""Of longer recordings so many frames in the middle are looked at. Chosen; not measured."""


def marker_rates(residual: Array, noise_sd: Array, dt_s: float, sd: Array, usual_hz: float) -> Array:
    """Rate of each marker's residual, the same for its three coordinates: that of all markers, or a higher one.

    The rate of all is that under which all are likeliest together, with errors of heavy tails and one factor on them:
    under normal errors of the stated size quick motion is taken for noise. Elbows and knees move by themselves in ways
    that no shape has, at twice the rate of other markers: the rate of a marker is the likeliest that is no lower, with
    normal errors, as a quick stretch of one marker is a careless click to heavy tails. By itself a marker whose
    residual noise hides, as that of a trunk, is likeliest at lower ones, which make velocities look certain.

    Args:
        residual: (T, 3M) what the subspace leaves of each coordinate in metres; NaN where not seen.
        noise_sd: (T, 3M) standard deviation of its white noise.
        dt_s: Time step.
        sd: (3M,) standard deviation of the process.
        usual_hz: The rate about which they are looked for, 1/s.

    Returns:
        (3M,) rates in 1/s.
    """
    middle = max(0, (len(residual) - RATE_FRAMES) // 2)
    part, rates = slice(middle, middle + RATE_FRAMES), usual_hz * RATES
    scales, dof = np.array([*NOISES, 1.0]), np.array([4.0] * len(NOISES) + [1e6])  # the last is the normal law
    *heavy, own = _likelihoods(
        residual[part], scales[:, None] * noise_sd[part, None], dof, dt_s=dt_s, sd=sd, rates=rates
    )
    least = int(max((one.sum(axis=1) for one in heavy), key=np.max).argmax())
    best = own[least:].argmax(axis=0)
    best[best == len(own) - least - 1] = 0  # likeliest at the end of the grid: careless clicks, not motion
    return np.repeat(rates[least + best], 3)


def _likelihoods(residual: Array, scale: Array, dof: Array, *, dt_s: float, sd: Array, rates: Array) -> Array:
    """(L, K, M) log likelihood of each marker's residual under each of (K,) rates and (L,) laws of the errors.

    Each coordinate is a Matern-5/2 process of standard deviation ``sd`` seen with errors of Student's t of ``dof`` and
    (T, L, 3M) ``scale``; its likelihood is that of a Kalman filter of three states (Hartikainen & Sarkka 2010), here of
    all coordinates, rates and laws at once, whose noise is weighted by how far each sample is from its prediction
    (Lange et al. 1989). Of a covariance the six numbers on and above the diagonal are kept.
    """
    turn = np.moveaxis(matern_flow(rates * dt_s), -1, 0)  # (K, 3, 3), of [e, e1 / rate, e2 / rate^2]
    i, j = np.triu_indices(3)
    both = np.einsum("kac,kbd->kabcd", turn, turn)[:, i, j]  # F P F^T of P
    both = both[:, :, i, j] + np.where(i == j, 0.0, both[:, :, j, i])
    size, dof = (sd**2)[:, None], dof[:, None, None]
    added = np.moveaxis(matern_noise(rates * dt_s), -1, 0)[:, None, i, j] * size  # (K, D, 6)
    mean = np.zeros((len(dof), len(rates), len(sd), 3))
    cov = np.tile(STATIONARY[i, j] * size, (len(dof), len(rates), 1, 1))
    total = np.zeros(mean.shape[:3])
    for y, r in zip(residual, np.maximum(scale, 1e-6)[:, :, None] ** 2, strict=True):
        known = np.isfinite(y)
        own, first = cov[..., 0], cov[..., :3]
        spread = own + np.where(known, r, 1.0)
        away = np.where(known, y - mean[..., 0], 0.0)
        off = 1 + away**2 / (dof * spread)
        total -= np.where(known, 0.5 * (np.log(spread) + (dof + 1) * np.log(off)), 0.0)
        spread = own + np.where(known, r, np.inf) * (off * (dof / (dof + 1)))  # what was not seen says nothing
        gain = first / spread[..., None]
        mean = (mean + gain * away[..., None]) @ turn.swapaxes(1, 2)
        cov = (cov - gain[..., i] * first[..., j]) @ both.swapaxes(1, 2) + added
    return total.reshape(*total.shape[:2], -1, 3).sum(axis=3)


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
