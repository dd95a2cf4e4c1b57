"""By how much more one camera sees markers off their poses than trials tell: errors of clicks that last, other poses.

What a network clicks is off by pixels and stays so for a while, which no change from frame to frame shows; an animal
that moves as no trial does is off in the same way. Both are a Matern-3/2 process of a size and a time that the
recording shows. Clicks of two markers err apart; where a limb is elsewhere, its markers are off together: by that the
variance is shared between both, never wholly to one (docs/experiments/one_camera_intervals.md).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from mocap.filters.one_view import Poses, Recorded, Views, counted_once
from mocap.filters.pose_prior import PosePrior, half_life_s
from mocap.filters.poses import MATERN_3_2_HALF
from scipy.optimize import minimize_scalar

from eal.arrays import Array

TOGETHER = 0.5
"""Correlation of what neighbours are off by where poses differ: 0.42 (0.01 to 0.59) in 16 recordings of another bat,
-0.14 (-0.25 to 0.08) in nine walks whose clicks stay off."""

POSED = (0.2, 0.8)
"""Least and largest share of the variance that is the animal's pose. Chosen: where poses differ (another bat) z is 1.3
with a half, 1.6 with a fifth, 1.2 by what neighbours tell."""

LEAST_GAIN = 0.5
"""By how much the logarithm of the likelihood of misses that err apart must grow, so that there are such errors: as
much as a number without meaning makes it grow by on average (Wilks 1938)."""


@dataclass(frozen=True, kw_only=True)
class Misfit:
    """What a recording misses beyond what trials tell.

    Attributes:
        sd_m: Deviation of a coordinate across the line of sight.
        sd_px: The same in the camera that sees most.
        half_life_s: Time in which it loses half of its correlation.
        posed: Share of its variance that is the animal's pose; the rest is errors of clicks.
        gain: What it adds to the logarithm of the likelihood, misses that err alike counted once.
    """

    sd_m: float = 0.0
    sd_px: float = 0.0
    half_life_s: float = np.nan
    posed: float = 1.0
    gain: float = 0.0

    @property
    def found(self) -> bool:
        """Whether there is any."""
        return self.gain > LEAST_GAIN

    @property
    def clicks_m(self) -> float:
        """Deviation of the errors of clicks."""
        return float(np.sqrt(1 - self.posed)) * self.sd_m

    def told(self, prior: PosePrior, views: Views, px_per_m: Array) -> tuple[PosePrior, Views]:
        """What trials tell, and what was seen, with it.

        Args:
            prior: What trials tell.
            views: What was seen; deviations are those of clicks in single frames.
            px_per_m: (C, 1, 1) pixels of a metre where the animal is.
        """
        clicks = (px_per_m * self.clicks_m) ** 2
        sd_px = np.sqrt(views.sd_px**2 + clicks)
        decay = float(np.exp(-MATERN_3_2_HALF * prior.dt_s / self.half_life_s))
        return (
            replace(prior, left_sd=np.sqrt(prior.left_sd**2 + self.posed * self.sd_m**2), left_decay=decay),
            replace(views, sd_px=sd_px, lasting=float(np.median((clicks / sd_px**2)[views.seen]))),
        )


def misfit(prior: PosePrior, views: Views, px_per_m: Array, recorded: Recorded, at: Poses) -> Misfit:
    """The likeliest about the most probable poses, of what these miss and their own uncertainty (a step of EM).

    Args:
        prior: What trials tell.
        views: What was seen; deviations are those of clicks in single frames.
        px_per_m: (C, 1, 1) pixels of a metre where the animal is.
        recorded: What was minimised.
        at: The most probable poses.
    """
    xyz, seen = recorded.markers(at), views.seen
    miss, slope = views.seen_from(xyz)
    cov = counted_once(recorded, at)[0].reshape(len(xyz), prior.markers, 3, prior.markers, 3)
    spread = np.einsum("ctmai,tmimj,ctmaj->ctm", slope, cov, slope, optimize=True)
    squared = (np.sum(miss**2, axis=-1) + spread)[seen]
    usual = (views.sd_px**2 + (px_per_m * prior.left_sd[::3]) ** 2)[seen]
    unit = np.broadcast_to(px_per_m, seen.shape)[seen]

    def cost(log_m: float) -> float:
        variance = usual + (unit * np.exp(log_m)) ** 2
        return float(np.sum(np.log(variance) + 0.5 * (views.dof + 2) * np.log1p(squared / (views.dof * variance))))

    animal = np.sqrt(np.mean(prior.mean**2))
    least = np.log(1e-4 * animal)
    best = minimize_scalar(cost, bounds=(least, np.log(3 * animal)), method="bounded", options={"xatol": 1e-3})
    series = np.where(seen[..., None], miss / px_per_m[..., None], np.nan)
    return Misfit(
        sd_m=float(np.exp(best.x)),
        sd_px=float(np.exp(best.x) * px_per_m[views.main, 0, 0]),
        half_life_s=half_life_s([one.reshape(len(xyz), -1) for one in series], prior.dt_s),
        posed=float(np.clip(_together(prior, series) / TOGETHER, *POSED)),
        gain=float((cost(least) - best.fun) / prior.lasts),
    )


def _together(prior: PosePrior, off_m: Array) -> float:
    """Correlation of what markers (C, T, M, 2) are off by with their nearest neighbours in the mean body."""
    body = prior.mean.reshape(-1, 3)
    apart = np.linalg.norm(body[:, None] - body, axis=-1)
    np.fill_diagonal(apart, np.inf)
    other = off_m[:, :, apart.argmin(axis=1)]
    both = np.isfinite(off_m) & np.isfinite(other)
    one, other = np.where(both, off_m, 0.0), np.where(both, other, 0.0)
    size = np.sqrt(np.sum(one**2, axis=(0, 1, 3)) * np.sum(other**2, axis=(0, 1, 3))).sum()
    return float(np.sum(one * other) / max(size, 1e-300))


@dataclass(frozen=True, kw_only=True)
class Matern:
    """A Matern-3/2 process of variance 1 in equal steps: e(t) = 2 rho e(t - 1) - rho^2 e(t - 2) + noise.

    Attributes:
        rho: What it keeps from frame to frame (``PosePrior.left_decay``).
    """

    rho: float

    @cached_property
    def noise(self) -> float:
        """Variance of the noise."""
        return (1 - self.rho**2) ** 3 / (1 + self.rho**2)

    @cached_property
    def correlations(self) -> Sequence[float]:
        """Of a frame with itself, the next and the one after that."""
        one = 2 * self.rho / (1 + self.rho**2)
        return 1.0, one, 2 * self.rho * one - self.rho**2

    def drawn(self, rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
        """One of (T, ...) at random, begun so long before that its variance is 1."""
        from scipy.signal import lfilter  # with all statistics, 0.3 s

        before = int(np.ceil(20 / -np.log(self.rho)))
        kicks = np.sqrt(self.noise) * rng.normal(size=(before + shape[0], *shape[1:]))
        return np.asarray(lfilter([1.0], [1.0, -2 * self.rho, self.rho**2], kicks, axis=0))[before:]
