"""What a network's likelihoods are worth: how errors grow as the likelihood falls, from how rays meet.

Programs that click by themselves (DeepLabCut, Lightning Pose, SLEAP) state a likelihood of each click. It is no
probability, and means something else for every network; but each click that two surer cameras see as well can be
compared with what these predict of it. That tells by how much errors grow as the likelihood falls, and below which
likelihood a click says nothing.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eal.arrays import Array
from mocap.cameras.triangulate import linear, linearise, project, refine

Mask = NDArray[np.bool_]

FEWEST = 40
"""Clicks that errors of a range of likelihoods are learned from: a scale is known to 1 / sqrt(2 * 40) = 11 %."""
SHARES = np.array([0.0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0])
"""Ranges of likelihoods, as shares of all clicks."""
FAR = 6.0
"""A click is wrong if it misses by more than so many of the deviations that surer clicks have: of
normal errors in two coordinates exp(-18), one in 66 million."""
WORTHLESS = 1 / 3
"""Likelihoods at which a larger share of the clicks is wrong are not believed. Chosen: of three flights it refuses
those below 0.49 to 0.55, where people chose 0.475 (docs/experiments/arena.md)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LikelihoodNoise:
    """How the errors of clicks depend on their likelihood.

    Attributes:
        at: (K,) likelihoods, increasing.
        factor: (K,) deviations there over that of a click of median likelihood; 1 or more, not increasing.
        wrong: (K,) share of clicks that miss by more than ``FAR`` deviations; not increasing.
        least: Clicks of lower likelihood are not believed; 0: all are.
        scale_px: Standard deviation of a pixel coordinate of a click of median likelihood.
    """

    at: Array
    factor: Array
    wrong: Array
    least: float
    scale_px: float

    def factors(self, likelihood: Array) -> Array:
        """Factors of deviations at likelihoods of any shape, log-linear in between; 1 where the likelihood is NaN."""
        inside = np.exp(np.interp(np.nan_to_num(likelihood, nan=np.inf), self.at, np.log(self.factor)))
        return np.where(np.isfinite(likelihood), inside, 1.0)

    def believed(self, likelihood: Array) -> Mask:
        """Where clicks are believed; those without likelihood are."""
        return ~(likelihood < self.least)


def weighed_clicks(
    matrices: Array, uv_px: Array, likelihood: Array | None
) -> tuple[LikelihoodNoise | None, Mask, Array]:
    """What likelihoods are worth; (C, T, M) clicks that are not believed, and deviations relative to a usual click."""
    found = None if likelihood is None else likelihood_noise(matrices, uv_px, likelihood)
    if found is None or likelihood is None:
        return None, np.zeros(uv_px.shape[:3], dtype=bool), np.ones(uv_px.shape[:3])
    return found, np.isfinite(uv_px[..., 0]) & ~found.believed(likelihood), found.factors(likelihood)


def likelihood_noise(matrices: Array, uv_px: Array, likelihood: Array) -> LikelihoodNoise | None:
    """Learn from clicks that two surer cameras predict.

    The others of a click are those with at least the median likelihood. With two or more of them the point follows by
    least squares, with the covariance C in units of the pixel variance; the click's miss r then has the covariance
    I + J C J^T, and d^2 = r^T (I + J C J^T)^-1 r is 2 ln 2 s^2 in the median for normal errors of deviation s. Over
    ranges of likelihood s and the share of wrong clicks are made monotone (isotonic regression: Barlow et al. 1972).

    Args:
        matrices: (C, 3, 4) projections.
        uv_px: (C, T, M, 2) ideal pixels; NaN where not seen.
        likelihood: (C, T, M) of each click; NaN: not stated.

    Returns:
        What was learned; None where fewer than 2 ``FEWEST`` clicks can be compared, or likelihoods do not vary.
    """
    finite = np.isfinite(uv_px[..., 0]) & np.isfinite(likelihood)
    if len(matrices) < 3 or not finite.any():
        return None
    middle = float(np.median(likelihood[finite]))
    miss = _misses(matrices, uv_px, finite & (likelihood >= middle))
    tested = finite & np.isfinite(miss)
    if np.count_nonzero(tested) < 2 * FEWEST or np.ptp(likelihood[tested]) == 0:
        return None
    value, off = likelihood[tested], miss[tested]
    reference = _scale(off[value >= middle]) if np.count_nonzero(value >= middle) >= FEWEST else _scale(off)
    parts = _ranges(value, np.quantile(likelihood[finite], SHARES))
    count = np.array([len(part) for part in parts], dtype=np.float64)
    at = np.array([value[part].mean() for part in parts])
    scale = np.exp(_falling(np.log([_scale(off[part]) for part in parts]), count))
    wrong = _falling(np.array([np.mean(off[part] > FAR * reference) for part in parts]), count)
    worthless = np.flatnonzero(wrong > WORTHLESS)
    last = worthless[-1] if len(worthless) else -1
    least = 0.0 if last < 0 else float(value[parts[last]].max())
    return LikelihoodNoise(
        at=at, factor=np.clip(scale / reference, 1.0, 10.0), wrong=wrong, least=least, scale_px=reference
    )


def _misses(matrices: Array, uv_px: Array, sure: Mask) -> Array:
    """(C, T, M) misses of clicks from what the sure ones of the other cameras predict, as if predicted exactly."""
    out = np.full(uv_px.shape[:3], np.nan)
    for camera in range(len(matrices)):
        others = [c for c in range(len(matrices)) if c != camera]
        uv = np.where(sure[others][..., None], uv_px[others], np.nan)
        test = np.isfinite(uv[..., 0]).sum(axis=0) >= 2
        test &= np.isfinite(uv_px[camera, ..., 0])
        if not test.any():
            continue
        xyz, cov = refine(matrices[others], uv[:, test], linear(matrices[others], uv[:, test]), sd_px=1.0, iterations=3)
        jacobian = linearise(matrices[[camera]], uv_px[[camera]][:, test], xyz).jacobian[0]
        spread = np.eye(2) + jacobian @ cov @ np.swapaxes(jacobian, 1, 2)
        r = uv_px[camera, test] - project(matrices[[camera]], xyz)[0]
        good = np.isfinite(r[:, 0]) & np.isfinite(cov[:, 0, 0])
        distance = np.full(len(r), np.nan)
        distance[good] = np.einsum("ki,kij,kj->k", r[good], np.linalg.inv(spread[good]), r[good])
        out[camera, test] = np.sqrt(distance)
    return out


def _scale(miss: Array) -> float:
    """Standard deviation of a coordinate from the median of lengths in two dimensions."""
    return max(float(np.median(miss)) / float(np.sqrt(2 * np.log(2))), 1e-9)


def _ranges(value: Array, edges: Array) -> list[NDArray[np.int64]]:
    """Indices of the values in each range, from low to high; a range with too few is joined to the next."""
    parts: list[NDArray[np.int64]] = []
    waiting = np.zeros(0, dtype=np.int64)
    which = np.searchsorted(edges[1:-1], value, side="right")
    for number in range(len(edges) - 1):
        waiting = np.concatenate([waiting, np.flatnonzero(which == number)])
        if len(waiting) >= FEWEST:
            parts.append(waiting)
            waiting = np.zeros(0, dtype=np.int64)
    if len(waiting):
        parts[-1:] = [np.concatenate([*parts[-1:], waiting])]
    return parts


def _falling(values: Array, weight: Array) -> Array:
    """The nearest sequence that nowhere rises."""
    from scipy.optimize import isotonic_regression

    return isotonic_regression(values, weights=weight, increasing=False).x
