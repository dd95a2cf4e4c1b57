"""Each marker by itself, at constant velocity or with an acceleration that lasts, as recordings show them."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from mocap.filters.models.base import FittedMotion, TrajectoryModel, TrialSet
from mocap.filters.motion.constant_velocity import ConstantVelocity, LastingAcceleration
from mocap.filters.subspace import bridge
from mocap.filters.whittaker import fastest_hz, smooth_series

from eal.arrays import Array, varying


@dataclass(frozen=True, kw_only=True)
class MarkerSettings(TrajectoryModel):
    """Choices of constant velocity, each marker for itself.

    Attributes:
        acceleration: Factor on the density of accelerations that the trials show. The smaller it is, the more frames
            on both sides of a gap are averaged over to know with what velocity a marker left and came back.
    """

    acceleration: float = 1.0

    @property
    def description(self) -> str:
        """Its name."""
        return "constant velocity" if self.acceleration == 1 else "steady velocity"

    def fit(self, trials: TrialSet) -> FittedMotion:
        """Learn how each marker accelerates in all trials."""
        *others, last = trials.trials
        shown = [trial.xyz_m for trial in others]
        model = learn_constant_velocity(last.xyz_m, dt_s=last.dt_s, others=shown, settings=self)
        return FittedMotion(model, last.t_s, trials.rigid)


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


def acceleration_density(y: Array, *, dt_s: float, cutoff_hz: float) -> Array:
    """Spectral density of a white acceleration that moves like a series: S = 2 sd(velocity) sd(acceleration).

    For an oscillation of variance a^2 at w, S = 2 a^2 w^3: its acceleration has variance a^2 w^4 and keeps its sign for
    about 1 / w.

    Args:
        y: (T, k) series.
        dt_s: Time step.
        cutoff_hz: Faster motion is taken for noise.

    Returns:
        (k,) densities in unit^2/s^3, positive.
    """
    density = 2 * np.prod(motion_sd(y, dt_s=dt_s, cutoff_hz=cutoff_hz), axis=0)
    return np.maximum(density, 1e-6 * max(density.max(), 1e-12))


def motion_sd(y: Array, *, dt_s: float, cutoff_hz: float) -> Array:
    """(2, k) standard deviations of velocity and acceleration of a series (T, k); faster motion is taken for noise."""
    smooth = smooth_series(y, np.ones(len(y)), dt_s=dt_s, cutoff_hz=cutoff_hz)
    velocity = np.gradient(smooth, dt_s, axis=0)
    return np.array([velocity.std(axis=0), np.gradient(velocity, dt_s, axis=0).std(axis=0)])


def marker_density(xyz_m: Array, *, dt_s: float) -> Array:
    """(M,) spectral density of each marker's acceleration in a recording (T, M, 3); NaN where it is seen too seldom."""
    density = np.full(xyz_m.shape[1], np.nan)
    for marker, series in _series(xyz_m):
        density[marker] = acceleration_density(series, dt_s=dt_s, cutoff_hz=fastest_hz(dt_s)).mean()
    return density


def marker_motion(xyz_m: Array, *, dt_s: float) -> Array:
    """(M, 2) standard deviations of each marker's velocity and acceleration; NaN where it is seen too seldom."""
    found = np.full((xyz_m.shape[1], 2), np.nan)
    for marker, series in _series(xyz_m):
        found[marker] = np.sqrt(np.mean(motion_sd(series, dt_s=dt_s, cutoff_hz=fastest_hz(dt_s)) ** 2, axis=1))
    return found


def _series(xyz_m: Array) -> Iterator[tuple[int, Array]]:
    """Markers that are seen in ten frames, and their positions from the first to the last of these, gaps bridged."""
    seen, axes = np.isfinite(xyz_m[..., 0]), varying(xyz_m)
    for marker in np.flatnonzero(seen.sum(axis=0) >= 10):
        frames = np.flatnonzero(seen[:, marker])
        yield int(marker), bridge(xyz_m[frames[0] : frames[-1] + 1, marker])[:, axes]


def learn_constant_velocity(
    xyz_m: Array, *, dt_s: float, others: Sequence[Array] = (), settings: MarkerSettings = MarkerSettings()
) -> ConstantVelocity:
    """Constant velocity for each marker, with the acceleration that the recordings show.

    Args:
        xyz_m: (T, M, 3) markers in the world; NaN where not seen. One that is never seen starts amid the others.
        dt_s: Time step.
        others: Other recordings of the same markers and rate. Of each marker's densities in all the geometric mean is
            taken: one short recording may show it at rest (docs/experiments/marker_noise.md).
        settings: Choices.
    """
    start, extent = start_of(xyz_m)
    density = _usual(marker_density, (*others, xyz_m), dt_s)
    speed = np.linalg.norm(np.diff(xyz_m, axis=0), axis=-1) / dt_s
    speed_sd = float(np.sqrt(np.mean(speed[np.isfinite(speed)] ** 2))) if np.isfinite(speed).any() else 1.0
    usual = np.nanmedian(density) if np.isfinite(density).any() else max(speed_sd, 1e-3) ** 2 / dt_s
    density = np.where(np.isfinite(density), density, usual)
    density = np.maximum(settings.acceleration * density, 1e-9)  # m^2/s^3: one that never moves has a covariance, too
    return ConstantVelocity(start_m=start, start_sd_m=extent, speed_sd_m_s=2 * max(speed_sd, 1e-3), density=density)


def learn_lasting(xyz_m: Array, *, dt_s: float, others: Sequence[Array] = ()) -> LastingAcceleration:
    """Of each marker's deviations of velocity and acceleration the geometric mean over all recordings is taken.

    Args:
        xyz_m: (T, M, 3) markers in the world; NaN where not seen. One that is never seen starts amid the others.
        dt_s: Time step.
        others: Other recordings of the same markers and rate.
    """
    start, extent = start_of(xyz_m)
    mean = _usual(marker_motion, (*others, xyz_m), dt_s)
    usual = np.nanmedian(mean, axis=0) if np.isfinite(mean).any() else np.array([1.0, 1.0 / dt_s])
    velocity, acceleration = np.maximum(np.where(np.isfinite(mean), mean, usual), 1e-6).T
    return LastingAcceleration(
        start_m=start,
        start_sd_m=extent,
        speed_sd_m_s=2 * max(float(np.sqrt(np.mean(velocity**2))), 1e-3),
        acceleration_m_s2=acceleration,
        memory_s=max(float(np.median(velocity / acceleration)), dt_s),
    )


def start_of(xyz_m: Array) -> tuple[Array, float]:
    """(M, 3) first positions, amid the others of markers that are never seen; and the deviation of a coordinate."""
    every = xyz_m.reshape(-1, 3)
    start = xyz_m[np.argmax(np.isfinite(xyz_m[..., 0]), axis=0), np.arange(xyz_m.shape[1])]
    start = np.where(np.isfinite(start), start, np.nanmean(every, axis=0))
    return start, max(float(np.sqrt(np.mean(np.nanvar(every, axis=0)))), 1e-3)


def _usual(shown: Callable[..., Array], recordings: Sequence[Array], dt_s: float) -> Array:
    """The geometric mean over recordings of what they show; NaN where none does."""
    logs = np.log([shown(xyz, dt_s=dt_s) for xyz in recordings])
    return np.exp(np.ma.masked_invalid(logs).mean(axis=0).filled(np.nan))
