"""Each marker by itself, with an acceleration that lasts as long as recordings show."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mocap.filters.models.base import FittedMotion, TrajectoryModel, TrialSet
from mocap.filters.models.constant_velocity import marker_motion
from mocap.filters.motion.singer import LastingAcceleration

from eal.arrays import Array


@dataclass(frozen=True, kw_only=True)
class LastingSettings(TrajectoryModel):
    """Choices of lasting accelerations, each marker for itself.

    Attributes:
        memory: An acceleration lasts for so many times sd(velocity) / sd(acceleration): of an oscillation, for so many
            radians. docs/experiments/lasting_acceleration.md.
    """

    memory: float = 1.0

    @property
    def description(self) -> str:
        """Its name."""
        return "each marker with an acceleration that lasts"

    def fit(self, trials: TrialSet) -> FittedMotion:
        """Learn how each marker moves and accelerates in all trials."""
        *others, last = trials.trials
        model = learn_lasting(last.xyz_m, dt_s=last.dt_s, others=[trial.xyz_m for trial in others], memory=self.memory)
        return FittedMotion(model, last.t_s, trials.rigid)


def learn_lasting(
    xyz_m: Array, *, dt_s: float, others: Sequence[Array] = (), memory: float = 1.0
) -> LastingAcceleration:
    """Of each marker's deviations of velocity and acceleration the geometric mean over all recordings is taken.

    Args:
        xyz_m: (T, M, 3) markers in the world; NaN where not seen. One that is never seen starts amid the others.
        dt_s: Time step.
        others: Other recordings of the same markers and rate.
        memory: See ``LastingSettings``.
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
        memory_s=memory * max(float(np.median(velocity / acceleration)), dt_s),
    )
