"""Each marker by itself, as smooth, as quick and as noisy as the recording shows: velocities and accelerations."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from mocap.filters.models.base import FittedMotion, TrajectoryModel, TrialSet
from mocap.filters.models.constant_velocity import MarkerSettings, start_of
from mocap.filters.motion.smooth_acceleration import SmoothAcceleration
from mocap.filters.moving import Rates
from mocap.filters.observations import Observations, noisier
from mocap.filters.poses import MarkerTrial
from mocap.filters.records import Estimate
from mocap.filters.smoothness import FAR, Smoothness, likeliest, seen_enough
from mocap.filters.velocities import RatePoints
from numpy.typing import ArrayLike, NDArray

from eal.arrays import Array
from eal.efforts import Progress, shares

LEAST = 0.01
"""A motion of a smaller weight is left out."""


@dataclass(frozen=True, kw_only=True)
class SmoothSettings(TrajectoryModel):
    """Choices of smooth accelerations, each marker for itself.

    Attributes:
        order: Number of states of a coordinate: 4 are a Matern process of order 7/2, position to jerk.
        free: How many of these, from the position on, are drawn to no mean, weighted by the recording's likelihood:
            velocities are stationary, or jerks, as of what falls (docs/experiments/single_points.md).
    """

    order: int = 4
    free: tuple[int, ...] = (1, 3)

    @property
    def description(self) -> str:
        """Its name."""
        return "smooth acceleration"

    def fit(self, trials: TrialSet) -> FittedMotion:
        """Learn rate, size and noise from the last trial; of too few frames, constant velocity."""
        last = trials.trials[-1]
        shown = seen_enough(last.xyz_m)
        if not len(shown):
            return MarkerSettings().fit(trials)
        xyz_m, sd_m = last.xyz_m[:, shown], last.sd_m[:, shown]
        found = [likeliest(xyz_m, sd_m, last.dt_s, order=self.order, free=free) for free in self.free]
        logs = np.array([one.log_likelihood for one in found])
        share = np.exp(logs - logs.max()) / np.exp(logs - logs.max()).sum()
        parts = [
            OfOrder(motion=motion_of(found[i], last, shown), noise=found[i].noise, share=float(share[i]))
            for i in np.argsort(-share, kind="stable").tolist()
            if share[i] >= LEAST
        ]
        return WeightedMotion(parts[0].motion, last.t_s, trials.rigid, parts=tuple(parts))


def motion_of(found: Smoothness, trial: MarkerTrial, shown: NDArray[np.int64]) -> SmoothAcceleration:
    """The motion of all markers of a trial, of which some are ``shown`` enough; others are driven as these on average.

    Args:
        found: How smooth the shown ones are.
        trial: The trial.
        shown: Their indices.
    """
    start, extent = start_of(trial.xyz_m)
    speed = np.diff(trial.xyz_m, axis=0)[np.isfinite(np.diff(trial.xyz_m, axis=0)).all(axis=2)] / trial.dt_s
    density = np.full(len(start), np.exp(np.mean(np.log(found.density))))
    density[shown], intensity = found.density, np.ones(trial.xyz_m.shape[:2])
    intensity[:, shown] = found.intensity
    return SmoothAcceleration(
        start_m=start,
        start_sd_m=FAR * extent,
        speed_sd_m_s=FAR * max(float(np.sqrt(np.mean(speed**2))) if speed.size else 0.0, 1e-3),
        order=found.order,
        free=found.free,
        rate_hz=found.rate_hz,
        density=density,
        intensity=intensity,
        unit_s=float(np.median(found.window_s)),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class OfOrder:
    """One of several motions that are weighted.

    Attributes:
        motion: The motion.
        noise: Factor on the stated deviations of the noise.
        share: Its weight.
    """

    motion: SmoothAcceleration
    noise: float
    share: float


@dataclass(frozen=True, eq=False)
class WeightedMotion(FittedMotion):
    """Several motions weighted by their likelihood; ``motion`` is the likeliest.

    Attributes:
        parts: The motions, likeliest first.
    """

    parts: tuple[OfOrder, ...] = ()

    def fill(
        self, observations: Observations, *, rate_points: RatePoints | None = None, progress: Progress | None = None
    ) -> Estimate:
        """Estimate the markers by each motion, and weigh means and covariances."""
        every = [
            FittedMotion(part.motion, self.t_s, self.rigid).fill(
                noisier(observations, part.noise), rate_points=rate_points, progress=tell
            )
            for part, tell in zip(self.parts, shares(progress, [1.0] * len(self.parts)), strict=True)
        ]
        return weighted(every, np.array([part.share for part in self.parts]))


def weighted(every: Sequence[Estimate], share: Array) -> Estimate:
    """Mean and covariance of a mixture of estimates; what was seen is that of the first."""
    first = every[0]
    if len(every) == 1:
        return first
    mean, cov = _mixed([one.xyz_m for one in every], [one.cov_m2 for one in every], share)
    rates = [one.rates for one in every if one.rates is not None]
    if not rates:
        return replace(first, xyz_m=mean, cov_m2=cov)
    weights = rates[0].rate_points.all_weights
    places = np.einsum("nm,ptmi->ptni", weights, np.array([one.xyz_m for one in every]))
    states = np.concatenate([places, np.array([one.velocity_m_s for one in rates])], axis=-1)
    state, own = _mixed(states, [one.own for one in rates], share)
    off = states - state
    a, b = np.array(rates[0].rate_points.pairs, dtype=np.int64).reshape(-1, 2).T
    cross = np.einsum("p,ptnij->tnij", share, [one.cross for one in rates])
    cross += np.einsum("p,ptni,ptnj->tnij", share, off[:, :, a], off[:, :, b])
    kept = np.einsum("p,ptni->tni", share, [one.kept for one in rates])
    accelerations = [one.acceleration_m_s2 for one in rates if one.acceleration_m_s2 is not None]
    spreads = [one.acceleration_cov for one in rates if one.acceleration_cov is not None]
    acceleration, spread = _mixed(accelerations, spreads, share) if accelerations else (None, None)
    mixed = Rates(
        rate_points=rates[0].rate_points,
        velocity_m_s=state[..., 3:],
        own=own.astype(np.float32),
        cross=cross.astype(np.float32),
        kept=kept,
        acceleration_m_s2=acceleration,
        acceleration_cov=None if spread is None else spread.astype(np.float32),
    )
    return replace(first, xyz_m=mean, cov_m2=cov, rates=mixed)


def _mixed(means: ArrayLike, covs: ArrayLike, share: Array) -> tuple[Array, Array]:
    """Mean (..., k) and covariance (..., k, k) of a mixture of P normal laws (P, ..., k), (P, ..., k, k)."""
    each = np.asarray(means, dtype=float)
    mean = np.tensordot(share, each, axes=1)
    off = each - mean
    between = np.einsum("p,p...i,p...j->...ij", share, off, off)
    return mean, np.tensordot(share, np.asarray(covs, dtype=float), axes=1) + between
