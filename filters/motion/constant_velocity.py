"""Constant velocity, each marker for itself: white noise acceleration."""

from dataclasses import dataclass, field

import numpy as np
from mocap.filters.ensemble import Gaussian, SigmaPoints, default_points
from mocap.filters.motion.base import MotionModel

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
class ConstantVelocity(MotionModel):
    """State [positions (3M), velocities (3M)] in the world.

    Attributes:
        start_m: (M, 3) mean of the positions before anything is seen.
        start_sd_m: Standard deviation of each coordinate of them.
        speed_sd_m_s: Standard deviation of a velocity component at the start.
        density: (M,) spectral density of each marker's acceleration, m^2/s^3.
    """

    start_m: Array
    start_sd_m: float
    speed_sd_m_s: float
    density: Array
    name: str = "constant_velocity"
    linear: bool = True
    reads: int = field(init=False)
    points: SigmaPoints = field(init=False)

    def __post_init__(self) -> None:
        """Sizes."""
        object.__setattr__(self, "reads", self.start_m.size)
        object.__setattr__(self, "points", default_points(2 * self.start_m.size))

    def initial(self) -> Gaussian:
        """At ``start_m``, at rest."""
        k = self.reads
        sd = np.concatenate([np.full(k, self.start_sd_m), np.full(k, self.speed_sd_m_s)])
        return Gaussian(np.concatenate([self.start_m.ravel(), np.zeros(k)]), np.diag(sd))

    def advance(self, states: Array, dt_s: float) -> Array:
        """Positions move on with their velocities."""
        k = self.reads
        return np.concatenate([states[:, :k] + dt_s * states[:, k:], states[:, k:]], axis=1)

    def noise(self, dt_s: float) -> Array:
        """White acceleration."""
        k = self.reads
        entries = white_acceleration(np.repeat(self.density, 3), dt_s)
        factor = np.zeros((2 * k, 2 * k))
        diagonal = np.arange(k)
        factor[diagonal, diagonal], factor[k + diagonal, diagonal], factor[k + diagonal, k + diagonal] = entries
        return factor

    def markers(self, states: Array, frame: int) -> Array:  # noqa: ARG002
        """The positions themselves."""
        return states.reshape(len(states), -1, 3)

    def starts(self) -> tuple[Array, Array]:
        """Mean (M, 6) and lower factor (M, 6, 6) of each marker's [position, velocity] (``mocap.filters.apart``)."""
        mean = np.concatenate([self.start_m, np.zeros_like(self.start_m)], axis=1)
        sd = np.repeat([self.start_sd_m, self.speed_sd_m_s], 3)
        return mean, np.repeat(np.diag(sd)[None], len(mean), axis=0)

    def steps(self, dt_s: float) -> tuple[Array, Array]:
        """Transition (6, 6) and noise (M, 6, 6) of each marker (``mocap.filters.apart``)."""
        l11, l21, l22 = white_acceleration(self.density, dt_s)
        entries = np.array([[l11**2, l11 * l21], [l11 * l21, l21**2 + l22**2]])
        noise = np.einsum("abm,ij->maibj", entries, np.eye(3)).reshape(-1, 6, 6)
        return np.kron([[1.0, dt_s], [0.0, 1.0]], np.eye(3)), noise

    def rates(self, mean: Array, frame: int) -> tuple[Array, Array]:  # noqa: ARG002
        """The second half of the state."""
        count = self.reads // 3
        jacobian = np.eye(2 * self.reads).reshape(2, count, 3, -1)
        return mean[self.reads :].reshape(-1, 3), np.moveaxis(jacobian, 0, 1).reshape(count, 6, -1)
