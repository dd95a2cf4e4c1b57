"""Each marker for itself, with an acceleration that lasts for a while (Singer 1970)."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from mocap.filters.gaussian import Moments, Move, View
from mocap.filters.motion.base import MotionModel, Step, Steps
from mocap.filters.motion.constant_velocity import apart, at_rest, positions, positions_and_velocities
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
    """State [position (3), velocity (3), acceleration (3)] in the world, of each marker by itself.

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

    @property
    def size(self) -> int:
        """Numbers of a state."""
        return 3 * self.start_m.size

    def initial(self) -> Moments:
        """At ``start_m``, at rest."""
        sd = np.column_stack(np.broadcast_arrays(self.start_sd_m, self.speed_sd_m_s, self.acceleration_m_s2))
        return at_rest(self.start_m, sd)

    def move(self, state: Moments, step: Step) -> Move:  # noqa: ARG002
        """Positions, velocities and accelerations move on; noise drives the accelerations."""
        if step.dt_s not in self._moves:
            chain, noise = lasting_acceleration(self.memory_s, step.dt_s)
            self._moves[step.dt_s] = apart(chain, noise * (self.acceleration_m_s2**2)[:, None, None])
        return self._moves[step.dt_s]

    @cached_property
    def _moves(self) -> Steps[Move]:
        return Steps()

    def view(self, mean: Array, frame: int) -> View:  # noqa: ARG002
        """The positions themselves."""
        return positions(mean)

    def rates(self, mean: Array, frame: int) -> tuple[Array, Array]:  # noqa: ARG002
        """The velocities themselves."""
        return positions_and_velocities(mean)
