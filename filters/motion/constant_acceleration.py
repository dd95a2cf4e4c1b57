"""Constant acceleration, each marker for itself: white noise jerk."""

from dataclasses import dataclass, field

import numpy as np

from filters.ensemble import Gaussian, SigmaPoints, default_points
from filters.motion.base import MotionModel
from mocap.arrays import Array


def white_jerk(density: Array, dt_s: float) -> Array:
    """Cholesky factors of the noise of (position, velocity, acceleration) under white jerk of a spectral density.

    Q = S [[dt^5/20, dt^4/8, dt^3/6], [dt^4/8, dt^3/3, dt^2/2], [dt^3/6, dt^2/2, dt]] = L L^T for each component
    (Bar-Shalom et al. 2001, section 6.2.3).

    Args:
        density: (k,) spectral densities S in m^2/s^5.
        dt_s: Step.

    Returns:
        (k, 3, 3) lower triangular factors.
    """
    five, three = np.sqrt(5), np.sqrt(3)
    unit = np.array([[five / 10, 0, 0], [five / 4, three / 12, 0], [five / 3, three / 3, 1 / 3]])
    return np.sqrt(density * dt_s)[:, None, None] * (np.array([dt_s**2, dt_s, 1.0])[:, None] * unit)


@dataclass(frozen=True, eq=False, kw_only=True)
class ConstantAcceleration(MotionModel):
    """State [positions (3M), velocities (3M), accelerations (3M)] in the world.

    Attributes:
        start_m: (M, 3) mean of the positions before anything is seen.
        start_sd_m: Standard deviation of each coordinate of them.
        speed_sd_m_s: Standard deviation of a velocity component at the start.
        acceleration_sd_m_s2: (M,) standard deviation of an acceleration component at the start.
        density: (M,) spectral density of each marker's jerk, m^2/s^5.
    """

    start_m: Array
    start_sd_m: float
    speed_sd_m_s: float
    acceleration_sd_m_s2: Array
    density: Array
    name: str = "constant_acceleration"
    linear: bool = True
    reads: int = field(init=False)
    points: SigmaPoints = field(init=False)

    def __post_init__(self) -> None:
        """Sizes."""
        object.__setattr__(self, "reads", self.start_m.size)
        object.__setattr__(self, "points", default_points(3 * self.start_m.size))

    def initial(self) -> Gaussian:
        """At ``start_m``, at rest."""
        k = self.reads
        sd = np.concatenate(
            [np.full(k, self.start_sd_m), np.full(k, self.speed_sd_m_s), np.repeat(self.acceleration_sd_m_s2, 3)]
        )
        return Gaussian(np.concatenate([self.start_m.ravel(), np.zeros(2 * k)]), np.diag(sd))

    def advance(self, states: Array, dt_s: float) -> Array:
        """Positions and velocities move on with their accelerations."""
        x, v, a = np.split(states, 3, axis=1)
        return np.concatenate([x + dt_s * (v + 0.5 * dt_s * a), v + dt_s * a, a], axis=1)

    def noise(self, dt_s: float) -> Array:
        """White jerk."""
        k = self.reads
        blocks = white_jerk(np.repeat(self.density, 3), dt_s)
        factor = np.zeros((3, k, 3, k))
        diagonal = np.arange(k)
        factor[:, diagonal, :, diagonal] = blocks
        return factor.reshape(3 * k, 3 * k)

    def markers(self, states: Array, frame: int) -> Array:  # noqa: ARG002
        """The positions themselves."""
        return states.reshape(len(states), -1, 3)
