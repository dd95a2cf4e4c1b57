"""Mechanics of the shape, identified from recorded motion."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mocap.filters.motion.shape import LinearShape
from numpy.typing import NDArray

from eal.arrays import Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Motion:
    """Shapes with their derivatives, the frames of all trials on end.

    Attributes:
        z: (N, r) shapes.
        rate: (N, r) velocities.
        acceleration: (N, r) accelerations.
        trial: (N,) the stretch of neighbouring frames that each belongs to.
        dt_s: Time between neighbouring frames.
    """

    z: Array
    rate: Array
    acceleration: Array
    trial: NDArray[np.int64]
    dt_s: float

    @property
    def unit(self) -> float:
        """Deviation of the first shape coordinate."""
        return float(self.z[:, 0].std())

    @property
    def tau_s(self) -> float:
        """Time that makes velocities as large as shapes."""
        return float(np.sqrt(np.sum(self.z.var(axis=0)) / np.sum(self.rate.var(axis=0))))


def linear_shape(motion: Motion, *, ridge: float, process_noise: float = 1.0) -> LinearShape:
    """Ridge regression of accelerations on shapes and velocities: stiffness, damping and a constant force.

    Args:
        motion: What was recorded.
        ridge: Penalty on coefficients of standardised regressors, as a share of the number of frames.
        process_noise: Factor on the density of what is left.
    """
    r = motion.z.shape[1]
    tau = motion.tau_s
    x = np.column_stack([motion.z, tau * motion.rate])
    mean, scale = x.mean(axis=0), np.sqrt(x.var(axis=0) + 1e-6 * x.var(axis=0).max() + 1e-30)
    u = (x - mean) / scale
    target = motion.acceleration
    coefficients = np.linalg.solve(u.T @ u + ridge * len(u) * np.eye(2 * r), u.T @ (target - target.mean(axis=0)))
    slope = (coefficients / scale[:, None]).T  # (r, 2r)
    left = target - target.mean(axis=0) - u @ coefficients
    return LinearShape(
        stiffness=-slope[:, :r],
        damping=-tau * slope[:, r:],
        force=target.mean(axis=0) - slope @ mean,
        density=unexplained(left, motion, process_noise),
    )


def unexplained(left: Array, motion: Motion, process_noise: float) -> Array:
    """Lower factor of the spectral density of unexplained accelerations: 2 (their correlation time) (covariance)."""
    change = np.diff(left, axis=0)[np.diff(motion.trial) == 0]
    time = motion.dt_s * np.sqrt(np.mean(left**2) / max(float(np.mean(change**2)), 1e-30))
    cov = process_noise * 2 * time * left.T @ left / len(left)
    floor = 1e-6 * np.trace(cov) / len(cov) + 1e-18
    return np.linalg.cholesky(cov + floor * np.eye(len(cov)))


def joined(parts: Sequence[tuple[Array, Array, Array]], dt_s: float) -> Motion:
    """Motion of several stretches of (z, rate, acceleration)."""
    z, rate, acceleration = (np.concatenate(column) for column in zip(*parts, strict=True))
    trial = np.repeat(np.arange(len(parts)), [len(part[0]) for part in parts])
    return Motion(z=z, rate=rate, acceleration=acceleration, trial=trial, dt_s=dt_s)
