"""Each marker for itself, as smooth as its order: some derivatives free, the next ones stationary and forgetful.

The position x of each coordinate is driven by white noise w of spectral density q,

    (d/dt)^d (d/dt + a)^(n - d) x = w,

of n states: x and its first n - 1 derivatives. With d = 0 this is a Matern process of order n - 1/2 and rate a
(Hartikainen & Sarkka 2010, IEEE MLSP), with d = n an (n - 1)-fold integrated Wiener process, whose posterior mean is
the smoothing spline of degree 2n - 1 (Wahba 1978, J. R. Stat. Soc. B 40, 364). With d = 1 it is the velocity that is a
Matern process, with d = 2 the acceleration: what flies across a volume returns to no place.
"""

from dataclasses import dataclass, replace
from math import comb

import numpy as np
from mocap.filters.gaussian import Moments, Move
from mocap.filters.motion.base import Step
from mocap.filters.motion.constant_velocity import MarkerMotion
from mocap.filters.motion.shape import driven
from scipy.linalg import solve_continuous_lyapunov

from eal.arrays import Array


def generator(order: int, free: int, rate: float) -> Array:
    """(n, n) companion matrix of (d/dt)^d (d/dt + rate)^(n - d), for [x, x', ...]."""
    out = np.eye(order, k=1)
    for k in range(order - free):
        out[-1, free + k] = -comb(order - free, k) * rate ** (order - free - k)
    return out


def smooth_step(order: int, free: int, rate: float, dt: float) -> tuple[Array, Array]:
    """(n, n) transition in a step, and covariance of what noise of unit density adds, in any unit of time."""
    white = np.zeros((order, order))
    white[-1, -1] = 1.0
    unit = dt ** np.arange(order)  # with the step for a unit all entries are of like size, and none is lost to rounding
    chain, noise = driven(generator(order, free, rate * dt), white, 1.0, 1.0 / max(rate * dt, 1.0))
    return chain * (unit / unit[:, None]), noise * dt ** (2 * order - 1) / (unit[:, None] * unit)


def stationary(order: int, free: int, rate: float) -> Array:
    """(n - d, n - d) covariance of the derivatives that are not free, at a unit density."""
    kept = order - free
    white = np.zeros((kept, kept))
    white[-1, -1] = -1.0
    unit = rate ** np.arange(kept)
    found = solve_continuous_lyapunov(generator(kept, 0, 1.0), white)
    return rate ** (1 - 2 * kept) * 0.5 * (found + found.T) * unit * unit[:, None]


@dataclass(frozen=True, eq=False, kw_only=True)
class SmoothAcceleration(MarkerMotion):
    """State [position (3), velocity (3), ...] in the world, of each marker by itself: n numbers a coordinate.

    The k-th derivative is held times ``unit_s`` to the k, which makes the numbers alike in size.

    Attributes:
        order: n.
        free: d, 1 at least: positions are drawn to no mean.
        rate_hz: a.
        density: (M,) spectral density q of the noise that drives a coordinate of each marker, m^2 / s^(2n - 1).
        intensity: (T, M) by which it is multiplied in the step that leads to each frame, 1 beyond them.
        unit_s: See above.
    """

    order: int
    free: int
    rate_hz: float
    density: Array
    intensity: Array
    unit_s: float
    name: str = "smooth_acceleration"

    @property
    def start_sd(self) -> Array:
        """(M, n) of free derivatives beyond the velocity as large as the velocity's in ten of these units."""
        free = self.start_sd_m, *(self.speed_sd_m_s * self.unit_s * 0.1**k for k in range(self.free - 1))
        out = np.zeros((len(self.start_m), self.order))
        out[:, : self.free] = free
        if self.free < self.order:
            lasting = np.diag(stationary(self.order, self.free, self.rate_hz * self.unit_s))
            out[:, self.free :] = np.sqrt(self._density[:, None] * lasting)
        return out

    @property
    def _density(self) -> Array:
        """(M,) of the state's own unit of time."""
        return self.density * self.unit_s ** (2 * self.order - 1)

    def initial(self) -> Moments:
        """At ``start_m``, at rest; the derivatives that are not free as at any time."""
        alone = super().initial()
        if self.free == self.order:
            return alone
        cov = alone.cov.copy().reshape(-1, self.order, 3, self.order, 3)
        lasting = stationary(self.order, self.free, self.rate_hz * self.unit_s) * self._density[:, None, None]
        for i in range(3):
            cov[:, self.free :, i, self.free :, i] = lasting
        return Moments(alone.mean, cov.reshape(alone.cov.shape))

    def step(self, dt_s: float) -> tuple[Array, Array]:
        """See ``smooth_step``."""
        chain, noise = smooth_step(self.order, self.free, self.rate_hz * self.unit_s, dt_s / self.unit_s)
        return chain, noise * self._density[:, None, None]

    def move(self, state: Moments, step: Step) -> Move:
        """Coordinates move by themselves, all alike, driven as strongly as at that time."""
        usual = super().move(state, step)
        if step.frame >= len(self.intensity):
            return usual
        return replace(usual, noise=usual.noise * self.intensity[step.frame][:, None, None])

    def rates(self, mean: Array, frame: int) -> tuple[Array, Array]:  # noqa: ARG002
        """The velocities themselves."""
        rows = np.eye(6, mean.shape[1])
        rows[3:] /= self.unit_s
        return mean[:, 3:6] / self.unit_s, np.broadcast_to(rows, (len(mean), *rows.shape))

    def accelerations(self, mean: Array, frame: int) -> tuple[Array, Array] | None:  # noqa: ARG002
        """The accelerations themselves, if they are states."""
        if self.order < 3:
            return None
        rows = np.eye(3, mean.shape[1], k=6) / self.unit_s**2
        return mean[:, 6:9] / self.unit_s**2, np.broadcast_to(rows, (len(mean), *rows.shape))
