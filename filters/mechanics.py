"""Mechanics of the shape, identified from recorded motion."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mocap.filters.motion.shape import FieldShape, FreeShape, LinearShape
from numpy.typing import NDArray
from scipy.spatial.distance import cdist, pdist

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


def free_shape(motion: Motion) -> FreeShape:
    """White acceleration of the density S = 2 sd(velocity) sd(acceleration) of each coordinate.

    For an oscillation of variance a^2 at w, S = 2 a^2 w^3: its acceleration has variance a^2 w^4 and keeps its sign for
    about 1 / w.
    """
    density = 2 * motion.rate.std(axis=0) * motion.acceleration.std(axis=0)
    return FreeShape(np.diag(np.sqrt(np.maximum(density, 1e-6 * max(density.max(), 1e-12)))))


def linear_shape(motion: Motion, *, ridge: float) -> LinearShape:
    """Ridge regression of accelerations on shapes and velocities: stiffness, damping and a constant force.

    Args:
        motion: What was recorded.
        ridge: Penalty on coefficients of standardised regressors, as a share of the number of frames.
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
        density=unexplained(left, motion),
        memory_s=memory(left, motion),
    )


def memory(left: Array, motion: Motion) -> float:
    change = np.diff(left, axis=0)[np.diff(motion.trial) == 0]
    return motion.dt_s * np.sqrt(np.mean(left**2) / max(float(np.mean(change**2)), 1e-30))


def field_shape(motion: Motion, *, ridge: float, beta: float, centres: int) -> FieldShape:
    """Linear mechanics plus a kernel ridge regression of what they leave, over [z, tau zdot].

    Gaussian kernel of width beta over the median squared distance, on ``centres`` of the frames (subset of
    regressors; Rasmussen & Williams 2006, section 8.3.1). Far from the data the linear mechanics remain.

    Args:
        motion: What was recorded.
        ridge: Penalty, as a share of the number of frames, of both regressions.
        beta: Width of the kernel.
        centres: Number of centres.
    """
    linear = linear_shape(motion, ridge=ridge)
    states = np.column_stack([motion.z, motion.rate])
    tau, unit = motion.tau_s, motion.unit
    r = motion.z.shape[1]
    scale = np.repeat([1 / unit, tau / unit], r)
    x = states * scale
    chosen = x[np.linspace(0, len(x) - 1, min(len(x), centres)).astype(int)]
    width = beta / float(np.median(pdist(chosen, "sqeuclidean")))
    k = np.exp(-width * cdist(x, chosen, "sqeuclidean"))
    kk = np.exp(-width * cdist(chosen, chosen, "sqeuclidean"))
    left = motion.acceleration - linear.acceleration(states)
    system = k.T @ k + ridge * len(x) * kk
    weights = np.linalg.solve(system + 1e-9 * np.trace(system) / len(kk) * np.eye(len(kk)), k.T @ left)

    def acceleration(at: Array) -> Array:
        near = np.exp(-width * cdist(at * scale, chosen, "sqeuclidean"))
        return linear.acceleration(at) + near @ weights

    return FieldShape(acceleration=acceleration, density=unexplained(left - k @ weights, motion))


def unexplained(left: Array, motion: Motion) -> Array:
    """Lower factor of the spectral density of unexplained accelerations: 2 (their correlation time) (covariance)."""
    change = np.diff(left, axis=0)[np.diff(motion.trial) == 0]
    time = motion.dt_s * np.sqrt(np.mean(left**2) / max(float(np.mean(change**2)), 1e-30))
    cov = 2 * time * left.T @ left / len(left)
    floor = 1e-6 * np.trace(cov) / len(cov) + 1e-18
    return np.linalg.cholesky(cov + floor * np.eye(len(cov)))


def joined(parts: Sequence[tuple[Array, Array, Array]], dt_s: float) -> Motion:
    """Motion of several stretches of (z, rate, acceleration)."""
    z, rate, acceleration = (np.concatenate(column) for column in zip(*parts, strict=True))
    trial = np.repeat(np.arange(len(parts)), [len(part[0]) for part in parts])
    return Motion(z=z, rate=rate, acceleration=acceleration, trial=trial, dt_s=dt_s)
