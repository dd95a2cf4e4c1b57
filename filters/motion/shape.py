"""Mechanics of the shape: how the pose coordinates z move."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
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
