"""Each marker for itself, with an acceleration that lasts for a while (Singer 1970)."""

from dataclasses import dataclass, field

import numpy as np
from mocap.filters.ensemble import Gaussian, SigmaPoints, default_points
from mocap.filters.motion.base import MotionModel
from scipy.linalg import expm

from eal.arrays import Array


def lasting_acceleration(memory_s: float, dt_s: float) -> tuple[Array, Array]:
    """One step of [position, velocity, acceleration] whose acceleration forgets itself in a time tau.

    a' = -a / tau + sqrt(2 / tau) w, w white noise of unit density: the acceleration has the variance 1 and the
    correlation exp(-|t| / tau). Short tau: constant velocity; long tau: constant acceleration.

    Source: Singer 1970, IEEE Transactions on Aerospace and Electronic Systems 6, 473; the noise of a step by Van Loan
    1978, IEEE Transactions on Automatic Control 23, 395.

    Args:
        memory_s: tau.
        dt_s: Length of the step.

    Returns:
        (3, 3) transition, and (3, 3) covariance of the noise.
    """
    flow = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0 / memory_s]])
    driven = np.diag([0.0, 0.0, 2.0 / memory_s])
    halvings = max(0, int(np.ceil(np.log2(dt_s / memory_s))))  # exp(dt / tau) stays below e
    both = expm(np.block([[-flow, driven], [np.zeros((3, 3)), flow.T]]) * (dt_s / 2**halvings))
    move = both[3:, 3:].T
    noise = move @ both[:3, 3:]
    for _ in range(halvings):
        noise, move = move @ noise @ move.T + noise, move @ move
    return move, 0.5 * (noise + noise.T)


@dataclass(frozen=True, eq=False, kw_only=True)
class LastingAcceleration(MotionModel):
    """State [positions (3M), velocities (3M), accelerations (3M)] in the world.

    Attributes:
        start_m: (M, 3) mean of the positions before anything is seen.
        start_sd_m: Standard deviation of each coordinate of them.
        speed_sd_m_s: Standard deviation of a velocity component at the start.
        acceleration_m_s2: (M,) standard deviation of a component of each marker's acceleration.
        memory_s: How long an acceleration lasts (``lasting_acceleration``).
    """

    start_m: Array
    start_sd_m: float
    speed_sd_m_s: float
    acceleration_m_s2: Array
    memory_s: float
    name: str = "lasting_acceleration"
    linear: bool = True
    reads: int = field(init=False)
    points: SigmaPoints = field(init=False)

    def __post_init__(self) -> None:
        """Sizes."""
        object.__setattr__(self, "reads", self.start_m.size)
        object.__setattr__(self, "points", default_points(3 * self.start_m.size))

    def initial(self) -> Gaussian:
        """At ``start_m``, at rest."""
        sd = np.concatenate(
            [np.full(self.reads, self.start_sd_m), np.full(self.reads, self.speed_sd_m_s), self._each_sd]
        )
        return Gaussian(np.concatenate([self.start_m.ravel(), np.zeros(2 * self.reads)]), np.diag(sd))

    @property
    def _each_sd(self) -> Array:
        return np.repeat(self.acceleration_m_s2, 3)

    def advance(self, states: Array, dt_s: float) -> Array:
        """Positions, velocities and accelerations move on."""
        move, _ = lasting_acceleration(self.memory_s, dt_s)
        return np.einsum("ab,sbk->sak", move, states.reshape(len(states), 3, -1)).reshape(states.shape)

    def noise(self, dt_s: float) -> Array:
        """What drives the accelerations."""
        factor = np.linalg.cholesky(lasting_acceleration(self.memory_s, dt_s)[1])
        return np.kron(factor, np.diag(self._each_sd))

    def markers(self, states: Array, frame: int) -> Array:  # noqa: ARG002
        """The positions themselves."""
        return states.reshape(len(states), -1, 3)

    def starts(self) -> tuple[Array, Array]:
        """Mean (M, 9) and lower factor (M, 9, 9) of each marker's state (``mocap.filters.apart``)."""
        mean = np.concatenate([self.start_m, np.zeros((len(self.start_m), 6))], axis=1)
        factor = np.zeros((len(mean), 9, 9))
        index = np.arange(9)
        factor[:, index[:3], index[:3]], factor[:, index[3:6], index[3:6]] = self.start_sd_m, self.speed_sd_m_s
        factor[:, index[6:], index[6:]] = self.acceleration_m_s2[:, None]
        return mean, factor

    def steps(self, dt_s: float) -> tuple[Array, Array]:
        """Transition (9, 9) and noise (M, 9, 9) of each marker (``mocap.filters.apart``)."""
        move, noise = lasting_acceleration(self.memory_s, dt_s)
        each = np.kron(noise, np.eye(3)) * (self.acceleration_m_s2**2)[:, None, None]
        return np.kron(move, np.eye(3)), each

    def rates(self, mean: Array, frame: int) -> tuple[Array, Array]:  # noqa: ARG002
        """The second third of the state."""
        count = self.reads // 3
        jacobian = np.eye(2 * self.reads, 3 * self.reads).reshape(2, count, 3, -1)
        return mean[self.reads : 2 * self.reads].reshape(-1, 3), np.moveaxis(jacobian, 0, 1).reshape(count, 6, -1)
