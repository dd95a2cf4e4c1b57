"""Each marker for itself, driven by accelerations that are white, or that last (Singer 1970)."""

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from mocap.filters.gaussian import Moments, Move, View
from mocap.filters.motion.base import MotionModel, Step, Steps
from mocap.filters.motion.shape import driven

from eal.arrays import Array


def white_acceleration(density: Array, dt_s: float) -> tuple[Array, Array, Array]:
    """Cholesky entries of the noise of (position, velocity) under white acceleration of a spectral density.

    Q = S [[dt^3/3, dt^2/2], [dt^2/2, dt]] = L L^T for each component (Bar-Shalom et al. 2001, section 6.2.2).

    Args:
        density: (k,) spectral densities S in m^2/s^3.
        dt_s: Step.

    Returns:
        (k,) entries L11, L21, L22.
    """
    root = np.sqrt(density * dt_s)
    return root * dt_s / np.sqrt(3), root * np.sqrt(3) / 2, root / 2


@dataclass(frozen=True, eq=False, kw_only=True)
class MarkerMotion(MotionModel):
    """State [position (3), velocity (3), ...] in the world, of each marker by itself: k numbers a coordinate.

    Attributes:
        start_m: (M, 3) mean of the positions before anything is seen.
        start_sd_m: Standard deviation of each coordinate of them.
        speed_sd_m_s: Standard deviation of a velocity component at the start.
    """

    start_m: Array
    start_sd_m: float
    speed_sd_m_s: float

    @property
    @abstractmethod
    def start_sd(self) -> Array:
        """(M, k) standard deviations of the numbers of each coordinate at the start."""

    @abstractmethod
    def step(self, dt_s: float) -> tuple[Array, Array]:
        """(k, k) transition of each coordinate in a step, and (M, k, k) covariance of its noise."""

    @property
    def size(self) -> int:
        """Numbers of a state."""
        return 3 * self.start_sd.size

    def initial(self) -> Moments:
        """At ``start_m``, at rest."""
        each = np.repeat(self.start_sd, 3, axis=1)
        mean = np.zeros(each.shape)
        mean[:, :3] = self.start_m
        return Moments(mean, each[:, None] * each[..., None] * np.eye(each.shape[1]))

    def move(self, state: Moments, step: Step) -> Move:  # noqa: ARG002
        """Coordinates move by themselves, all alike."""
        if step.dt_s not in self._moves:
            chain, noise = self.step(step.dt_s)
            size = 3 * len(chain)
            each = np.einsum("mab,ij->maibj", noise, np.eye(3)).reshape(-1, size, size)
            self._moves[step.dt_s] = Move(np.zeros((0, 0)), chain, each)
        return self._moves[step.dt_s]

    @cached_property
    def _moves(self) -> Steps[Move]:
        return Steps()

    def view(self, mean: Array, frame: int) -> View:  # noqa: ARG002
        """The positions themselves."""
        return View(mean[:, :3], np.zeros((len(mean), 3, 0)), 0)

    def rates(self, mean: Array, frame: int) -> tuple[Array, Array]:  # noqa: ARG002
        """The velocities themselves."""
        return mean[:, 3:6], np.broadcast_to(np.eye(6, mean.shape[1]), (len(mean), 6, mean.shape[1]))


@dataclass(frozen=True, eq=False, kw_only=True)
class ConstantVelocity(MarkerMotion):
    """Accelerations are white.

    Attributes:
        density: (M,) spectral density of each marker's acceleration, m^2/s^3.
    """

    density: Array
    name: str = "constant_velocity"

    @property
    def start_sd(self) -> Array:
        """(M, 2)."""
        return np.array([[self.start_sd_m, self.speed_sd_m_s]] * len(self.start_m))

    def step(self, dt_s: float) -> tuple[Array, Array]:
        """See ``white_acceleration``."""
        l11, l21, l22 = white_acceleration(self.density, dt_s)
        noise = np.array([[l11**2, l11 * l21], [l11 * l21, l21**2 + l22**2]])
        return np.array([[1.0, dt_s], [0.0, 1.0]]), np.moveaxis(noise, 2, 0)


def lasting_acceleration(memory_s: float, dt_s: float) -> tuple[Array, Array]:
    """One step of [position, velocity, acceleration] whose acceleration forgets itself in a time tau.

    a' = -a / tau + sqrt(2 / tau) w, w white noise of unit density: the acceleration has the variance 1 and the
    correlation exp(-|t| / tau). Short tau: constant velocity; long tau: constant acceleration.
    Source: Singer 1970, IEEE Transactions on Aerospace and Electronic Systems 6, 473.

    Args:
        memory_s: tau.
        dt_s: Length of the step.

    Returns:
        (3, 3) transition, and (3, 3) covariance of the noise.
    """
    flow = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0 / memory_s]])
    return driven(flow, np.diag([0.0, 0.0, 2.0 / memory_s]), dt_s, memory_s)


@dataclass(frozen=True, eq=False, kw_only=True)
class LastingAcceleration(MarkerMotion):
    """State [position (3), velocity (3), acceleration (3)] in the world, of each marker by itself.

    Attributes:
        acceleration_m_s2: (M,) standard deviation of a component of each marker's acceleration.
        memory_s: How long an acceleration lasts (``lasting_acceleration``).
    """

    acceleration_m_s2: Array
    memory_s: float
    name: str = "lasting_acceleration"

    @property
    def start_sd(self) -> Array:
        """(M, 3)."""
        return np.column_stack(np.broadcast_arrays(self.start_sd_m, self.speed_sd_m_s, self.acceleration_m_s2))

    def step(self, dt_s: float) -> tuple[Array, Array]:
        """Noise drives the accelerations."""
        chain, noise = lasting_acceleration(self.memory_s, dt_s)
        return chain, noise * (self.acceleration_m_s2**2)[:, None, None]
