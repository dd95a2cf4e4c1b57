"""Mechanics of the shape, identified from recorded motion: how the pose coordinates z move."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from eal.arrays import Array


@dataclass(frozen=True, eq=False)
class LinearShape:
    """zddot = force - stiffness z - damping zdot + u, fitted to recordings; u' = -u / memory + white noise.

    It is no Lagrangian system: neither matrix is held to be symmetric (on real sets the antisymmetric part of the
    stiffness is 0.5 to 0.7 of the symmetric one), and damping may be negative, as muscles do work. The force u that is
    left unexplained lasts: were it white, velocities of bats' wings would be stated three times too uncertain.

    Attributes:
        stiffness: (r, r) in 1/s^2, the mass being 1.
        damping: (r, r) in 1/s.
        force: (r,) constant force.
        density: (r, r) lower factor of the spectral density of u at low frequencies.
        memory_s: Time after which u has lost all but 1/e of its correlation; (r,) of each if ``density`` is diagonal.
    """

    stiffness: Array
    damping: Array
    force: Array
    density: Array
    memory_s: float | Array

    @property
    def lasting_sd(self) -> Array:
        """(r,) standard deviation of u, which is a state after z and zdot; its density is 2 (memory) (covariance)."""
        return np.linalg.norm(self.density, axis=1) / np.sqrt(2 * self.memory_s)

    @cached_property
    def _generator(self) -> Array:
        """(3r + 1, 3r + 1) of [z, zdot, u, 1]."""
        r = len(self.force)
        z, rate, u = (slice(k * r, (k + 1) * r) for k in range(3))
        out = np.zeros((3 * r + 1, 3 * r + 1))
        out[z, rate] = out[rate, u] = np.eye(r)
        out[rate, z], out[rate, rate], out[rate, -1] = -self.stiffness, -self.damping, self.force
        out[u, u] = -np.eye(r) / self.memory_s
        return out

    def noise(self, dt_s: float) -> Array:
        """(3r, 3r) lower factor of the process noise of [z, zdot, u] in one step."""
        n, r = 3 * len(self.force), len(self.force)
        white = np.zeros((n, n))
        white[2 * r :, 2 * r :] = self.density @ self.density.T / self.memory_s**2
        _, cov = driven(self._generator[:n, :n], white, dt_s, float(np.min(self.memory_s)))
        size = np.sqrt(np.diag(cov))
        alike = cov / size / size[:, None]  # positions, velocities and forces differ by powers of dt
        return size[:, None] * np.linalg.cholesky(alike + 1e-9 * np.eye(n))

    def flow(self, dt_s: float) -> tuple[Array, Array]:
        """(3r, 3r) transition of [z, zdot, u] in a step, exact (matrix exponential), and (3r,) what force adds."""
        flow = expm(dt_s * self._generator)
        return flow[:-1, :-1], flow[:-1, -1]


def driven(flow: Array, white: Array, dt_s: float, memory_s: float) -> tuple[Array, Array]:
    """(n, n) transition of x' = flow x + white noise in a step, and covariance of what the noise adds (Van Loan 1978).

    His matrix grows as exp(step / memory): it is taken of a step no longer than the memory, which is doubled then.

    Args:
        flow: (n, n).
        white: (n, n) spectral density of the noise.
        dt_s: Length of the step.
        memory_s: The shortest time in which a component forgets itself.
    """
    n = len(flow)
    doublings = max(0, int(np.ceil(np.log2(dt_s / memory_s))))
    both = expm(dt_s / 2**doublings * np.block([[-flow, white], [np.zeros((n, n)), flow.T]]))
    move = both[n:, n:].T
    noise = move @ both[:n, n:]
    for _ in range(doublings):
        noise, move = move @ noise @ move.T + noise, move @ move
    return move, 0.5 * (noise + noise.T)


@dataclass(frozen=True, eq=False, kw_only=True)
class RecordedMotion:
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


def linear_shape(motion: RecordedMotion, *, ridge: float) -> LinearShape:
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
        memory_s=memory_s(left, motion),
    )


def memory_s(left: Array, motion: RecordedMotion) -> float:
    """Time in seconds that accelerations (N, r) which mechanics leave unexplained last: their size over their rate."""
    change = np.diff(left, axis=0)[np.diff(motion.trial) == 0]
    return motion.dt_s * float(np.sqrt(np.mean(left**2) / max(float(np.mean(change**2)), 1e-30)))


def unexplained(left: Array, motion: RecordedMotion) -> Array:
    """Lower factor of the spectral density of unexplained accelerations: 2 (how long they last) (covariance)."""
    cov = 2 * memory_s(left, motion) * left.T @ left / len(left)
    floor = 1e-6 * np.trace(cov) / len(cov) + 1e-18
    return np.linalg.cholesky(cov + floor * np.eye(len(cov)))


def joined(parts: Sequence[tuple[Array, Array, Array]], dt_s: float) -> RecordedMotion:
    """Motion of several stretches of (z, rate, acceleration)."""
    z, rate, acceleration = (np.concatenate(column) for column in zip(*parts, strict=True))
    trial = np.repeat(np.arange(len(parts)), [len(part[0]) for part in parts])
    return RecordedMotion(z=z, rate=rate, acceleration=acceleration, trial=trial, dt_s=dt_s)
