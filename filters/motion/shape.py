"""Mechanics of the shape: how the pose coordinates z move, without and with what recordings say of their forces."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from mocap.filters.ensemble import Gaussian, ensemble, spread
from mocap.filters.gaussian import Moments
from mocap.filters.motion.constant_velocity import white_acceleration
from scipy.linalg import expm

from eal.arrays import Array


class ShapeMechanics(ABC):
    """Equation of motion of the shape.

    Attributes:
        density: (r, r) lower factor of the spectral density of the acceleration that the equation leaves unexplained.
        linear: Whether a step is the same function, linear but for a constant, of any state.
    """

    density: Array
    linear: ClassVar[bool] = True

    @property
    def lasting_sd(self) -> Array:
        """Standard deviations of forces that last, which are states after z and zdot; here there are none."""
        return np.zeros(0)

    def arrays(self) -> dict[str, Array]:
        """What model files show of it, by name; here nothing."""
        return {}

    @abstractmethod
    def linearised(self, state: Moments, dt_s: float) -> tuple[Array, Array, Array]:
        """Mean of [z, zdot] after a step, its transition matrix, and (2r, k) deviations that are not linear.

        Args:
            state: [z, zdot].
            dt_s: Step.
        """

    def noise(self, dt_s: float) -> Array:
        """(2r, 2r) lower factor of the process noise of [z, zdot] in one step."""
        l11, l21, l22 = white_acceleration(np.ones(1), dt_s)
        zero = np.zeros_like(self.density)
        return np.block([[l11 * self.density, zero], [l21 * self.density, l22 * self.density]])


@dataclass(frozen=True, eq=False)
class FreeShape(ShapeMechanics):
    """No known force: zddot is white."""

    density: Array

    def linearised(self, state: Moments, dt_s: float) -> tuple[Array, Array, Array]:
        """Velocities carry positions on."""
        transition = np.eye(len(state.mean))
        r = len(self.density)
        transition[:r, r:] = dt_s * np.eye(r)
        return transition @ state.mean, transition, np.zeros((2 * r, 0))


@dataclass(frozen=True, eq=False)
class LinearShape(ShapeMechanics):
    """zddot = force - stiffness z - damping zdot + u, fitted to recordings; u' = -u / memory + white noise.

    It is no Lagrangian system: neither matrix is held to be symmetric (on real sets the antisymmetric part of the
    stiffness is 0.5 to 0.7 of the symmetric one), and damping may be negative, as muscles do work. The force u that is
    left unexplained lasts: were it white, velocities of bats' wings would be stated three times too uncertain.

    Attributes:
        stiffness: (r, r) in 1/s^2, the mass being 1.
        damping: (r, r) in 1/s.
        force: (r,) constant force.
        density: (r, r) lower factor of the spectral density of u at low frequencies.
        memory_s: Time after which u has lost all but 1/e of its correlation.
    """

    stiffness: Array
    damping: Array
    force: Array
    density: Array
    memory_s: float

    @property
    def lasting_sd(self) -> Array:
        """(r,) standard deviation of u, whose density is 2 (memory) (covariance)."""
        return np.linalg.norm(self.density, axis=1) / np.sqrt(2 * self.memory_s)

    def arrays(self) -> dict[str, Array]:
        """Stiffness and damping."""
        return {"stiffness": self.stiffness, "damping": self.damping}

    def acceleration(self, states: Array) -> Array:
        """(S, 2r) states to (S, r) accelerations without u."""
        r = len(self.force)
        return self.force - states[:, :r] @ self.stiffness.T - states[:, r : 2 * r] @ self.damping.T

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
        """(3r, 3r) lower factor of the process noise of [z, zdot, u] in one step (Van Loan 1978)."""
        n, r = 3 * len(self.force), len(self.force)
        flow, white = self._generator[:n, :n], np.zeros((n, n))
        white[2 * r :, 2 * r :] = self.density @ self.density.T / self.memory_s**2
        both = expm(dt_s * np.block([[-flow, white], [np.zeros((n, n)), flow.T]]))
        cov = both[n:, n:].T @ both[:n, n:]
        size = np.sqrt(np.diag(cov))
        alike = 0.5 * (cov + cov.T) / size / size[:, None]  # positions, velocities and forces differ by powers of dt
        return size[:, None] * np.linalg.cholesky(alike + 1e-9 * np.eye(n))

    def linearised(self, state: Moments, dt_s: float) -> tuple[Array, Array, Array]:
        """The exact flow (matrix exponential)."""
        flow = expm(dt_s * self._generator)
        transition = flow[:-1, :-1]
        return transition @ state.mean + flow[:-1, -1], transition, np.zeros((len(transition), 0))


@dataclass(frozen=True, eq=False)
class FieldShape(ShapeMechanics):
    """zddot = f(z, zdot), a field learned from recordings.

    Attributes:
        acceleration: (S, 2r) states to (S, r) accelerations.
        density: See ``ShapeMechanics``.
    """

    acceleration: Callable[[Array], Array]
    density: Array
    linear = False

    def linearised(self, state: Moments, dt_s: float) -> tuple[Array, Array, Array]:
        """Classical Runge-Kutta step of the unscented transform's points, read as a linear map."""
        return unscented_flow(state, lambda x: self._flow(x, dt_s))

    def _flow(self, states: Array, dt_s: float) -> Array:
        def rate(x: Array) -> Array:
            return np.concatenate([x[:, x.shape[1] // 2 :], self.acceleration(x)], axis=1)

        k1 = rate(states)
        k2 = rate(states + 0.5 * dt_s * k1)
        k3 = rate(states + 0.5 * dt_s * k2)
        k4 = rate(states + dt_s * k3)
        return states + dt_s / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def unscented_flow(state: Moments, flow: Callable[[Array], Array]) -> tuple[Array, Array, Array]:
    """A flow of points (S, n) to (S, n), read as a linear map: mean, transition, deviations that are not linear."""
    n = len(state.mean)
    factor = np.linalg.cholesky(state.cov)
    c = min(3.0, n)
    mean, rows = ensemble(flow(spread(Gaussian(state.mean, factor), c)), c, 0.0)
    return mean, np.linalg.solve(factor.T, rows[:n]).T, rows[n:].T
