"""Each marker by itself, with an acceleration that lasts as long as recordings show (Singer 1970)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mocap.filters.models.base import FittedMotion, TrajectoryModel, TrialSet
from mocap.filters.models.constant_velocity import marker_motion
from mocap.filters.motion.constant_velocity import MarkerMotion
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


@dataclass(frozen=True, kw_only=True)
class LastingSettings(TrajectoryModel):
    """Lasting accelerations, each marker for itself.

    An acceleration lasts for sd(velocity) / sd(acceleration): of an oscillation, for a radian.
    docs/experiments/lasting_acceleration.md.
    """

    @property
    def description(self) -> str:
        """Its name."""
        return "lasting acceleration"

    def fit(self, trials: TrialSet) -> FittedMotion:
        """Learn how each marker moves and accelerates in all trials."""
        *others, last = trials.trials
        model = learn_lasting(last.xyz_m, dt_s=last.dt_s, others=[trial.xyz_m for trial in others])
        return FittedMotion(model, last.t_s, trials.rigid)


def learn_lasting(xyz_m: Array, *, dt_s: float, others: Sequence[Array] = ()) -> LastingAcceleration:
    """Of each marker's deviations of velocity and acceleration the geometric mean over all recordings is taken.

    Args:
        xyz_m: (T, M, 3) markers in the world; NaN where not seen. One that is never seen starts amid the others.
        dt_s: Time step.
        others: Other recordings of the same markers and rate.
    """
    seen = np.isfinite(xyz_m[..., 0])
    start = xyz_m[np.argmax(seen, axis=0), np.arange(xyz_m.shape[1])]
    start = np.where(np.isfinite(start), start, np.nanmean(xyz_m.reshape(-1, 3), axis=0))
    extent = float(np.sqrt(np.mean(np.nanvar(xyz_m.reshape(-1, 3), axis=0))))
    shown = np.log([marker_motion(xyz, dt_s=dt_s) for xyz in (*others, xyz_m)])
    mean = np.exp(np.ma.masked_invalid(shown).mean(axis=0).filled(np.nan))
    usual = np.nanmedian(mean, axis=0) if np.isfinite(mean).any() else np.array([1.0, 1.0 / dt_s])
    velocity, acceleration = np.maximum(np.where(np.isfinite(mean), mean, usual), 1e-6).T
    return LastingAcceleration(
        start_m=start,
        start_sd_m=max(extent, 1e-3),
        speed_sd_m_s=2 * max(float(np.sqrt(np.mean(velocity**2))), 1e-3),
        acceleration_m_s2=acceleration,
        memory_s=max(float(np.median(velocity / acceleration)), dt_s),
    )
